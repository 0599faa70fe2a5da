"""Blobs of skin and faces as detectors would give them of a known truth: noisy, merged, missing, or of nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.vision.faces import Faces
from estimator.vision.skin import Blobs
from humanoid.support.settings import CheckedSettings, setting


@dataclass(frozen=True)
class SkinDetectorSettings(CheckedSettings):
    """How the detectors err.

    noise [px]: standard deviation of each coordinate. missing: share of blobs, and of faces, that are not detected.
    clutter: mean number of blobs of nothing in a frame. spread: standard deviation of the logarithm of an area.
    Raises InputError where a value cannot be.
    """

    noise: float = setting(1.5, at_least=0)
    missing: float = setting(0.05, at_least=0, at_most=1)
    clutter: float = setting(0.05, at_least=0)
    spread: float = setting(0.25, at_least=0)


def simulated_blobs(
    pixels: np.ndarray,
    radii: np.ndarray,
    face: int,
    image_size: tuple[int, int],
    rng: np.random.Generator,
    settings: SkinDetectorSettings,
    hidden: np.ndarray | None = None,
) -> list[Blobs]:
    """Blobs of every frame, of round pieces of skin.

    Pieces that overlap make one merged blob. pixels (T, F, 2) [px]: middles of face and hands, NaN where nothing is;
    radii (F,) [px]. face: which of them is the face. image_size: width, height [px]; a piece whose middle is outside
    makes no blob. hidden (T, F) bool: pieces that something hides at an instant, none unless given.
    """
    hand = float(np.median(np.delete(np.pi * radii**2, face)))
    areas = float(np.pi * radii[face] ** 2), hand
    inside = np.isfinite(pixels).all(axis=2) & ((pixels >= 0) & (pixels < image_size)).all(axis=2)
    if hidden is not None:
        inside &= ~hidden
    return [
        _blobs(frame[there], radii[there], areas, image_size, rng, settings)
        for frame, there in zip(pixels, inside, strict=True)
    ]


def _blobs(
    pixels: np.ndarray,
    radii: np.ndarray,
    areas: tuple[float, float],
    image_size: tuple[int, int],
    rng: np.random.Generator,
    settings: SkinDetectorSettings,
) -> Blobs:
    """Of one frame: the pieces in it, (F, 2) and (F,) [px]; areas of face and hand."""
    face, hand = areas
    near = np.linalg.norm(pixels[:, None] - pixels, axis=2) < radii[:, None] + radii
    for _ in range(len(near) - 2):
        near = near @ near  # what touches what touches it
    group = near.argmax(axis=1) if len(near) else np.zeros(0, dtype=np.int64)
    kept = [g for g in np.unique(group) if rng.random() >= settings.missing]
    pieces = [np.flatnonzero(group == g) for g in kept]
    rows = [_moments(pixels[p], radii[p]) for p in pieces]
    for _ in range(rng.poisson(settings.clutter)):
        radius = np.sqrt(hand / np.pi) * rng.uniform(0.6, 1.4)
        rows.append(_moments(rng.uniform([0.0, 0.0], image_size)[None], np.array([radius])))
        pieces.append(np.zeros(1, dtype=np.int64))
    scale = np.exp(settings.spread * rng.standard_normal(len(rows)))
    area = np.array([a for _, _, a in rows]) * scale
    order = np.argsort(-area, kind="stable")
    mean = np.array([m for m, _, _ in rows]).reshape(-1, 2) + settings.noise * rng.standard_normal((len(rows), 2))
    covariance = np.array([c for _, c, _ in rows]).reshape(-1, 2, 2)
    merged = np.array([len(p) > 1 for p in pieces], dtype=bool)
    return Blobs(mean[order], covariance[order], area[order], merged[order], face, hand)


def _moments(pixels: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean (2,), covariance (2, 2) and area of discs (F, 2), (F,) [px], as if they did not overlap."""
    areas = np.pi * radii**2
    share = areas / areas.sum()
    mean = share @ pixels
    off = pixels - mean
    covariance = np.einsum("f,fi,fj->ij", share, off, off) + float(share @ (0.25 * radii**2)) * np.eye(2)
    return mean, covariance, float(areas.sum())


def simulated_faces(
    pixels: np.ndarray,
    radius: float,
    rng: np.random.Generator,
    settings: SkinDetectorSettings,
    hidden: Sequence[bool] | np.ndarray | None = None,
) -> list[Faces]:
    """Faces of every frame at pixels (T, 2), NaN where none is, of a radius [px]; hidden (T,): where one sees none.

    Rendered heads have no face that a detector of faces could see, so this stands in its place.
    """
    there = np.isfinite(pixels).all(axis=1) & (rng.random(len(pixels)) >= settings.missing)
    if hidden is not None:
        there &= ~np.asarray(hidden)
    noisy = pixels + settings.noise * rng.standard_normal(pixels.shape)
    variance = max(settings.noise, 0.1 * radius) ** 2
    return [
        Faces(at[None], variance * np.eye(2)[None], np.array([0.9])) if seen else Faces.none()
        for at, seen in zip(noisy, there, strict=True)
    ]
