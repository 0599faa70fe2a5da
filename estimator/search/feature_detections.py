"""Blobs of skin, and keypoints, as detections of the features of a body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.imaging.skin import Blobs
from estimator.inference.chains.evidence import Detections
from estimator.search.point_features import HEAD

_AREA = 0.5  # standard deviation of the logarithm of a hand's or face's area from frame to frame
_LEAST = 1e-3  # of how well a blob suits
_WIDE = 0.5  # standard deviation of where the middle of a hand is in its blob, in those of the blob
_NOISE = 2.0  # px


def of_blobs(names: Sequence[str], blobs: Blobs) -> Detections:
    """Each blob may be of each hand, and of the head, by its area; a merged one of several of them.

    The middle of a hand is in the middle of its blob but for about half of the blob's spread; in one that is merged it
    is anywhere in it.
    """
    count = len(blobs.area)
    suits = np.zeros((count, len(names)))
    for f, name in enumerate(names):
        area = blobs.face if name == HEAD else blobs.hand
        off = np.log(np.maximum(blobs.area, 1.0) / area) / _AREA
        suits[:, f] = np.maximum(np.exp(-0.5 * off**2), _LEAST)
    suits[blobs.merged] = np.maximum(suits[blobs.merged], 0.2)
    scale = np.where(blobs.merged, 1.0, _WIDE) ** 2
    covariance = blobs.covariance * scale[:, None, None] + _NOISE**2 * np.eye(2)
    return Detections(tuple(names), blobs.mean, covariance, suits, blobs.merged)


def of_keypoints(names: Sequence[str], pixels: np.ndarray, sigma: np.ndarray) -> Detections:
    """Each keypoint is of its own feature, or wrong: pixels (F, 2) [px], NaN where missing, sigma (F,) [px]."""
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    suits = np.zeros((len(seen), len(names)))
    suits[np.arange(len(seen)), seen] = 1.0
    covariance = np.square(sigma[seen])[:, None, None] * np.eye(2)
    return Detections(tuple(names), pixels[seen], covariance, suits, np.zeros(len(seen), dtype=bool))
