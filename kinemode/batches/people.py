"""Who is in the clips of a batch: what is given for a person holds for all of that person's clips."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from humanoid.support.errors import shown
from humanoid.support.near_names import nearest
from kinemode.batches.columns import FITS, PERSON, PERSON_ID, SUBJECT
from kinemode.batches.faults import FaultList
from kinemode.batches.tables import OF_PEOPLE
from kinemode.batches.values import RowValues, is_built_in
from kinemode.inputs.declared import wants_all
from kinemode.request import USUAL_SUBJECT


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
    may be; nobody is fitted whose subject is a file, which is taken as measured."""
    by_person: dict[str, list[int]] = defaultdict(list)
    for i, row in enumerate(rows):
        person = row.get(PERSON, "")
        if person:
            by_person[person].append(i)
        elif row.get(FITS):
            faults.add(row.place, "is for clips of a person", "name the person in the column person", column=FITS)
        if person and wants_all(row.get(PERSON_ID)):
            problem = f"is everybody in the clip, and the column person has {shown(person)}"
            faults.add(row.place, problem, "leave one of them empty", column=PERSON_ID)
    return {i for indices in by_person.values() for i in _fitting(rows, indices, faults)}


def _fitting(rows: Sequence[RowValues], indices: Sequence[int], faults: FaultList) -> list[int]:
    """The row that a person is fitted from, in a list; none where there is none."""
    named = [i for i in indices if rows[i].get(FITS)]
    for i in named[1:]:
        problem = f"{shown(rows[i].get(PERSON))} is fitted from {rows[named[0]].place} already"
        faults.add(rows[i].place, problem, "yes stands in a single row of a person", column=FITS)
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
