"""Which of several people the user names, for each camera or for all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from estimator.data.formats.people_choice import AUTO
from humanoid.support.errors import InputError
from kinemode.named import named_pairs, named_values
from kinemode.request import ALL

if TYPE_CHECKING:
    from kinemode.request import Persons


def persons_of(given: Persons, names: Iterable[str]) -> dict[str, str]:
    """The person of each camera, "auto" where none is given; see `named_values` for what may be given and raised."""
    names = list(names)
    if any(person == ALL for _, person in named_pairs(given)):
        problem = "all is everybody in all cameras, each tracked into a run of their own"
        raise InputError("--person", problem, remedy="of `kinemode track` only, and nothing beside it")
    needed = "auto, an id of the keypoint file, or CAMERA=ID"
    return dict.fromkeys(names, AUTO) | named_values(given, names, "--person", _person, needed)


def plain(given: Persons) -> str | int | dict[str, str]:
    """The same as a value that JSON knows: one for all, or by camera."""
    if isinstance(given, (str, int)) and "=" not in str(given):
        return given
    pairs = named_pairs(given)
    if len(pairs) == 1 and pairs[0][0] is None:
        return str(pairs[0][1])
    return {name or "": str(person) for name, person in pairs}


def _person(value: str | int) -> str:
    if value == "":
        raise ValueError
    return str(value)
