"""The manifest of a batch: its rows, the people in its clips, read whole, and refused whole with every fault that is in
it.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError, nearest, shown
from humanoid.support.files import read_bytes
from kinemode.batches.checks import check_row, track_arguments
from kinemode.batches.columns import CLIPS, FITS, NAME, PERSON, PERSON_ID, REFERENCE, SUBJECT
from kinemode.batches.tables import OF_PEOPLE, FaultList, ManifestTable, csv_table, mapped_row, text_of, toml_table
from kinemode.batches.values import RowValues, files_of, is_built_in, row_values
from kinemode.inputs.declared import wants_all
from kinemode.request import USUAL_SUBJECT

LONGEST_NAME = 100
_UNFIT = re.compile(r"[^\w.-]+")


@dataclass(frozen=True)
class BatchRow:
    """One clip: a recording by one or several cameras.

    Attributes
    ----------
    name: unique, and fit for a folder: letters, digits, dots, underscores and hyphens, at most 100 characters.
    place: where it is in the manifest, for messages: "row 3", the line of a CSV file, or of TOML the third [[clip]].
    person: the person in the clip, "" where unknown.
    fits: whether the person's subject is fitted from this clip.
    subject: a built-in name or the absolute path of a URDF, as `kinemode.track` takes it.
    clips: absolute paths or NAME=PATH texts; none where the keypoints are enough.
    options: the other keyword arguments of `kinemode.track` that were given, as values that JSON knows; absolute paths.
    reference: absolute path of known landmarks or joint angles, as `kinemode.evaluate` takes them.
    """

    name: str
    place: str
    person: str = ""
    fits: bool = False
    subject: str = "human34"
    clips: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    reference: str | None = None


def fitting_name(text: str) -> str:
    """The name of a clip that is nearest to a text: a part of it and underscores, empty where it has no letter."""
    return _UNFIT.sub("_", text).lstrip(".")[:LONGEST_NAME]


def with_people(
    rows: Sequence[RowValues], people: Mapping[str, RowValues], defaults: RowValues, faults: FaultList
) -> list[RowValues]:
    """Rows with what is given for their persons, then for all; rows that disagree are faults."""
    persons = [row.get(PERSON, defaults.get(PERSON, "")) for row in rows]
    by_person: dict[str, list[RowValues]] = defaultdict(list)
    for row, person in zip(rows, persons, strict=True):
        if person:
            by_person[person].append(row)
    for name, known_rows in people.items():
        if name not in by_person:
            faults.add(known_rows.place, f"no clip is of the person {shown(name)}", nearest(name, by_person, "persons"))
    known = {
        person: _known([*([people[person]] if person in people else []), *theirs], person, faults)
        for person, theirs in by_person.items()
    }
    of_persons = [row.filled(known[person]) if person else row for row, person in zip(rows, persons, strict=True)]
    return [row.filled(defaults) for row in of_persons]


def _known(rows: Sequence[RowValues], person: str, faults: FaultList) -> RowValues:
    """Subject and height of a person, by the first row that has them."""
    known: dict[str, tuple[Any, str]] = {}
    for row in rows:
        for column in OF_PEOPLE:
            if column not in row.values or column in row.faulty:
                continue
            value, place = known.setdefault(column, (row.values[column], row.place))
            if value != row.values[column]:
                problem = f"{shown(row.values[column])} for {shown(person)}, for whom {place} has {shown(value)}"
                faults.add(row.place, problem, "give the same, or name two persons", column=column)
    values = {column: value for column, (value, _) in known.items()}
    return RowValues("", values, {column: place for column, (_, place) in known.items()})


def fitting_rows(rows: Sequence[RowValues], faults: FaultList) -> set[int]:
    """Indices of the rows from which the subjects of their persons are fitted: the named row of each, or the first that
    may be; subjects from files are taken as measured and not fitted."""
    by_person: dict[str, list[int]] = defaultdict(list)
    for i, row in enumerate(rows):
        person = row.get(PERSON, "")
        if person:
            by_person[person].append(i)
        elif row.get(FITS):
            faults.add(row.place, "is for clips of a person", "name the person in the column person", column=FITS)
        if person and wants_all(row.get(PERSON_ID)):
            problem = f"is all people in the clip, and the column person has {shown(person)}"
            faults.add(row.place, problem, "leave one of them empty", column=PERSON_ID)
    return {i for indices in by_person.values() for i in _fitting(rows, indices, faults)}


def _fitting(rows: Sequence[RowValues], indices: Sequence[int], faults: FaultList) -> list[int]:
    """The row that a person is fitted from, in a list; none where there is none."""
    named = [i for i in indices if rows[i].get(FITS)]
    for i in named[1:]:
        problem = f"{shown(rows[i].get(PERSON))} is fitted from {rows[named[0]].place} already"
        faults.add(rows[i].place, problem, "yes may be in a single row of a person", column=FITS)
    for i in named[:1]:
        if (why := _never(rows[i])) is not None:
            faults.add(rows[i].place, why, "leave it empty", column=FITS)
    if named:
        return named[:1]
    return [i for i in indices if FITS not in rows[i].places and _never(rows[i]) is None][:1]


def _never(row: RowValues) -> str | None:
    """Why a row's subject is not fitted, None where it may be."""
    subject = row.get(SUBJECT, USUAL_SUBJECT)
    if not is_built_in(subject):
        return f"the subject {shown(subject)} is taken as measured"
    return "fit is off" if row.get("fit") == "off" else None


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
    """The name of each row; names that are not valid folders, or that two rows have, are faults."""
    names = [row.get(NAME) or _derived(row) for row in rows]
    places: dict[str, tuple[str, str]] = {}
    for row, name in zip(rows, names, strict=True):
        if not name:
            if not row.faulty:
                faults.add(row.place, "has no name, and its files suggest none", "give it one", column=NAME)
            continue
        if not _NAME.fullmatch(name) or len(name.encode()) > _BYTES:
            remedy = f"at most {LONGEST_NAME} letters, digits, . _ and -, not with a . at the beginning"
            faults.add(row.place, f"{shown(name)} is not a valid folder name", remedy, column=NAME)
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
