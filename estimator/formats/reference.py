"""Reference motions to compare a run with."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.formats.opensim import Coordinates, frame_rate, read_mot, read_trc
from humanoid.errors import InputError
from humanoid.landmarks import landmark_name

_KEYS = (("landmarks", "landmark_names"), ("points", "names"))


class ReferenceFile(NamedTuple):
    """What a reference file has.

    names (L), points (T, L, 3): landmarks in the world [m], NaN where missing; none where there are angles alone.
    time (T,) [s]: of each frame. coordinates: joint angles, None where there are none.
    """

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray
    coordinates: Coordinates | None = None


def load_reference(path: str | Path) -> ReferenceFile:
    """Landmarks, joint angles or both.

    Reads kinemode's own npz export and the truth of a rendered clip, an npz with `points`, `names` and `fps`, TRC and
    MOT. Landmark names of other programs become ours where there is one, and stay as they are otherwise.

    Raises
    ------
    InputError: missing, of another kind, or with arrays of the wrong shape.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "no such file")
    kind = path.suffix.lower()
    if kind not in _READERS:
        raise InputError(path, "is no reference", remedy=f"one of {', '.join(_READERS)} is needed")
    return _READERS[kind](path)


def _trc(path: Path) -> ReferenceFile:
    names, points, time = read_trc(path)
    return ReferenceFile(_named(names), points, np.arange(len(points)) / frame_rate(time))


def _mot(path: Path) -> ReferenceFile:
    coordinates, time = read_mot(path)
    return ReferenceFile((), np.zeros((len(time), 0, 3)), _rising(path, time, len(time)), coordinates)


def _npz(path: Path) -> ReferenceFile:
    try:
        with np.load(path, allow_pickle=False) as file:
            keys = next((k for k in _KEYS if k[0] in file and k[1] in file), None)
            coordinates = _coordinates(path, file) if "q" in file and "q_names" in file else None
            if keys is None and coordinates is None:
                wanted = " or ".join(f"{a}, {b}" for a, b in (*_KEYS, ("q", "q_names")))
                problem = "has neither landmarks nor joint angles"
                raise InputError(path, problem, remedy=f"arrays {wanted}; found {', '.join(file.files)}")
            points = np.zeros((0, 0, 3)) if keys is None else np.asarray(file[keys[0]], dtype=np.float64)
            names = [] if keys is None else [str(n) for n in file[keys[1]]]
            given = np.asarray(file["time"], dtype=np.float64) if "time" in file and "fps" not in file else None
            fps = float(file["fps"]) if "fps" in file else frame_rate(np.zeros(0))
    except InputError:
        raise
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(path, f"cannot be read: {error}") from None
    if keys is None and coordinates is not None:
        points = np.zeros((len(coordinates.values), 0, 3))
    if points.ndim != 3 or points.shape[1:] != (len(names), 3):
        problem = f"{len(names)} names do not fit an array of shape {points.shape}"
        raise InputError(path, problem, place=keys[0] if keys else "", remedy="(frames, names, 3) is needed")
    if coordinates is not None and len(coordinates.values) != len(points):
        raise InputError(path, f"has {len(coordinates.values)} frames, the landmarks {len(points)}", place="q")
    if not np.isfinite(fps) or fps <= 0.0:
        raise InputError(path, "a positive number is needed", place="fps")
    time = np.arange(len(points)) / fps if given is None else _rising(path, given, len(points))
    return ReferenceFile(_named(names), points, time, coordinates)


def _rising(path: Path, time: np.ndarray, count: int) -> np.ndarray:
    if time.shape != (count,) or not np.isfinite(time).all() or np.any(np.diff(time) <= 0.0):
        raise InputError(path, f"is no {count} rising numbers", place="time", remedy="the time of each frame [s]")
    return time


def _coordinates(path: Path, file: Mapping[str, np.ndarray]) -> Coordinates:
    values, names = np.asarray(file["q"], dtype=np.float64), tuple(str(n) for n in file["q_names"])
    if values.ndim != 2 or values.shape[1] != len(names):
        problem = f"{len(names)} names do not fit an array of shape {values.shape}"
        raise InputError(path, problem, place="q", remedy="(frames, names) is needed")
    return Coordinates(names, values)


def _named(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(landmark_name(name) or name for name in names)


_READERS: dict[str, Callable[[Path], ReferenceFile]] = {".npz": _npz, ".trc": _trc, ".mot": _mot}
