"""Joint coordinates over time from files of kinemode and of other programs, which declare their units in a header or
columns.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.checked_json import LARGEST
from estimator.data.formats.npz import read_npz
from estimator.data.formats.number_table import TIMES, read_number_table
from estimator.data.formats.opensim import Coordinates, coordinate_of_path, read_mot, said_degrees
from humanoid.support.errors import InputError, first_of, shown

OF_EXPORTS = re.compile(r".*_[xyz]_m|.*_std(_.*)?|std_.*|weight|energy|status|frame")
"""Columns that exports have beside the joints, and a root's place."""


class MotionTable(NamedTuple):
    """names (N): of the columns, time aside. values (T, N): NaN where a cell is empty or no number. time (T,) [s],
    rising. source: the file. comments: lines of a csv above the names, which begin with #."""

    names: tuple[str, ...]
    values: np.ndarray
    time: np.ndarray
    source: Path
    comments: tuple[str, ...] = ()


def read_motion_table(path: Path) -> MotionTable:
    """Read a table: a csv with a column of time [s] ("time_s", "time", "t", "seconds") and one for each coordinate, or
    an npz with `q` (T, nq), `q_names` (nq) and `time` (T,). Cells may be empty, columns of words have no number.

    Raises
    ------
    InputError: with the line or the array; a word among numbers; times that do not rise; no rows.
    """
    table = _of_npz(path) if path.suffix.lower() == ".npz" else _of_csv(path)
    if not len(table.time):
        raise InputError(path, "has no rows")
    if not (np.abs(table.time) < LARGEST).all() or not (np.diff(table.time) > 0.0).all():
        at = int(np.argmin(np.diff(table.time) > 0.0)) + 1 if len(table.time) > 1 else 0
        raise InputError(path, "the times are not all numbers that rise", place=f"row {at}")
    return table


def _of_npz(path: Path) -> MotionTable:
    arrays = read_npz(path)
    missing = [name for name in ("q", "q_names", "time") if name not in arrays]
    if missing:
        remedy = "q (T, nq), q_names (nq) and time (T,), as `kinemode export` writes them"
        raise InputError(path, f"has no array {missing[0]}", remedy=remedy)
    q, names, time = arrays["q"], arrays["q_names"], arrays["time"]
    sound = q.dtype.kind in "iuf" and time.dtype.kind in "iuf" and names.dtype.kind == "U"
    if not sound or q.ndim != 2 or names.shape != q.shape[1:] or time.shape != q.shape[:1]:
        problem = f"q is {q.dtype} {q.shape}, q_names {names.dtype} {names.shape}, time {time.dtype} {time.shape}"
        raise InputError(path, problem, remedy="(T, nq), (nq) and (T,)")
    return MotionTable(tuple(names.tolist()), q.astype(np.float64), time.astype(np.float64), path)


def _of_csv(path: Path) -> MotionTable:
    table = read_number_table(path)
    clock = [i for i, name in enumerate(table.names) if name.lower() in TIMES]
    if len(clock) != 1:
        problem = f"has {len(clock)} columns of time, one is needed"
        raise InputError(path, problem, place=table.place, remedy=f"called one of {', '.join(TIMES)}")
    table.check()
    rest = [i for i in range(len(table.names)) if i != clock[0]]
    values = table.values
    return MotionTable(tuple(table.names[i] for i in rest), values[:, rest], values[:, clock[0]], path, table.comments)


_TURN = 2.0 * np.pi
_NO_ANGLE = re.compile(r".*_([tvpm]?[xyz]|cos|sin|q[wxyz])")  # lengths, and forces of plates
_TO_DEGREES = {"_rad": 180.0 / np.pi, "_deg": 1.0}
_TO_METRES = {"_m": 1.0, "_cm": 1e-2, "_mm": 1e-3}


class AngleFile(NamedTuple):
    """coordinates, their time (T,) [s], and notes."""

    coordinates: Coordinates
    time: np.ndarray
    notes: tuple[str, ...] = ()


def read_opensim_angles(path: Path) -> AngleFile:
    """The coordinates of a mot or sto, see `read_mot`; where its header has no inDegrees they are radians, as in
    OpenSim.

    Raises
    ------
    InputError: as `read_mot`; a header without inDegrees, and an angle beyond 2 pi.
    """
    coordinates, time = read_mot(path)
    if coordinates.in_degrees is not None:
        return AngleFile(coordinates, time)
    if _beyond_a_turn(coordinates):
        problem = "does not declare whether its angles are degrees or radians, and some exceed 2 pi"
        raise InputError(path, problem, place="header", remedy="add a line inDegrees=yes or inDegrees=no")
    note = "the header of the reference has no inDegrees: its angles are read as radians, as in OpenSim"
    return AngleFile(coordinates._replace(in_degrees=False), time, (note,))


def read_angle_csv(path: Path) -> AngleFile:
    """The joint coordinates of a csv: `read_motion_table`, with a column for each coordinate, named after our joint or
    as in OpenSim's gait models.

    The unit of angles is that of their column (`_deg` or `_rad` behind its name), otherwise that of a line `#
    inDegrees=yes` or `# inDegrees=no` above the names, and without either degrees. Other columns of exports, and
    columns without a number, are ignored.

    Raises
    ------
    InputError: no table, nothing but time; angles without a declared unit that could be radians, as none is beyond 2
        pi.
    """
    table = read_motion_table(path)
    said = said_degrees(path, [comment.lstrip("#") for comment in table.comments])
    in_degrees = said is not False
    columns: dict[str, np.ndarray] = {}
    unsaid: list[str] = []
    for column, values in zip(table.names, table.values.T, strict=True):
        name = coordinate_of_path(column)
        if name is None or OF_EXPORTS.fullmatch(column) or not np.isfinite(values).any():
            continue
        end = next((end for end in (*_TO_DEGREES, *_TO_METRES) if name.endswith(end)), "")
        name = name.removesuffix(end)
        if name in columns:
            raise InputError(path, f"{shown(name)} appears twice", place=f"column {shown(column)}")
        if end in _TO_DEGREES:
            values = values * _TO_DEGREES[end] / (1.0 if in_degrees else _TO_DEGREES["_rad"])
        elif not end and not _NO_ANGLE.fullmatch(name):
            unsaid.append(name)
        columns[name] = values * _TO_METRES.get(end, 1.0)
    values = np.array(list(columns.values())).reshape(len(columns), len(table.time)).T
    coordinates = Coordinates(tuple(columns), values, in_degrees)
    if said is None and unsaid and not _beyond_a_turn(coordinates, unsaid):
        problem = f"angles may be degrees or radians: none exceeds 2 pi of {first_of(unsaid, 3)}"
        raise InputError(path, problem, remedy="add a line '# inDegrees=yes' or '# inDegrees=no' above the names")
    return AngleFile(coordinates, table.time)


def _beyond_a_turn(coordinates: Coordinates, names: Sequence[str] | None = None) -> bool:
    """Whether an angle, of all columns or of these, is larger than radians of a joint are."""
    chosen = [k for k, n in enumerate(coordinates.names) if (n in names if names else not _NO_ANGLE.fullmatch(n))]
    return bool((np.abs(coordinates.values[:, chosen]) > _TURN).any())
