"""Reference motions to compare a run with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimator.formats.checked_json import LARGEST
from estimator.formats.npz import read_npz
from estimator.formats.opensim import frame_rate, read_trc
from estimator.imaging.clip import FPS_RANGE
from humanoid.errors import InputError
from humanoid.landmarks import landmark_name

_KEYS = (("landmarks", "landmark_names"), ("points", "names"))


def load_reference(path: str | Path) -> tuple[tuple[str, ...], np.ndarray, float]:
    """Landmark names (L), points (T, L, 3) in the world [m], NaN where missing, and frames per second.

    Reads kinemode's own npz export, an npz with `points`, `names` and `fps`, and TRC. Names of other programs become
    landmark names where there is one, and stay as they are otherwise.

    Raises
    ------
    InputError: missing, of another kind, with arrays of the wrong shape, or points or a rate that cannot be.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "no such file")
    if path.suffix.lower() == ".trc":
        names, points, time = read_trc(path)
        return _checked(path, names, points, time)
    if path.suffix.lower() != ".npz":
        raise InputError(path, "is no reference", remedy="an .npz or .trc file is needed")
    return _npz(path)


def _npz(path: Path) -> tuple[tuple[str, ...], np.ndarray, float]:
    arrays = read_npz(path)
    keys = next((k for k in _KEYS if k[0] in arrays and k[1] in arrays), None)
    if keys is None:
        wanted = " or ".join(f"{a}, {b}" for a, b in _KEYS)
        raise InputError(path, "has no landmarks", remedy=f"arrays {wanted}; found {', '.join(arrays)}")
    points = _numbers(arrays[keys[0]], path, keys[0])
    names = arrays[keys[1]]
    if names.ndim != 1 or names.dtype.kind not in "US":
        raise InputError(path, "a list of names is needed", place=keys[1])
    if points.ndim != 3 or points.shape[1:] != (len(names), 3):
        problem = f"{len(names)} names do not fit an array of shape {points.shape}"
        raise InputError(path, problem, place=keys[0], remedy="(frames, names, 3) is needed")
    if "fps" not in arrays:
        return _checked(path, [str(n) for n in names], points, _numbers(arrays.get("time", np.zeros(0)), path, "time"))
    rate = _numbers(arrays["fps"], path, "fps")
    if rate.size != 1:
        raise InputError(path, "one number is needed", place="fps")
    return _checked(path, [str(n) for n in names], points, np.zeros(0), float(rate.reshape(())))


def _numbers(array: np.ndarray, path: Path, place: str) -> np.ndarray:
    if array.dtype.kind not in "iuf":
        raise InputError(path, "numbers are needed", place=place)
    return array.astype(np.float64)


def _checked(
    path: Path, names: Sequence[str], points: np.ndarray, time: np.ndarray, fps: float | None = None
) -> tuple[tuple[str, ...], np.ndarray, float]:
    """A reference whose points and rate can be."""
    if points.size == 0:
        raise InputError(path, "has no points")
    if not (np.isnan(points) | (np.abs(points) < LARGEST)).all():
        problem = "has a point that is infinite, or beyond all measure"
        raise InputError(path, problem, remedy=f"metres below {LARGEST:g}, NaN where a point is missing")
    if fps is None:
        if time.ndim != 1 or (len(time) > 1 and not np.median(np.diff(np.nan_to_num(time))) > 0.0):
            raise InputError(path, "the times do not rise", place="time")
        fps = frame_rate(time)
    if not FPS_RANGE[0] <= fps <= FPS_RANGE[1]:
        low, high = FPS_RANGE
        problem = f"{fps:g} frames per second cannot be: a positive number is needed"
        raise InputError(path, problem, place="fps", remedy=f"{low:g} to {high:g}")
    return _named(names), points, fps


def _named(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(landmark_name(name) or name for name in names)
