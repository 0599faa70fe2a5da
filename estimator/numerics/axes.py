"""Directions: axes beside one, the mean of several."""

from __future__ import annotations

import numpy as np

from estimator.numerics.vectors import cross


def axes_across(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors (3, 2), its columns, across a unit vector (3,) and each other, right-handed with it before
    them."""
    first = np.array(cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction))
    first /= np.linalg.norm(first)
    return np.stack([first, cross(direction, first)], axis=1)


def mean_direction(ways: np.ndarray) -> np.ndarray:
    """Mean (3,) of the directions of ways (T, 3), shorter than 1 the more they differ; those that are missing (NaN) or
    nowhere are left out, and without any others it is 0."""
    length = np.linalg.norm(ways, axis=1)
    known = length > 0.0
    return np.asarray((ways[known] / length[known, None]).mean(axis=0)) if known.any() else np.zeros(3)
