"""Tables of numbers with a name for each column, from csv."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.checked_json import read_text
from humanoid.support.errors import InputError, shown

TIMES = ("time_s", "time", "t", "seconds")
"""Names of a column of time [s]."""
_MOST_ROWS = 1_000_000


class NumberTable(NamedTuple):
    """names (N): of the columns. rows (T): their cells. place: where the names stand. comments: lines above the names,
    which begin with #."""

    path: Path
    names: tuple[str, ...]
    rows: list[list[str]]
    first: int
    comments: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """Place of the names, for errors."""
        return f"line {self.first}"

    @property
    def values(self) -> np.ndarray:
        """(T, N): NaN where a cell is empty or no number."""
        return np.array([[_number(cell) for cell in row] for row in self.rows]).reshape(-1, len(self.names))

    def check(self) -> None:
        """Raise InputError for names that are missing or repeated, rows that are longer or shorter, and words among
        the numbers of a column; one of words alone, as a frame's status, may be."""
        path, names, rows = self.path, self.names, self.rows
        if not names:
            raise InputError(path, "has no columns", remedy="its first line names them")
        twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
        if twice is not None or not all(names):
            problem = f"the column {shown(twice)} appears twice" if twice else "a column has no name"
            raise InputError(path, problem, place=self.place)
        if len(rows) > _MOST_ROWS:
            raise InputError(path, f"has more than {_MOST_ROWS} rows")
        for number, row in enumerate(rows, self.first + 1):
            if len(row) != len(names):
                problem = f"has {len(row)} cells, {len(names)} are expected"
                raise InputError(path, problem, place=f"line {number}")
        values = self.values
        for k in np.flatnonzero(np.isfinite(values).any(axis=0)):
            wrong = next((i for i, row in enumerate(rows) if np.isnan(values[i, k]) and not _is_empty(row[k])), None)
            if wrong is not None:
                place = f"line {self.first + 1 + wrong}, column {shown(names[k])}"
                raise InputError(path, f"{shown(rows[wrong][k])} is not a number", place=place, remedy="leave it empty")


def read_number_table(path: Path) -> NumberTable:
    """Read a csv whose first line, but for comments, names its columns; `NumberTable.check` checks its numbers.

    Raises
    ------
    InputError: it cannot be read, or is not a csv.
    """
    lines = read_text(path).splitlines(keepends=True)
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    try:
        rows = [row for row in csv.reader(io.StringIO("".join(lines[first:]), newline="")) if row]
    except csv.Error as error:
        raise InputError(path, f"is not a csv: {error}") from None
    names = tuple(cell.strip() for cell in rows[0]) if rows else ()
    return NumberTable(path, names, rows[1:], first + 1, tuple(line.strip() for line in lines[:first] if line.strip()))


def _is_empty(cell: str) -> bool:
    return cell.strip().lower() in ("", "nan")


def _number(cell: str) -> float:
    try:
        return float(cell) if cell.strip() else np.nan
    except ValueError:
        return np.nan
