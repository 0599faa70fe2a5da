"""The manifest of a batch: read whole, and refused whole with every fault that is in it."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError, shown
from humanoid.support.files import read_bytes
from kinemode.batches.checks import check_row, track_arguments
from kinemode.batches.columns import CLIPS, NAME, PERSON, REFERENCE, SUBJECT
from kinemode.batches.faults import FaultList
from kinemode.batches.people import fitting_rows, with_people
from kinemode.batches.row import LONGEST_NAME, BatchRow, fitting_name
from kinemode.batches.tables import ManifestTable, csv_table, mapped_row, text_of, toml_table
from kinemode.batches.values import RowValues, files_of, row_values
from kinemode.request import USUAL_SUBJECT

_NAME = re.compile(rf"(?!\.)[\w.-]{{1,{LONGEST_NAME}}}")
_TABLES = {".csv": csv_table, ".toml": toml_table}
_BYTES = 200  # of a name: letters may take four, and a file's name may have 255


def read_manifest(path: str | Path) -> tuple[BatchRow, ...]:
    """The clips of a manifest, a CSV or TOML file; relative paths in it start in its folder.

    Columns are name, clips, person (who it is), fits (whether that person's subject is fitted from this clip), subject,
    reference, person_id (`track --person`), and every option of `kinemode track`, with - or _. An empty cell is not
    given. In CSV (commas, semicolons or tabs) a cell has several files with spaces between them, a name that has some
    in "quotation marks". In TOML a clip is a table [[clip]]; [defaults] holds for clips without a value of their own,
    [people.NAME] has subject and height of a person.

    Raises
    ------
    ManifestError: with all faults of all rows.
    """
    path = Path(path)
    faults = FaultList(str(path))
    table = _TABLES.get(path.suffix.lower())
    if table is None:
        problem = f"{shown(path.suffix)} is not the ending of a manifest"
        raise faults.with_last("", problem, "give a .csv or a .toml file")
    try:
        content = read_bytes(path, remedy="kinemode batch --make FOLDER writes one")
    except InputError as error:
        raise faults.with_last("", error.problem, error.remedy) from None
    return _rows(table(text_of(content, faults), faults), path.absolute().parent, faults)


def rows_of(
    mappings: Sequence[Mapping[str, Any]], *, folder: str | Path | None = None, source: str = "clips"
) -> tuple[BatchRow, ...]:
    """The clips that a program names, one mapping each, whose keys are the columns of `read_manifest`; folder: where
    relative paths start, the working directory unless given. source: what faults name.

    Raises
    ------
    ManifestError: with all faults of all rows.
    """
    faults = FaultList(source)
    rows = [mapped_row(mapping, f"row {i}", faults) for i, mapping in enumerate(mappings, 1)]
    return _rows(ManifestTable(rows), Path(folder or ".").absolute(), faults)


def _rows(table: ManifestTable, folder: Path, faults: FaultList) -> tuple[BatchRow, ...]:
    if not table.rows and not faults:
        faults.add("", "lists no clips", "a row for each, below a head of columns; in TOML a table [[clip]]")
    defaults = row_values(table.defaults, folder, faults)
    people = {name: row_values(row, folder, faults) for name, row in table.people.items()}
    given = [row_values(row, folder, faults) for row in table.rows]
    rows = with_people(given, people, defaults, faults)
    names = _names(rows, faults)
    fitting = fitting_rows(rows, faults)
    for row in rows:
        check_row(row, faults)
    faults.check()
    return tuple(_row(name, row, i in fitting) for i, (name, row) in enumerate(zip(names, rows, strict=True)))


def _row(name: str, row: RowValues, fits: bool) -> BatchRow:
    return BatchRow(
        name=name,
        place=row.place,
        person=row.get(PERSON, ""),
        fits=fits,
        subject=row.get(SUBJECT, USUAL_SUBJECT),
        clips=tuple(row.get(CLIPS, ())),
        options=track_arguments(row),
        reference=row.get(REFERENCE),
    )


def _names(rows: Sequence[RowValues], faults: FaultList) -> list[str]:
    """The name of each row; names that are no folder's, or that two rows have, are faults."""
    names = [row.get(NAME) or _derived(row) for row in rows]
    places: dict[str, tuple[str, str]] = {}
    for row, name in zip(rows, names, strict=True):
        if not name:
            if not row.faulty:
                faults.add(row.place, "has no name, and its files suggest none", "give it one", column=NAME)
            continue
        if not _NAME.fullmatch(name) or len(name.encode()) > _BYTES:
            remedy = f"at most {LONGEST_NAME} letters, digits, . _ and -, not with a . at the beginning"
            faults.add(row.place, f"{shown(name)} is no name for a folder", remedy, column=NAME)
            continue
        folded = unicodedata.normalize("NFC", name).casefold()  # some disks keep a and A apart, some do not
        place, first = places.setdefault(folded, (row.place, name))
        if place != row.place:
            same = "" if first == name else f" but for case or accents ({shown(first)})"
            faults.add(row.place, f"{place} has the name {shown(name)} too{same}", "give each its own", column=NAME)
    return names


def _derived(row: RowValues) -> str:
    """The stem of the only file, or the name of the folder that all files are in."""
    files = files_of(row)
    if not files:
        return ""
    parents = {file.parent for file in files}
    name = (files[0].name if os.path.isdir(files[0]) else files[0].stem) if len(files) == 1 else ""
    if len(files) > 1 and len(parents) == 1:
        name = parents.pop().name
    return fitting_name(name)
