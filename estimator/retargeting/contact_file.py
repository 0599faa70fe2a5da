"""Contacts that a user knows: a csv of when points of the feet stand, as `kinemode contact --out` writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.data.formats.number_table import TIMES, read_number_table
from estimator.retargeting.contacts import SourceContacts
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.stances import SIDES_PARTS
from humanoid.support.errors import InputError

_STANDS, _SECONDS = " stands", "time [s]"
_SURE = 0.5


def load_standing(path: str | Path, source: SourceMotion) -> dict[str, np.ndarray]:
    """Whether each point of the soles stands (T,) bool, by its name, at a source's frames: as in the file's row that is
    nearest in time.

    The file has a column of times [s] and one or more as "left_heel stands", or "left_heel", of probabilities or 0 and
    1.

    Raises
    ------
    InputError: it cannot be read, has no such columns, or ends before the source does.
    """
    path = Path(path)
    table = read_number_table(path)
    table.check()
    time = next((name for name in table.names if name in (_SECONDS, *TIMES)), None)
    columns = {name.removesuffix(_STANDS): k for k, name in enumerate(table.names)}
    known = [name for name in SIDES_PARTS if name in columns]
    if time is None or not known or not table.rows:
        remedy = f"a column {_SECONDS} and some of {', '.join(SIDES_PARTS)}"
        raise InputError(path, "has no contacts", place=table.place, remedy=remedy)
    values, at = table.values, table.values[:, table.names.index(time)]
    if not (np.diff(at) > 0.0).all() or at[0] > source.times[0] + _SURE or at[-1] < source.times[-1] - _SURE:
        problem = f"its times go from {at[0]:g} to {at[-1]:g} s, the source's from {source.times[0]:g}"
        raise InputError(path, f"{problem} to {source.times[-1]:g}", remedy="contacts of the same motion, in order")
    nearest = np.abs(source.times[:, None] - at).argmin(axis=1)
    return {name: values[nearest, columns[name]] > _SURE for name in known}


def with_standing(contacts: SourceContacts, given: Mapping[str, np.ndarray]) -> SourceContacts:
    """Contacts with what a user knows of some points in place of what was found."""
    standing = contacts.standing.copy()
    for k, name in enumerate(contacts.names):
        if name in given:
            standing[:, k] = given[name]
    return replace(contacts, standing=standing)
