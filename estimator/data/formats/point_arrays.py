"""Checks of arrays of points over time, from any source."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.data.formats.checked_json import LARGEST
from estimator.data.media.clip import FPS_RANGE
from humanoid.support.errors import InputError


def number_array(array: np.ndarray, path: str | Path, place: str) -> np.ndarray:
    """float64 of an array of numbers; raises InputError for another."""
    if array.dtype.kind not in "iuf":
        raise InputError(path, "numbers are needed", place=place)
    return array.astype(np.float64)


def name_list(array: np.ndarray, path: str | Path, place: str) -> tuple[str, ...]:
    """The names in an array of texts; raises InputError for another."""
    if array.ndim != 1 or array.dtype.kind not in "US":
        raise InputError(path, "a list of names is needed", place=place)
    return tuple(str(name) for name in array)


def checked_points(path: str | Path, points: np.ndarray) -> np.ndarray:
    """Points [m] that can be, NaN where they are missing; raises InputError for others."""
    if not (np.isnan(points) | (np.abs(points) < LARGEST)).all():
        problem = "has a point that is infinite, or at least 1e7 in size"
        raise InputError(path, problem, remedy=f"metres below {LARGEST:g}, NaN where a point is missing")
    return points


def checked_rate(path: str | Path, fps: float) -> float:
    """A rate that can be [1/s]; raises InputError for another."""
    low, high = FPS_RANGE
    if not low <= fps <= high:
        raise InputError(path, f"must be {low:g} to {high:g}, got {fps:g}", place="fps")
    return fps


def rising_times(path: str | Path, time: np.ndarray, count: int) -> np.ndarray:
    """Times (count,) [s] that rise; raises InputError for others."""
    if time.shape != (count,) or not np.isfinite(time).all() or np.any(np.diff(time) <= 0.0):
        raise InputError(path, f"is not {count} rising numbers", place="time", remedy="the time of each frame [s]")
    return time
