"""A set of markers to begin with, for a laboratory of one's own: the set that a file's names are of, and the places
known.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

from humanoid.subject.landmarks import landmark_name
from humanoid.subject.marker_set import LANDMARKS, MarkerSet, marker_set, marker_set_names
from humanoid.subject.subject import Subject
from humanoid.subject.urdf_elements import Marker
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


_HEAD = """# Markers of {source}: where each sits on the subject, begun by kinemode subjects --markers.
#
# link: the part it is fixed to. xyz [m]: its place in the link's frame; on human34 standing with hanging arms x is
# forward, y left, z up, and a link begins at its joint (left_thigh at the hip, left_shank at the knee, left_foot at the
# ankle), the torso at the lumbar joint. std [m]: how unsure that place is: 0.012 to 0.015 on a bone that can be felt,
# 0.03 to 0.06 on flesh. mirror: the marker of the other side; where that is not listed it is made from this.
# Links: {links}.

[set]
name = {name}
about = "begun from {source}"
subject = {subject}
noise = {noise:g}                 # [m] of a measured place, as one standard deviation

[markers]
"""
_UNKNOWN = """
# No set knows these: put a link for each ?, its place and how unsure it is, and take the # away. Those left as they are
# stay out of the track.
"""
_SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("l", "r"), ("L", "R"))


def marker_start(names: Sequence[str], source: str, links: Sequence[str], begin: str | None = None) -> str:
    """The text of a file for `humanoid.subject.marker_set.marker_set`, which loads once a marker is in it.

    names: of a file's points. source: the file's name. links: of the subject. begin: the built-in set, or the file,
    whose places take precedence over those of the others.

    Raises
    ------
    InputError: there is no such set.
    """
    sets = [marker_set(name) for name in marker_set_names()]
    sets.sort(key=lambda markers: -len(matched(names, markers)))
    if begin is not None:
        sets.insert(0, marker_set(begin))
    known: dict[str, tuple[Marker, str]] = {}
    for markers in sets:
        theirs = matched(names, markers)
        for marker in markers.markers:
            if marker.name in theirs:
                known.setdefault(theirs[marker.name], (marker, markers.name))
    partner = _partners(names, sets)
    head = _HEAD.format(
        source=_comment(source), links=", ".join(links), name=_text(source.rpartition(".")[0] or source),
        subject=_text(sets[0].subject), noise=sets[0].noise,
    )  # fmt: skip
    lines = [f"{_line(name, known[name][0], partner)}  # {known[name][1]}" for name in names if name in known]
    rest = [f"# {_line(name, None, partner)}" for name in names if name not in known]
    return head + "\n".join(lines) + "\n" + (_UNKNOWN + "\n".join(rest) + "\n" if rest else "")


def _line(name: str, marker: Marker | None, partner: dict[str, str]) -> str:
    link = "?" if marker is None else _text(marker.link)
    xyz = (0.0, 0.0, 0.0) if marker is None else marker.xyz
    place = ", ".join(f"{v:g}" for v in xyz)
    mirror = f", mirror = {_text(partner[name])}" if name in partner else ""
    return (
        f"{_text(name)} = {{link = {link}, xyz = [{place}], std = {0.03 if marker is None else marker.std:g}{mirror}}}"
    )


def _partners(names: Sequence[str], sets: Iterable[MarkerSet]) -> dict[str, str]:
    """The other side's marker of each that has one: as sets pair them, else by the side in its name."""
    pairs: dict[str, str] = {}
    for markers in sets:
        for pair in markers.called(matched(names, markers)).pairs:
            if not set(pair) & set(pairs):
                pairs |= {pair[0]: pair[1], pair[1]: pair[0]}
    for name in names:
        for left, right in _SIDES:
            other = re.sub(rf"^{left}(?=[A-Z_. ])|(?<=[_. ]){left}$", right, name, count=1)
            if other != name and other in names and not {name, other} & set(pairs):
                pairs |= {name: other, other: name}
    return pairs


def _text(word: str) -> str:
    """A text in TOML, whose escapes are those of JSON."""
    return json.dumps(word, ensure_ascii=False)


def _comment(word: str) -> str:
    return "".join(c if c.isprintable() and c not in '"\\' else "?" for c in word)
