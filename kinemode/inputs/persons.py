"""Whom of several people the user names, for each camera or for all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from estimator.formats.people_choice import AUTO
from humanoid.support.errors import InputError

Persons = str | int | Iterable[str] | Mapping[str, str | int]


def persons_of(given: Persons, names: Iterable[str]) -> dict[str, str]:
    """Whom of each camera's people: from "auto" or an id for all, CAMERA=ID texts, or a mapping by camera.

    Raises InputError: an unknown camera, two people for one camera, nobody.
    """
    names = list(names)
    found: dict[str, str] = {}
    for name, person in _pairs(given):
        if name is not None and name not in names:
            remedy = f"cameras: {', '.join(names)}; write CAMERA=WHO"
            raise InputError("--person", f"there is no camera {name[:80]!r}", remedy=remedy)
        if not person:
            raise InputError("--person", "names nobody", remedy="auto, an id of the keypoint file, or CAMERA=ID")
        for each in names if name is None else [name]:
            if found.setdefault(each, person) != person:
                problem = f"camera {each!r} is given {found[each][:80]} and {person[:80]}"
                raise InputError("--person", problem, remedy="choose one")
    return dict.fromkeys(names, AUTO) | found


def plain(given: Persons) -> str | int | dict[str, str]:
    """The same as a value that JSON knows: one for all, or by camera."""
    if isinstance(given, (str, int)):
        return given
    pairs = _pairs(given)
    if len(pairs) == 1 and pairs[0][0] is None:
        return pairs[0][1]
    return {name or "": person for name, person in pairs}


def _pairs(given: Persons) -> list[tuple[str | None, str]]:
    """Camera, None for all, and person."""
    if isinstance(given, Mapping):
        return [(str(name), str(person)) for name, person in given.items()]
    texts = [str(given)] if isinstance(given, (str, int)) else [str(text) for text in given]
    parts = [text.partition("=") for text in texts]
    return [(name, person) if separator else (None, name) for name, separator, person in parts]
