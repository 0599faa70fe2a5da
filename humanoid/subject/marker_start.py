"""A set of markers to begin with, for a laboratory of one's own: a file's names, with the places that are known."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence

from humanoid.subject.marker_matching import matched
from humanoid.subject.marker_set import MarkerSet, marker_set, marker_set_names
from humanoid.subject.urdf_elements import Marker

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
