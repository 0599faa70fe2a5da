"""Reference motions to compare a run with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import UPS
from estimator.data.formats.angle_files import AngleFile, read_angle_csv, read_opensim_angles
from estimator.data.formats.c3d import read_c3d
from estimator.data.formats.markers import check_spread, named_points, output_kind, outputs_note
from estimator.data.formats.npz import read_npz
from estimator.data.formats.opensim import Coordinates, MarkerFile, frame_rate, read_trc
from estimator.data.formats.point_arrays import checked_points, checked_rate, name_list, number_array, rising_times
from humanoid.subject.landmarks import landmark_name
from humanoid.support.errors import InputError, shown

_KEYS = (("landmarks", "landmark_names"), ("points", "names"))


class ReferenceFile(NamedTuple):
    """Content of a reference file.

    names (L), points (T, L, 3): landmarks in the world [m], NaN where missing; none where there are angles alone.
    time (T,) [s]: of each frame. coordinates: joint angles, None where there are none. upright: whether z, as read,
    points up in files of this kind; otherwise its world is the cameras'. markers: of a file of markers, the marker of
    each landmark that has another name there; None for other files. notes: remarks.
    """

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray
    coordinates: Coordinates | None = None
    upright: bool = False
    markers: Mapping[str, tuple[str, ...]] | None = None
    notes: tuple[str, ...] = ()


def load_reference(path: str | Path, *, up: str | None = None) -> ReferenceFile:
    """Landmarks, joint angles or both.

    Reads kinemode's own npz export and the truth of a rendered clip, an npz with `points`, `names` and `fps`, TRC and
    C3D; joint angles in MOT, STO and csv, see `estimator.data.formats.angle_files`. Landmark names of other programs
    become ours where there is one, and stay as they are otherwise; of markers (TRC, C3D) those that are joint centres
    do, see `estimator.data.formats.markers`.

    up: the axis of the world of a TRC or C3D file that points up; by default y for TRC, and the file's own for C3D.

    Raises
    ------
    InputError: missing, of another kind, with arrays of the wrong shape, or impossible points or rate; `up` is not an
        axis, or the file is not of markers.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "no such file")
    kind = path.suffix.lower()
    if kind not in _READERS:
        raise InputError(path, "is not a reference", remedy=f"one of {', '.join(_READERS)} is needed")
    if up is None:
        return _READERS[kind](path)
    if up not in UPS:
        raise InputError("up", f"{shown(up)} is not an axis", remedy=f"one of {', '.join(UPS)}")
    if kind not in _OF_MARKERS:
        raise InputError("up", f"is of the world of markers ({', '.join(_OF_MARKERS)})", remedy="leave it out")
    return _markers(path, _OF_MARKERS[kind](path, up))


def _markers(path: Path, file: MarkerFile) -> ReferenceFile:
    kept = [i for i, name in enumerate(file.names) if output_kind(name) is None]
    outputs = outputs_note(file.names)
    file = file._replace(names=tuple(file.names[i] for i in kept), points=file.points[:, kept])
    if file.points.size == 0:
        raise InputError(path, "has no points")
    time = rising_times(path, file.time, len(file.points))
    checked_rate(path, frame_rate(time))
    points = checked_points(path, file.points)
    check_spread(points, file.unit, path)
    named = named_points(file.names, points)
    notes = (*file.notes, f"{path.name}: {outputs}") if outputs else file.notes
    return ReferenceFile(named.names, named.points, time, None, True, named.sources, notes)


def _angles(path: Path, file: AngleFile) -> ReferenceFile:
    count = len(file.time)
    if file.coordinates.values.size == 0:
        raise InputError(path, "has no coordinates")
    time = rising_times(path, file.time, count)
    return ReferenceFile((), np.zeros((count, 0, 3)), time, file.coordinates, notes=file.notes)


def _npz(path: Path) -> ReferenceFile:
    arrays = read_npz(path)
    keys = next((k for k in _KEYS if k[0] in arrays and k[1] in arrays), None)
    coordinates = _coordinates(path, arrays) if "q" in arrays and "q_names" in arrays else None
    if keys is None and coordinates is None:
        wanted = " or ".join(f"{a}, {b}" for a, b in (*_KEYS, ("q", "q_names")))
        problem = "has neither landmarks nor joint angles"
        raise InputError(path, problem, remedy=f"arrays {wanted}; found {', '.join(arrays)}")
    names, points = ((), np.zeros((0, 0, 3))) if keys is None else _landmarks(path, arrays, *keys)
    if coordinates is not None:
        points = np.zeros((len(coordinates.values), 0, 3)) if keys is None else points
        if len(coordinates.values) != len(points):
            raise InputError(path, f"has {len(coordinates.values)} frames, the landmarks {len(points)}", place="q")
    of_run = keys == _KEYS[0]  # as a run is exported
    return ReferenceFile(names, points, _times(path, arrays, len(points)), coordinates, upright=of_run)


def _landmarks(
    path: Path, arrays: Mapping[str, np.ndarray], points_key: str, names_key: str
) -> tuple[tuple[str, ...], np.ndarray]:
    points, names = number_array(arrays[points_key], path, points_key), name_list(arrays[names_key], path, names_key)
    if points.ndim != 3 or points.shape[1:] != (len(names), 3):
        problem = f"{len(names)} names do not fit an array of shape {points.shape}"
        raise InputError(path, problem, place=points_key, remedy="(frames, names, 3) is needed")
    if points.size == 0:
        raise InputError(path, "has no points")
    return _named(names), checked_points(path, points)


def _coordinates(path: Path, arrays: Mapping[str, np.ndarray]) -> Coordinates:
    values, names = number_array(arrays["q"], path, "q"), name_list(arrays["q_names"], path, "q_names")
    if values.ndim != 2 or values.shape[1] != len(names):
        problem = f"{len(names)} names do not fit an array of shape {values.shape}"
        raise InputError(path, problem, place="q", remedy="(frames, names) is needed")
    return Coordinates(names, values)


def _times(path: Path, arrays: Mapping[str, np.ndarray], count: int) -> np.ndarray:
    """Time (T,) [s] of each frame, by their rate or one by one."""
    if "fps" not in arrays and "time" in arrays:
        return rising_times(path, number_array(arrays["time"], path, "time"), count)
    rate = number_array(arrays.get("fps", np.array(frame_rate(np.zeros(0)))), path, "fps")
    if rate.size != 1:
        raise InputError(path, "one number is needed", place="fps")
    return np.arange(count) / checked_rate(path, float(rate.reshape(())))


def _named(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(landmark_name(name) or name for name in names)


_OF_MARKERS: dict[str, Callable[..., MarkerFile]] = {".trc": read_trc, ".c3d": read_c3d}
_READERS: dict[str, Callable[[Path], ReferenceFile]] = {
    ".npz": _npz,
    ".trc": lambda path: _markers(path, read_trc(path)),
    ".c3d": lambda path: _markers(path, read_c3d(path)),
    ".mot": lambda path: _angles(path, read_opensim_angles(path)),
    ".sto": lambda path: _angles(path, read_opensim_angles(path)),
    ".csv": lambda path: _angles(path, read_angle_csv(path)),
}
