"""Axes beside a direction."""

from __future__ import annotations

import numpy as np


def axes_across(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors (3, 2), its columns, across a unit vector (3,) and each other, right-handed with it before
    them."""
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    first /= np.linalg.norm(first, axis=0)
    return np.stack([first, np.cross(direction, first)], axis=1)
