"""Manifest files as tables: CSV as programs write it, and TOML; and all faults of a manifest, gathered."""

from __future__ import annotations

import csv
import io
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError, shown
from kinemode.batches.columns import CLIPS, FITS, NAME, SUBJECT, column_of, is_given, unknown


class ManifestError(InputError):
    """An unusable manifest: no clip of it was started.

    Its message is a line for the manifest and one for each fault, of at most 500 characters each.

    Attributes
    ----------
    faults:
        Everything that is wrong, in the order of the manifest; `place` is the row, and the column where it is one.
    """

    def __init__(self, source: str | Path, faults: Sequence[InputError]) -> None:
        self.faults = tuple(faults)
        count = f"{len(self.faults)} fault{'' if len(self.faults) == 1 else 's'}"
        super().__init__(source, f"{count}, nothing was started")
        self.args = ("\n".join([str(self), *(f"  {_without_source(fault)}" for fault in self.faults)]),)

    def __reduce__(self) -> tuple[object, ...]:
        return ManifestError, (self.source, self.faults)


def _without_source(fault: InputError) -> str:
    """The message of a fault below a line that names the manifest."""
    if not fault.place:
        return str(InputError("the file", fault.problem, remedy=fault.remedy))
    return str(InputError(fault.place, fault.problem, remedy=fault.remedy))


class FaultList:
    """The faults of one manifest, collected while it is read."""

    def __init__(self, source: str) -> None:
        self.source = source
        self._faults: dict[tuple[str, str], InputError] = {}

    def add(self, place: str, problem: str, remedy: str = "", column: str = "") -> None:
        """Note a fault of a row, or of a column in it."""
        where = ", ".join(part for part in (place, f"column {column}" if column else "") if part)
        fault = InputError(self.source, problem, place=where, remedy=remedy)
        self._faults.setdefault((where, problem), fault)  # a fault of all rows is listed once

    def with_last(self, place: str, problem: str, remedy: str) -> ManifestError:
        """The error of all faults and of one that nothing can be read after."""
        self.add(place, problem, remedy)
        return self.error()

    def error(self) -> ManifestError:
        """The error of all faults, by row."""
        return ManifestError(self.source, sorted(self._faults.values(), key=_row_number))

    def check(self) -> None:
        """Raise ManifestError where there is any fault."""
        if self:
            raise self.error()

    def __bool__(self) -> bool:
        return bool(self._faults)


def _row_number(fault: InputError) -> int:
    """The row number of a fault, 0 for a fault of all rows."""
    row = re.match(r"row (\d+)", fault.place)
    return int(row[1]) if row else 0


if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

OF_PEOPLE = (SUBJECT, "height")
"""Keys that a manifest may have once for a person, for all of that person's clips."""
_OF_A_CLIP = (NAME, CLIPS, FITS)
_SEPARATORS = ",;\t"
_LINE = re.compile(r"\(at (line \d+), column \d+\)$")


@dataclass(frozen=True)
class TableRow:
    """Cells by the names of their columns, only those with a value. place: for messages."""

    place: str
    cells: Mapping[str, Any]


@dataclass(frozen=True)
class ManifestTable:
    """The rows of a manifest. defaults: cells for rows that lack them. people: cells by person."""

    rows: list[TableRow]
    defaults: TableRow = TableRow("[defaults]", {})
    people: Mapping[str, TableRow] = field(default_factory=dict)


def text_of(content: bytes, faults: FaultList) -> str:
    """The text of a file; raises ManifestError with the line where it is not UTF-8."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        remedy = 'save the file in UTF-8; Excel calls that "CSV UTF-8"'
        raise faults.with_last(f"line {line}", "is not in UTF-8", remedy) from None


def csv_table(text: str, faults: FaultList) -> ManifestTable:
    """The table of a CSV file with commas, semicolons or tabs, whichever its head has most of."""
    lines = list(io.StringIO(text, newline=""))
    head_line = next((line for line in lines if line.strip()), "")
    separator = max(_SEPARATORS, key=re.sub('"[^"]*"', "", head_line).count)
    reader = csv.reader(lines, delimiter=separator, strict=True, skipinitialspace=True)
    head: list[str | None] | None = None
    rows: list[TableRow] = []
    line = 1
    try:
        for cells in reader:
            place, line = f"row {line}", reader.line_num + 1
            if not any(map(is_given, cells)):
                continue
            if head is None:
                head = _head(cells, place, faults)
            else:
                rows.append(_csv_row(cells, head, place, faults))
    except csv.Error as error:
        faults.add(f"row {line}", f"is not CSV: {error}", "quotation marks come in pairs, around a whole cell")
    return ManifestTable(rows)


def _head(cells: list[str], place: str, faults: FaultList) -> list[str | None]:
    """Names of the columns, None of those that are not known; a column without a name is "": it may be empty."""
    head: list[str | None] = []
    for written in cells:
        column = column_of(written)
        if is_given(written) and column is None:
            faults.add(place, *unknown(written))
        elif column is not None and column.name in head:
            faults.add(place, "appears twice", "keep one of them", column=column.name)
        head.append("" if not is_given(written) else None if column is None or column.name in head else column.name)
    return head


def _csv_row(cells: list[str], head: list[str | None], place: str, faults: FaultList) -> TableRow:
    nameless = [cell for cell, name in zip(cells, head, strict=False) if name == "" and is_given(cell)]
    beyond = [cell for cell in cells[len(head) :] if is_given(cell)]
    if beyond:
        problem = f"has {len(cells)} cells, the head has {len(head)}: {shown(beyond[0])} has no column"
        faults.add(place, problem, "put a cell that contains the separator in quotation marks")
    elif nameless:
        faults.add(place, f"{shown(nameless[0])} is in a column without a name", "name the column in the head")
    return TableRow(place, {name: cell for name, cell in zip(head, cells, strict=False) if name and is_given(cell)})


def toml_table(text: str, faults: FaultList) -> ManifestTable:
    """The table of a TOML file: [[clip]] for each, [defaults] for all, [people.NAME] for those of a person."""
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        line = _LINE.search(str(error))
        faults.add(line[1] if line else "", f"is not TOML: {error}", "a clip is a table [[clip]], see toml.io")
        return ManifestTable([])
    for name in content.keys() - {"clip", "defaults", "people"}:
        faults.add("", f"there is no {shown(name)}", "[[clip]] for each clip, [defaults] and [people.NAME] are taken")
    clips, defaults, people = content.get("clip", []), content.get("defaults", {}), content.get("people", {})
    if not (isinstance(clips, list) and all(isinstance(clip, dict) for clip in clips)):
        faults.add("", "clip is not a list of tables", "write [[clip]] above each")
        clips = []
    if not isinstance(defaults, dict) or not isinstance(people, dict):
        faults.add("", "defaults and people are tables", "write [defaults], [people.NAME]")
        defaults, people = {}, {}
    rows = [mapped_row(clip, f"row {i}", faults) for i, clip in enumerate(clips, 1)]
    of_people = {name: mapped_row(cells, f"[people.{name}]", faults, only=OF_PEOPLE) for name, cells in people.items()}
    return ManifestTable(
        rows, mapped_row(defaults, ManifestTable.defaults.place, faults, without=_OF_A_CLIP), of_people
    )


def mapped_row(
    cells: Any, place: str, faults: FaultList, *, only: tuple[str, ...] = (), without: tuple[str, ...] = ()
) -> TableRow:
    """A row from a mapping of names, as they are written, to values. only, without: what it may have, or not."""
    if not isinstance(cells, Mapping):
        faults.add(place, f"is of type {type(cells).__name__}", "a mapping of columns to values is taken")
        return TableRow(place, {})
    row: dict[str, Any] = {}
    for written, value in cells.items():
        column = column_of(str(written))
        if column is None:
            faults.add(place, *unknown(str(written)))
        elif (only and column.name not in only) or column.name in without:
            wanted = f"{' and '.join(only)} may stand here" if only else "it is of a clip: give it there"
            faults.add(place, "does not stand here", wanted, column=column.name)
        elif column.name in row:
            faults.add(place, "appears twice", "keep one of them", column=column.name)
        elif is_given(value):
            row[column.name] = value
    return TableRow(place, row)
