"""Names of markers as capture software writes them: whom they are of, and those that nobody has named."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from humanoid.support.errors import InputError, shown

_UNNAMED = re.compile(r"\*.*|u\d+|(un(label+ed|named|known|identified)|new ?marker)([ _-]?\d+)?", re.IGNORECASE)


def is_unnamed(label: str) -> bool:
    """Whether software calls a point so which it could not tell: `*12`, `U12`, `unlabeled_3`, or nothing."""
    return not label.strip() or _UNNAMED.fullmatch(label.rpartition(":")[2].strip()) is not None


def of_one_person(path: str | Path, labels: Sequence[str]) -> tuple[str, ...]:
    """Labels without the name of whom they are of, as in `ann:LKNE`; raises InputError where they are of several."""
    people = sorted({label.rpartition(":")[0] for label in labels} - {""})
    if len(people) > 1:
        problem = f"has the markers of several people: {shown(', '.join(people))}"
        raise InputError(path, problem, remedy="keep those of one")
    return tuple(label.rpartition(":")[2].strip() for label in labels)


def check_names(path: str | Path, names: Sequence[str], place: str = "") -> None:
    """Raise InputError where a marker is there twice."""
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise InputError(path, f"the point {shown(twice)} is there twice", place=place, remedy="rename or drop one")
