"""Which limbs and points of a body follow which of a source.

Correspondences as TOML files.

    [match]
    scale = 0.8                    # lengths of the subject over the source's; from legs or places unless given
    [limbs]                        # directions: landmarks, or several whose middle counts
    left_thigh = {from = "left_hip", to = "left_knee", weight = 1.0}
    trunk = {from = ["left_hip", "right_hip"], to = ["left_shoulder", "right_shoulder"]}
    left_forearm = {from = "l_elbow", to = "l_hand", source_from = "left_elbow", source_to = "left_wrist"}
    [places]                       # landmarks that are led to where one of the source is
    panda_hand = {source = "right_wrist", about = "panda_joint2", source_about = "right_shoulder"}

`source_from` and `source_to` are needed where the source calls a landmark differently. With `about` and `source_about`
a place is led relative to them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError, shown
from humanoid.support.files import read_toml

_SIDES = ("left", "right")
_SEGMENTS = {
    "thigh": ("hip", "knee"), "shank": ("knee", "ankle"), "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}  # fmt: skip
_ACROSS = {"hips": "hip", "shoulders": "shoulder"}
_ACROSS_WEIGHT = 0.5  # a line across the trunk is short, and leans with every limb that moves


@dataclass(frozen=True)
class MatchedLimb:
    """A direction: from the middle of some landmarks to that of others, of the source and of the subject, which may be
    called differently there. weight: relative to the other limbs."""

    name: str
    source_from: tuple[str, ...]
    source_to: tuple[str, ...]
    subject_from: tuple[str, ...]
    subject_to: tuple[str, ...]
    weight: float = 1.0

    @property
    def landmarks(self) -> set[str]:
        """All that it needs, under the names of either."""
        return {*self.source_from, *self.source_to, *self.subject_from, *self.subject_to}


@dataclass(frozen=True)
class MatchedPlace:
    """A landmark of the subject that is led to where one of the source is, relative to another one of each where these
    are named, in the subject's scale. weight: relative to the other places."""

    subject: str
    source: str
    subject_about: str | None = None
    source_about: str | None = None
    weight: float = 1.0


@dataclass(frozen=True)
class Correspondence:
    """limbs: directions that are alike. places: points that are led to each other, beside the hips and the feet, which
    the whole body follows. scale: lengths of the subject over those of the source; by legs, or by places, unless
    given. source: where it was written, for messages."""

    limbs: tuple[MatchedLimb, ...]
    places: tuple[MatchedPlace, ...] = ()
    scale: float | None = None
    source: str = "correspondence"


def _same(name: str, first: tuple[str, ...], last: tuple[str, ...], weight: float = 1.0) -> MatchedLimb:
    return MatchedLimb(name, first, last, first, last, weight)


def _of_a_person() -> tuple[MatchedLimb, ...]:
    limbs = [
        _same(f"{side}_{name}", (f"{side}_{a}",), (f"{side}_{b}",))
        for side in _SIDES
        for name, (a, b) in _SEGMENTS.items()
    ]
    pairs = {name: tuple(f"{side}_{joint}" for side in _SIDES) for name, joint in _ACROSS.items()}
    limbs.append(_same("trunk", pairs["hips"], pairs["shoulders"]))
    limbs.append(_same("head", pairs["shoulders"], ("head_top",)))
    limbs += [_same(name, pair[1:], pair[:1], _ACROSS_WEIGHT) for name, pair in pairs.items()]
    return tuple(limbs)


PERSON_LIMBS = _of_a_person()
"""Thighs, shanks, arms, trunk and head, and the lines across hips and shoulders, of a body with COCO's landmarks."""


def common_correspondence(subject: Collection[str], source: Collection[str]) -> Correspondence:
    """The correspondence by the landmarks' names that subject and source share: thighs, shanks, arms, feet, the trunk,
    the head, and the lines across hips and shoulders.

    Raises
    ------
    InputError: they have no limb in common.
    """
    known = person_limbs(set(subject) & set(source))
    if not known:
        raise InputError(
            "correspondence", f"no limb is named alike; the subject has {_some(subject)}, the source {_some(source)}",
            remedy="begin one with --match SUBJECT --out match.toml",
        )  # fmt: skip
    return Correspondence(known)


def person_limbs(landmarks: Collection[str]) -> tuple[MatchedLimb, ...]:
    """The limbs of a person whose ends are all among some landmarks."""
    return tuple(limb for limb in PERSON_LIMBS if limb.landmarks <= set(landmarks))


def _some(names: Collection[str]) -> str:
    return shown(", ".join(sorted(names)[:8]) or "none")


def check_correspondence(match: Correspondence, subject: Sequence[str], source: Sequence[str]) -> None:
    """Raise InputError for a landmark that the subject or the source does not have."""
    for limb in match.limbs:
        _check(match, f"limb {limb.name}", (*limb.subject_from, *limb.subject_to), subject, "the subject")
        _check(match, f"limb {limb.name}", (*limb.source_from, *limb.source_to), source, "the source")
    for place in match.places:
        of_subject, of_source = (place.subject, place.subject_about), (place.source, place.source_about)
        _check(match, f"place {place.subject}", [n for n in of_subject if n], subject, "the subject")
        _check(match, f"place {place.subject}", [n for n in of_source if n], source, "the source")


def _check(match: Correspondence, place: str, wanted: Sequence[str], known: Sequence[str], whose: str) -> None:
    for name in wanted:
        if name not in known:
            remedy = f"{whose} has {', '.join(sorted(known))}"
            raise InputError(match.source, f"{whose} has no landmark {shown(name)}", place=place, remedy=remedy)


_LIMB = ("from", "to", "source_from", "source_to", "weight")
_PLACE = ("source", "about", "source_about", "weight")
_TABLES = {"match": ("scale",), "limbs": _LIMB, "places": _PLACE}
_PERSON = (
    "left_hip", "left_knee", "left_ankle", "left_heel", "left_big_toe", "left_shoulder", "left_elbow", "left_wrist",
    "head_top",
)  # fmt: skip


def load_match(path: str | Path) -> Correspondence:
    """Read a correspondence.

    Raises
    ------
    InputError: the file cannot be read, is not TOML, or has an unknown or invalid entry.
    """
    path = Path(path)
    content = read_toml(path, remedy='entries look like left_thigh = {from = "left_hip", to = "left_knee"}')
    for table, entries in content.items():
        if table not in _TABLES or not isinstance(entries, dict):
            raise InputError(path, "unknown table", place=shown(table), remedy=f"one of [{'], ['.join(_TABLES)}]")
    head = _entries(path, "[match]", content.get("match", {}), _TABLES["match"])
    scale = None if "scale" not in head else _number(path, "[match] scale", head["scale"])
    limbs = tuple(_limb(path, name, entry) for name, entry in content.get("limbs", {}).items())
    places = tuple(_place(path, name, entry) for name, entry in content.get("places", {}).items())
    if not limbs and not places:
        raise InputError(path, "has no limbs and no places", remedy="--match SUBJECT begins a file")
    return Correspondence(limbs, places, scale, str(path))


def _limb(path: Path, name: str, entry: Any) -> MatchedLimb:
    where = f"[limbs] {shown(name)}"
    entries = _entries(path, where, entry, _LIMB)
    first, last = (_landmarks(path, where, entries, key) for key in ("from", "to"))
    of_source = [
        _landmarks(path, where, entries, key) if key in entries else own
        for key, own in (("source_from", first), ("source_to", last))
    ]
    return MatchedLimb(name, of_source[0], of_source[1], first, last, _weight(path, where, entries))


def _place(path: Path, name: str, entry: Any) -> MatchedPlace:
    where = f"[places] {shown(name)}"
    entries = _entries(path, where, entry, _PLACE)
    texts = {key: entries[key] for key in ("source", "about", "source_about") if key in entries}
    for key, value in texts.items():
        if not isinstance(value, str):
            raise InputError(path, f"{key} is {shown(str(value))}", place=where, remedy="the name of a landmark")
    if "source" not in texts or ("about" in texts) != ("source_about" in texts):
        remedy = 'source = "right_wrist", and both of about and source_about, or none'
        raise InputError(path, "is incomplete", place=where, remedy=remedy)
    return MatchedPlace(
        name, texts["source"], texts.get("about"), texts.get("source_about"), _weight(path, where, entries)
    )


def _entries(path: Path, where: str, entry: Any, known: Sequence[str]) -> Mapping[str, Any]:
    if not isinstance(entry, dict):
        raise InputError(path, "is not a table", place=where, remedy=f"entries are {', '.join(known)}")
    for key in entry:
        if key not in known:
            raise InputError(path, f"unknown entry {shown(key)}", place=where, remedy=f"one of {', '.join(known)}")
    return entry


def _landmarks(path: Path, where: str, entries: Mapping[str, Any], key: str) -> tuple[str, ...]:
    value = entries.get(key)
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, (list, tuple)) or not names or not all(isinstance(name, str) for name in names):
        raise InputError(path, f"{key} is not a landmark", place=where, remedy=f'{key} = "left_hip", or several in []')
    return tuple(names)


def _weight(path: Path, where: str, entries: Mapping[str, Any]) -> float:
    return _number(path, f"{where} weight", entries.get("weight", 1.0))


def _number(path: Path, where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value <= 0.0:
        raise InputError(path, f"is {shown(str(value))}", place=where, remedy="a number above 0")
    return float(value)


def match_start(subject: str, landmarks: Collection[str]) -> str:
    """The template of a correspondence for a subject with some landmarks, to be checked: limbs whose
    names are a person's count, everything else is commented out."""
    limbs = person_limbs(landmarks)
    used = {name for limb in limbs for name in (*limb.subject_from, *limb.subject_to)}
    others = [name for name in landmarks if name not in used]
    lines = [
        f"# What of {subject} follows what of a source, begun by `kinemode retarget --match`: look through it.",
        "",
        "# [match]",
        "# scale = 1.0  # lengths of the subject over those of the source, found from its legs or places unless given",
        "",
        "[limbs]  # directions that are alike; weight is relative to the others",
    ]
    for limb in limbs:
        ends = f"from = {_quoted(limb.subject_from)}, to = {_quoted(limb.subject_to)}"
        lines.append(f"{limb.name} = {{{ends}, weight = {limb.weight:g}}}")
    lines += ["", "[places]  # landmarks that are led to where one of the source is"]
    lines += [f'# {json.dumps(name)} = {{source = "?"}}' for name in others]
    lines += ["", f"# Sources of people have {', '.join(_PERSON)}, and the same of the right side."]
    return "\n".join(lines) + "\n"


def _quoted(names: tuple[str, ...]) -> str:
    return json.dumps(names[0] if len(names) == 1 else list(names))
