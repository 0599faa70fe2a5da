"""Joint coordinates over time from csv and npz, exported by kinemode or written by other programs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.checked_json import LARGEST
from estimator.data.formats.npz import read_npz
from estimator.data.formats.number_table import TIMES, read_number_table
from humanoid.support.errors import InputError

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
