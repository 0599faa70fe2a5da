"""The rows of a manifest, read: values by column, faults beside."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError
from kinemode.batches.columns import CLIPS, SUBJECT, Column, cell_value, columns, existing
from kinemode.batches.tables import FaultList, TableRow
from kinemode.request import USUAL_SUBJECT

_BARE = re.compile(r"[\w:-]+")


@dataclass(frozen=True)
class RowValues:
    """A row's values by column, as JSON has them.

    places: where each column is given, also those that could not be read: in the row itself, or for several. faulty:
    columns with a fault.
    """

    place: str
    values: Mapping[str, Any]
    places: Mapping[str, str]
    faulty: frozenset[str] = frozenset()

    def filled(self, others: RowValues) -> RowValues:
        """The same with the values that others have of columns that it lacks."""
        places = {column: place for column, place in others.places.items() if column not in self.places}
        values = {column: value for column, value in others.values.items() if column in places}
        faulty = self.faulty | (others.faulty & places.keys())
        return replace(self, values=values | dict(self.values), places=places | dict(self.places), faulty=faulty)

    def get(self, column: str, default: Any = None) -> Any:
        """The value of a column."""
        return self.values.get(column, default)


def row_values(row: TableRow, folder: Path, faults: FaultList) -> RowValues:
    """Every cell of a row read; faults are collected."""
    values: dict[str, Any] = {}
    faulty = set()
    for name, given in row.cells.items():
        problems: list[tuple[str, str]] = []
        value = _value(columns()[name], given, folder, problems)
        for problem, remedy in problems:
            faults.add(row.place, problem, remedy, column=name)
            faulty.add(name)
        if value is not None:
            values[name] = value
    return RowValues(row.place, values, dict.fromkeys(row.cells, row.place), frozenset(faulty))


def _value(column: Column, given: Any, folder: Path, problems: list[tuple[str, str]]) -> Any:
    def say(problem: str, remedy: str) -> None:
        problems.append((problem, remedy))

    value = cell_value(column, given, folder, say)
    if column.name != SUBJECT or value is None or is_built_in(value) or _is_robot(value):
        return value
    if not _BARE.fullmatch(value) or os.path.exists(folder / value):
        return existing(value, folder, say)
    try:
        from humanoid.subject.subject import load_subject

        load_subject(value)
    except InputError as error:
        say(f"there is no subject {value!r}", error.remedy)
    return value


@cache
def is_built_in(subject: str) -> bool:
    """Whether a subject is one of those that are fitted to a person by default."""
    if subject == USUAL_SUBJECT:
        return True  # most are, and the others take a second to look up
    if not _BARE.fullmatch(subject):
        return False
    from humanoid.subject.subject import BUILT_IN

    return subject in BUILT_IN


@cache
def _is_robot(subject: str) -> bool:
    from humanoid.subject.example_robots import PREFIX, find

    if not subject.startswith(PREFIX):
        return False
    try:
        find(subject)
    except InputError:
        return False  # errors are reported where it is loaded
    return True


def files_of(row: RowValues) -> list[Path]:
    """The clips of a row, or its keypoint files, or files of points, where there are none."""
    return [_path(text) for text in row.get(CLIPS) or row.get("keypoints") or row.get("points") or []]


def _path(text: str) -> Path:
    return Path(text) if os.path.exists(text) else Path(text.partition("=")[2] or text)
