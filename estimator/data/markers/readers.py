"""Points over time from files of every kind, with what each declares about them.

An array alone is a .npy of (frames, points, 3), as FreeMoCap writes them: MediaPipe's body in its order, 33 points
(`mediapipe_body_3d_xyz.npy`), or 553 with both hands and the face after it (`mediaPipeSkel_3d_body_hands_face.npy`), in
millimetres, without names, unit or times.

A csv has three columns for every point, `NAME_x`, `NAME_y`, `NAME_z`, and one of time [s] or of frames, or neither;
units follow the names (`NAME_x_mm`) or are in a line `# unit=mm` above them, as `# up=z`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import UPS
from estimator.data.formats.c3d import read_c3d
from estimator.data.formats.keypoints_names import naming_beside, places_of_names
from estimator.data.formats.npz import read_npy, read_npz
from estimator.data.formats.number_table import TIMES, NumberTable, read_number_table
from estimator.data.formats.opensim import METRES, read_trc, unit_of
from estimator.data.formats.point_arrays import name_list, number_array
from estimator.data.markers.track import PointFile
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError, first_of, shown

_FRAMES = ("frame", "frames", "frame#")
_COLUMN = re.compile(
    r"(?P<name>.*[^_.:\s])[_.:\s](?P<axis>[xyz])(?:[_\s]*[\[(]?(?P<unit>mm|cm|m|(?:milli|centi)?met(?:er|re)s?)[\])]?)?",
    re.IGNORECASE,
)
_COMMENT = re.compile(r"#\s*(?P<key>units?|up)\s*[=:]\s*(?P<value>\S+)\s*", re.IGNORECASE)


def read_point_table(path: Path) -> PointFile:
    """Read a csv with the columns NAME_x, NAME_y, NAME_z of every point (or NAME.x, NAME:X), and one of time [s]
    ("time_s", "time", "t", "seconds"), of frames ("frame") or of neither.

    Cells may be empty. Lines `# unit=mm` and `# up=z` above the names, and units behind them (NAME_x_mm), are used.
    Without times they are NaN, as is the rate, which is not given.

    Raises
    ------
    InputError: with the line; no table, points that lack an axis, or no points.
    """
    table = read_number_table(path)
    table.check()
    lower = [name.lower() for name in table.names]
    clock = next((i for names in (TIMES, _FRAMES) for i, name in enumerate(lower) if name in names), None)
    columns, unit, other = _columns(table)
    values = table.values
    points = np.stack([values[:, list(places)] for places in columns.values()], axis=1)
    said = _comments(table)
    if unit and said.get("unit", unit) != unit:
        raise InputError(path, f"columns are in {unit}, a comment declares {shown(said['unit'])}", place=table.place)
    counted = clock is None or lower[clock] in _FRAMES
    notes = (f"{path.name}: columns left out: {first_of(other, 8)}",) if other else ()
    time = np.full(len(points), np.nan) if counted else values[:, clock]
    if counted and clock is not None and not _even(values[:, clock]):
        problem = "the frames are not numbers one after the other"
        raise InputError(path, problem, place=f"column {table.names[clock]}", remedy="give a column of time instead")
    return PointFile(path, tuple(columns), points, time, unit or said.get("unit", ""), said.get("up"), notes=notes)


def _even(frames: np.ndarray) -> bool:
    return bool(np.isfinite(frames).all() and (np.diff(frames) == 1.0).all())


def _columns(table: NumberTable) -> tuple[dict[str, tuple[int, int, int]], str, list[str]]:
    """The columns x, y and z of every point, the unit in their names, and the columns that belong to no point."""
    places: dict[str, dict[str, int]] = {}
    units: set[str] = set()
    other: list[str] = []
    for i, column in enumerate(table.names):
        part = _COLUMN.fullmatch(column)
        if part is None:
            other += [column] if column.lower() not in (*TIMES, *_FRAMES) else []
            continue
        of_point, axis = places.setdefault(part["name"].strip(), {}), part["axis"].lower()
        if axis in of_point:
            problem = f"has two columns {axis} of the point {shown(part['name'])}"
            raise InputError(table.path, problem, place=table.place, remedy="rename or drop one")
        of_point[axis] = i
        units |= {unit_of(part["unit"])} if part["unit"] else set()
    if not places:
        raise InputError(table.path, "has no points", place=table.place, remedy="columns NAME_x, NAME_y and NAME_z")
    for name, axes in places.items():
        missing = [axis for axis in "xyz" if axis not in axes]
        if missing:
            raise InputError(table.path, f"the point {shown(name)} has no column {missing[0]}", place=table.place)
    if len(units) > 1:
        problem = f"has columns in {' and '.join(sorted(units))}"
        raise InputError(table.path, problem, place=table.place, remedy="write them in one unit")
    return {name: (axes["x"], axes["y"], axes["z"]) for name, axes in places.items()}, next(iter(units), ""), other


def _comments(table: NumberTable) -> dict[str, str]:
    """unit and up, where the lines above the names have them."""
    parts = [part for comment in table.comments if (part := _COMMENT.fullmatch(comment))]
    said = {part["key"].lower().removesuffix("s"): part["value"].lower() for part in parts}
    said |= {"unit": unit_of(said["unit"])} if "unit" in said else {}
    if said.get("up", "z") not in UPS:
        problem = f"{shown(said['up'])} is not an axis"
        raise InputError(table.path, problem, place="comment up", remedy=f"one of {', '.join(UPS)}")
    return said


_BODY = FORMATS["mediapipe33"]
_COUNTS = (len(_BODY), 553)  # of the body, and with 21 points of each hand and 478 of the face after it


def read_point_array(path: Path) -> PointFile:
    """Read an array of points (T, M, 3). Their names are those beside the file (`walk.names.txt`, see
    `estimator.data.formats.keypoints_names`), else MediaPipe's of 33 or 553 points; the others are left out, with a
    note.

    Raises
    ------
    InputError: no array of numbers of this shape, or of another count of points without names beside it.
    """
    points = number_array(read_npy(path), path, "")
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(path, f"has the shape {points.shape}", remedy="(frames, points, 3) is needed")
    count = points.shape[1]
    naming = naming_beside(path)
    if naming.names is not None and len(naming.names) != count:
        raise InputError(naming.source or path, f"has {len(naming.names)} names, the points are {count}")
    if naming.names is None and count not in _COUNTS:
        counts = " or ".join(map(str, _COUNTS))
        remedy = f"{counts} are MediaPipe's, as FreeMoCap writes them; name others in {places_of_names(path)}"
        raise InputError(path, f"has {count} points without names", remedy=remedy)
    time = np.full(len(points), np.nan)
    if naming.names is not None:
        return PointFile(path, naming.names, points, time)
    known = {name: i for i, name in enumerate(_BODY) if name is not None}
    others = f", {count - len(known)} that are not landmarks of the body left out"
    notes = (f"{path.name}: {count} points without names are read as MediaPipe's{others}",)
    return PointFile(path, tuple(known), points[:, list(known.values())], time, notes=notes)


UNIT_OPTION = "--unit"
"""The option by which a user gives the unit of length of a file."""
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
