"""Angles between vectors."""

from __future__ import annotations

import numpy as np


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., n) of length 1; of next to none, none."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between vectors (..., n), (...) [rad]."""
    return np.asarray(np.arccos(np.clip((unit(a) * unit(b)).sum(axis=-1), -1.0, 1.0)))
