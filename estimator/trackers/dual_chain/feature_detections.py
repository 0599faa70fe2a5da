"""Blobs of skin, faces and keypoints as detections of the features of a body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.inference.chains.evidence import Detections
from estimator.search.point_features import HEAD
from estimator.trackers.dual_chain.faces import Faces
from estimator.trackers.dual_chain.skin import Blobs
from estimator.vision.resolution import resized_pixels
from humanoid.subject.landmarks import mirror_index

_AREA = 0.5  # standard deviation of the logarithm of a hand's or face's area from frame to frame
_LEAST = 1e-3  # of how well a blob suits
_WIDE = 0.5  # standard deviation of where the middle of a hand is in its blob, in those of the blob
_NOISE = 2.0  # px
_SWAPPED = 0.02  # share of keypoints whose side is mistaken


def of_blobs(names: Sequence[str], blobs: Blobs) -> Detections:
    """Each blob may be of each hand, and of the head, by its area; a merged one of several of them.

    The middle of a hand is in the middle of its blob but for about half of the blob's spread; in one that is merged, or
    that is another's too, it is anywhere in it.
    """
    count = len(blobs.area)
    suits = np.zeros((count, len(names)))
    for f, name in enumerate(names):
        area = blobs.face if name == HEAD else blobs.hand
        off = np.log(np.maximum(blobs.area, 1.0) / area) / _AREA
        suits[:, f] = np.maximum(np.exp(-0.5 * off**2), _LEAST)
    suits[blobs.merged] = np.maximum(suits[blobs.merged], 0.2)
    scale = np.where(blobs.merged, 1.0, _WIDE) ** 2
    noise = _NOISE**2 * np.eye(2)
    covariance = blobs.covariance * scale[:, None, None] + noise
    return Detections(tuple(names), blobs.mean, covariance, suits, blobs.merged, blobs.covariance + noise)


def of_keypoints(names: Sequence[str], pixels: np.ndarray, sigma: np.ndarray) -> Detections:
    """Each keypoint is of its own feature, of the same on the other side, which detectors mistake it for, or wrong:
    pixels (F, 2) [px], NaN where missing, sigma (F,) [px]."""
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    suits = np.zeros((len(seen), len(names)))
    suits[np.arange(len(seen)), np.array(mirror_index(names))[seen]] = _SWAPPED
    suits[np.arange(len(seen)), seen] = 1.0
    covariance = np.square(sigma[seen])[:, None, None] * np.eye(2)
    return Detections(tuple(names), pixels[seen], covariance, suits, np.zeros(len(seen), dtype=bool))


def of_faces(names: Sequence[str], faces: Faces) -> Detections:
    """Each is of the head with the detector's confidence, or of nothing."""
    suits = np.zeros((len(faces.score), len(names)))
    suits[:, [k for k, name in enumerate(names) if name == HEAD]] = np.clip(faces.score, _LEAST, 1.0)[:, None]
    covariance = faces.covariance + _NOISE**2 * np.eye(2)
    return Detections(tuple(names), faces.mean, covariance, suits, np.zeros(len(faces.score), dtype=bool))


def all_of(detections: Sequence[Detections]) -> Detections:
    """Joint detections of several detectors of the same features."""
    arrays = [
        np.concatenate([getattr(each, name) for each in detections])
        for name in ("mean", "covariance", "suits", "merged", "shared")
    ]
    return Detections(detections[0].names, *arrays)


def at_size(detections: Detections, old: tuple[int, int], new: tuple[int, int]) -> Detections:
    """Detections of a picture of size `old`, in one resized to `new`."""
    ratio = np.array(new) / np.array(old)
    covariance, together = (C * ratio[:, None] * ratio for C in (detections.covariance, detections.shared))
    mean = resized_pixels(detections.mean, old, new)
    return replace(detections, mean=mean, covariance=covariance, together=together)
