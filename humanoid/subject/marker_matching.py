"""Which set of markers a file's names are of."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from humanoid.subject.landmarks import landmark_name
from humanoid.subject.marker_set import LANDMARKS, MarkerSet, marker_set, marker_set_names
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError, first_of, shown

_FEWEST = 6  # fewest names that a set must have
_LISTED = 12  # names in a message
_OWN = "start a set of your own with kinemode subjects --markers FILE"


def matching_set(names: Sequence[str], subject: Subject | None = None) -> MarkerSet:
    """The built-in set that knows most of a file's names, with the names as the file spells them.

    Case, dots, spaces, hyphens and underscores do not count. A note lists the names that the set does not know.
    subject: see `marker_set`.

    Raises
    ------
    InputError: no set knows six names and half of all, or two know equally many.
    """
    known = {name: matched(names, marker_set(name, subject)) for name in marker_set_names()}
    ranked = sorted(known, key=lambda name: -len(known[name]))
    best, second = ranked[:2]
    count = len(known[best])
    if count < _FEWEST or 2 * count < len(names) or count == len(known[second]):
        unknown = [name for name in names if name not in known[best].values()]
        tie = count >= _FEWEST and count == len(known[second])
        problem = f"{best} and {second} both know {count} of its names" if tie else (
            f"no set knows its markers: {best} lacks {shown(first_of(unknown, _LISTED))}"
        )  # fmt: skip
        remedy = f"name a set, one of {', '.join(marker_set_names())}; or {_OWN}"
        raise InputError("points", problem, remedy=remedy)
    return chosen_set(names, marker_set(best, subject))


def chosen_set(names: Sequence[str], markers: MarkerSet) -> MarkerSet:
    """The markers of a set that a file has, with the names as the file spells them; raises InputError where it has
    none."""
    known = matched(names, markers)
    if not known:
        problem = f"has none of the markers of {markers.name}: {shown(first_of(names, _LISTED))}"
        raise InputError("points", problem, remedy=f"name another set, or {_OWN}")
    unknown = [name for name in names if name not in known.values()]
    note = f"points that the set {markers.name} does not know are left out: {first_of(unknown, _LISTED)}"
    return replace(markers.called(known), notes=(*markers.notes, note) if unknown else markers.notes)


def matched(names: Sequence[str], markers: MarkerSet) -> dict[str, str]:
    """The file's name of each marker of a set that it has, by the set's; the first of names that mean the same."""
    spelled: dict[str, str] = {}
    for name in names:
        spelled.setdefault(_plain(name), name)
        landmark = landmark_name(name) if markers.name == LANDMARKS else None
        if landmark is not None:
            spelled.setdefault(_plain(landmark), name)
    return {m.name: spelled[_plain(m.name)] for m in markers.markers if _plain(m.name) in spelled}


def _plain(name: str) -> str:
    return re.sub(r"[\s._\-]+", "", name).lower()
