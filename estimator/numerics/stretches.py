"""Stretches of an array in which a condition holds."""

from __future__ import annotations

import numpy as np


def stretches(holds: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of frames in which something holds, (T,) bool: the first frame, and the one after the last."""
    edges = np.flatnonzero(np.diff(np.r_[False, holds, False])).reshape(-1, 2)
    return [(int(first), int(after)) for first, after in edges]
