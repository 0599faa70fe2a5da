"""Joint coordinates over time from csv and npz: as they are exported, or as anybody may write them."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.checked_json import LARGEST, read_text
from estimator.data.formats.npz import read_npz
from humanoid.support.errors import InputError, shown

_TIMES = ("time_s", "time", "t", "seconds")
_MOST_ROWS = 1_000_000
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
    lines = read_text(path).splitlines(keepends=True)
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    try:
        rows = [row for row in csv.reader(io.StringIO("".join(lines[first:]), newline="")) if row]
    except csv.Error as error:
        raise InputError(path, f"is no csv: {error}") from None
    names, place = ([cell.strip() for cell in rows[0]] if rows else []), f"line {first + 1}"
    clock = [i for i, name in enumerate(names) if name.lower() in _TIMES]
    if len(clock) != 1:
        problem = f"has {len(clock)} columns of time, one is needed"
        raise InputError(path, problem, place=place, remedy=f"called one of {', '.join(_TIMES)}")
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None or not all(names):
        problem = f"the column {shown(twice)} is there twice" if twice else "a column has no name"
        raise InputError(path, problem, place=place)
    if len(rows) > _MOST_ROWS:
        raise InputError(path, f"has more than {_MOST_ROWS} rows")
    for number, row in enumerate(rows[1:], first + 2):
        if len(row) != len(names):
            problem = f"has {len(row)} cells, {len(names)} are expected"
            raise InputError(path, problem, place=f"line {number}")
    values = np.array([[_number(cell) for cell in row] for row in rows[1:]]).reshape(-1, len(names))
    for k in np.flatnonzero(np.isfinite(values).any(axis=0)):  # a column of words, as a frame's status, has no number
        wrong = next((i for i, row in enumerate(rows[1:]) if np.isnan(values[i, k]) and not _is_empty(row[k])), None)
        if wrong is not None:
            place = f"line {first + 2 + wrong}, column {shown(names[k])}"
            raise InputError(path, f"{shown(rows[wrong + 1][k])} is no number", place=place, remedy="leave it empty")
    rest = [i for i in range(len(names)) if i != clock[0]]
    comments = tuple(line.strip() for line in lines[:first] if line.strip())
    return MotionTable(tuple(names[i] for i in rest), values[:, rest], values[:, clock[0]], path, comments)


def _is_empty(cell: str) -> bool:
    return cell.strip().lower() in ("", "nan")


def _number(cell: str) -> float:
    try:
        return float(cell) if cell.strip() else np.nan
    except ValueError:
        return np.nan
