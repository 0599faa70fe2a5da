"""Boundary samples find the same contour points through cells of the image as by comparing all."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.vision.cues.outline_matching import nearest_contour
from estimator.vision.visibility import HIDDEN, INNER, OUTER


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("seed", range(60))
def test_the_nearest_contour_point_is_the_first_of_the_nearest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    samples, points = rng.integers(1, 60), rng.integers(0, 90)
    size, turn = 10.0 ** rng.uniform(0.0, 2.5), 10.0 ** rng.uniform(-1.0, 2.0)
    place, normal = rng.uniform(-size, 2.0 * size, (samples, 2)), directions(rng, samples)
    pixels, normals = rng.uniform(0.0, size, (points, 2)), directions(rng, points)
    state = rng.choice(np.array([OUTER, INNER, HIDDEN], dtype=np.int8), points)
    if seed % 2:  # several at one place, so that some are equally near
        same = rng.integers(0, max(1, points), points)
        pixels, normals = pixels[same], normals[same]
    chosen = np.empty(samples, dtype=np.int64)
    nearest_contour(place, normal, pixels, normals, state, turn, chosen)
    away = place[:, None] - pixels
    apart = 1.0 - normal[:, :1] * normals[:, 0] - normal[:, 1:] * normals[:, 1]
    far = np.where(state == OUTER, away[..., 0] ** 2 + away[..., 1] ** 2 + apart * turn * turn, np.inf)
    nobody = np.full(samples, -1)
    assert np.array_equal(chosen, far.argmin(axis=1) if np.isfinite(far).any() else nobody)
