"""Points over time from files of every kind, with what each declares about them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import UPS
from estimator.data.formats.c3d import read_c3d
from estimator.data.formats.npz import read_npz
from estimator.data.formats.opensim import METRES, read_trc, unit_of
from estimator.data.formats.point_arrays import name_list, number_array
from estimator.data.markers.array import read_point_array
from estimator.data.markers.table import read_point_table
from estimator.data.markers.track import PointFile
from humanoid.support.errors import InputError, shown

UNIT_OPTION = "--unit"
"""By which a user gives the unit of length of a file."""
_EXPORT = ("landmarks", "landmark_names")  # of a run: metres, z up
_KEYS = (("points", "names"), _EXPORT)


def read_points(path: Path, unit: str | None) -> PointFile:
    """The points of a TRC, C3D, npz, npy or csv file; unit: given by the user, for files without one.

    Raises
    ------
    InputError: missing, of another kind, damaged, or with arrays of the wrong shape.
    """
    kind = path.suffix.lower()
    if kind not in _READERS:
        raise InputError(path, "is not a file of points", remedy=f"one of {', '.join(_READERS)} is needed")
    if not path.is_file():
        raise InputError(path, "no such file")
    return _READERS[kind](path, unit)


def _trc(path: Path, unit: str | None) -> PointFile:
    file = read_trc(path, "z", unit, UNIT_OPTION)
    notes: tuple[str, ...] = ()
    if file.frames >= 0 and file.frames != len(file.points):
        notes = (f"{path.name} has {len(file.points)} frames, its header declares {file.frames}: is it truncated?",)
    points = file.points / METRES[file.unit]
    return PointFile(path, file.names, points, file.time, file.said_unit, None, file.rate, notes, usual_up="y")


def _c3d(path: Path, unit: str | None) -> PointFile:
    file = read_c3d(path, "z", unit, UNIT_OPTION)
    notes = (f"{path.name}: {_counted(file.unnamed)} without a name left out",) if file.unnamed > 0 else ()
    points = file.points / METRES[file.unit]
    # POINT:Y_SCREEN is how a program shows the world
    return PointFile(
        path, file.names, points, file.time, file.said_unit, None, file.rate, notes, usual_up=file.said_up or "z",
        y_or_z=True,
    )  # fmt: skip


def _counted(count: int) -> str:
    return "a point" if count == 1 else f"{count} points"


def _npz(path: Path, unit: str | None) -> PointFile:
    arrays = read_npz(path)
    keys = next((pair for pair in _KEYS if pair[0] in arrays and pair[1] in arrays), None)
    if keys is None:
        remedy = f"points (T, M, 3), names (M), and time (T) or fps; it has {', '.join(arrays) or 'nothing'}"
        raise InputError(path, "has no arrays points and names", remedy=remedy)
    points, names = number_array(arrays[keys[0]], path, keys[0]), name_list(arrays[keys[1]], path, keys[1])
    if points.ndim != 3 or points.shape[1:] != (len(names), 3):
        problem = f"{len(names)} names do not fit an array of shape {points.shape}"
        raise InputError(path, problem, place=keys[0], remedy="(frames, names, 3) is needed")
    own = keys == _EXPORT
    up = _word(arrays, "up", path) or ("z" if own else None)
    if up is not None and up not in UPS:
        raise InputError(path, f"{shown(up)} is not an axis", place="up", remedy=f"one of {', '.join(UPS)}")
    rate = number_array(arrays["fps"], path, "fps") if "fps" in arrays else np.array(np.nan)
    if rate.size != 1:
        raise InputError(path, "one number is needed", place="fps")
    time = number_array(arrays["time"], path, "time") if "time" in arrays else np.full(len(points), np.nan)
    said = unit_of(_word(arrays, "unit", path)) or ("m" if own else "")
    return PointFile(path, names, points, time, said, up, float(rate.reshape(())))


def _word(arrays: Mapping[str, np.ndarray], key: str, path: Path) -> str:
    """A text that may be there."""
    if key not in arrays:
        return ""
    array = arrays[key]
    if array.size != 1 or array.dtype.kind not in "US":
        raise InputError(path, "a word is needed", place=key)
    value = array.reshape(-1)[0]
    return (value.decode("latin-1") if isinstance(value, bytes) else str(value)).strip().lower()


def _csv(path: Path, unit: str | None) -> PointFile:
    return read_point_table(path)


def _npy(path: Path, unit: str | None) -> PointFile:
    return read_point_array(path)


_READERS: dict[str, Callable[[Path, str | None], PointFile]] = {
    ".trc": _trc, ".c3d": _c3d, ".npz": _npz, ".npy": _npy, ".csv": _csv,
}  # fmt: skip
