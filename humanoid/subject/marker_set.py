"""Sets of markers: places of measured points on a subject's links.

    [set]
    name = "opencap"
    about = "one line"
    subject = "human34"
    noise = 0.004                                     # [m] of a measured place, as one standard deviation
    [markers]
    "r.ASIS" = {link = "pelvis", xyz = [0.075, -0.12, 0.07], std = 0.015, mirror = "L.ASIS"}

xyz [m] is in the link's frame, std [m] the standard deviation of that place. mirror names the marker of the other side;
where the file has no such marker it is made: on the link of the other side, across the plane y = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from humanoid.subject.landmarks import mirror_index, without_side
from humanoid.subject.subject import Subject, load_subject
from humanoid.subject.urdf_elements import LEAST_STD, Marker
from humanoid.support.errors import InputError, nearest, shown
from humanoid.support.files import read_toml

LANDMARKS = "landmarks"
_FOLDER = Path(__file__).parent / "marker_sets"
_NOISE = 0.01  # [m] of triangulated keypoints
_STD = {"hip": 0.03, "shoulder": 0.025, "nose": 0.02, "eye": 0.02, "ear": 0.02, "heel": 0.025}
_OTHER_STD = 0.02
_FARTHEST = 10.0
_ENTRIES = ("link", "xyz", "std", "mirror")
_HEAD = ("name", "about", "subject", "noise")


@dataclass(frozen=True)
class MarkerSet:
    """name, about: what it is. markers: on the links of `subject`. pairs: names of markers that mirror each other.
    noise [m]: of a measured place, as one standard deviation along each axis. notes: remarks."""

    name: str
    about: str
    markers: tuple[Marker, ...]
    pairs: tuple[tuple[str, str], ...]
    noise: float
    subject: str = "human34"
    notes: tuple[str, ...] = ()

    def called(self, names: Mapping[str, str]) -> MarkerSet:
        """The markers that are given other names, by their own; the others are left out."""
        markers = tuple(replace(m, name=names[m.name]) for m in self.markers if m.name in names)
        pairs = tuple((names[a], names[b]) for a, b in self.pairs if a in names and b in names)
        return replace(self, markers=markers, pairs=pairs)


def marker_set_names() -> tuple[str, ...]:
    """The sets that have a name."""
    return (LANDMARKS, *sorted(path.stem for path in _FOLDER.glob("*.toml")))


def marker_set(source: str | Path, subject: Subject | None = None) -> MarkerSet:
    """A built-in set by name, or one of a TOML file; subject: whose landmarks the set "landmarks" is, else human34's.

    Raises
    ------
    InputError: no such set; a file that cannot be read, with an entry that is unknown, missing or misshapen.
    """
    if source == LANDMARKS:
        return _of_landmarks(load_subject("human34") if subject is None else subject)
    if str(source) in marker_set_names():
        return _read(_FOLDER / f"{source}.toml")
    path = Path(source)
    if not path.is_file():
        remedy = f"a .toml, or one of {', '.join(marker_set_names())}"
        raise InputError(str(source), "is not a set of markers", remedy=remedy)
    return _read(path)


def _of_landmarks(subject: Subject) -> MarkerSet:
    """The subject's own landmarks at their places."""
    names = [mark.name for mark in subject.landmarks]
    markers = tuple(
        Marker(mark.name, mark.link, mark.xyz, _STD.get(without_side(mark.name), _OTHER_STD))
        for mark in subject.landmarks
    )
    pairs = tuple((names[i], names[k]) for i, k in enumerate(mirror_index(names)) if names[i].startswith("left_"))
    about = "the subject's landmarks, as triangulated keypoints have them"
    return MarkerSet(LANDMARKS, about, markers, tuple(p for p in pairs if p[0] != p[1]), _NOISE, subject.name)


def _read(path: Path) -> MarkerSet:
    content = read_toml(path, remedy='entries look like LASI = {link = "pelvis", xyz = [0, 0, 0], std = 0.015}')
    unknown = next((table for table in content if table not in ("set", "markers")), None)
    if unknown is not None:
        raise InputError(path, f"unknown table {shown(unknown)}", remedy="[set] and [markers]")
    head, entries = (content.get(table, {}) for table in ("set", "markers"))
    if not isinstance(head, dict) or not isinstance(entries, dict) or not entries:
        raise InputError(path, "has no table [markers]", remedy="[set] and [markers] are needed")
    _check_entries(path, "[set]", head, _HEAD)
    markers: dict[str, Marker] = {}
    pairs: list[tuple[str, str]] = []
    for name, entry in entries.items():
        markers[name] = _marker(path, name, entry)
    for name, entry in entries.items():
        other = entry.get("mirror")
        if other is None:
            continue
        if not isinstance(other, str) or other == name:
            raise InputError(path, f"{shown(other)} is not another marker", place=f"[markers] {shown(name)}.mirror")
        if other not in markers:
            markers[other] = mirrored_marker(markers[name], other)
        if (other, name) not in pairs:
            pairs.append((name, other))
    words = {key: head.get(key, path.stem if key == "name" else "") for key in ("name", "about", "subject")}
    if not all(isinstance(word, str) for word in words.values()):
        raise InputError(path, "name, about and subject are texts", place="[set]")
    noise = _number(path, "[set] noise", head.get("noise", _NOISE), LEAST_STD)
    subject = words["subject"] or "human34"
    return MarkerSet(words["name"], words["about"], tuple(markers.values()), tuple(pairs), noise, subject)


def mirrored_marker(marker: Marker, name: str) -> Marker:
    """The marker of the other side: of the link whose name has the other side, at the place across y = 0."""
    link = marker.link
    if link.startswith(("left_", "right_")):
        side, _, part = link.partition("_")
        link = f"{'left' if side == 'right' else 'right'}_{part}"
    x, y, z = marker.xyz
    return Marker(name, link, (x, -y, z), marker.std)


def _check_entries(path: Path, place: str, entry: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in entry:
        if key not in known:
            raise InputError(path, f"unknown entry {shown(key)}", place=place, remedy=nearest(key, known, "entries"))


def _marker(path: Path, name: str, entry: Any) -> Marker:
    place = f"[markers] {shown(name)}"
    if not name.strip() or not name.isprintable():
        raise InputError(path, "is not a name", place=place, remedy="rename it")
    if not isinstance(entry, dict):
        raise InputError(path, "is not a table", place=place, remedy="entries: " + ", ".join(_ENTRIES))
    _check_entries(path, place, entry, _ENTRIES)
    missing = next((key for key in ("link", "xyz", "std") if key not in entry), None)
    if missing is not None:
        raise InputError(path, f"lacks {missing!r}", place=place, remedy=f"add {missing}")
    link, xyz = entry["link"], entry["xyz"]
    if not isinstance(link, str) or not link:
        raise InputError(path, f"{shown(link)} is not a link", place=place, remedy="the name of a link of the subject")
    if not isinstance(xyz, list) or len(xyz) != 3:
        raise InputError(path, f"xyz is {shown(xyz)}", place=place, remedy="three numbers in metres")
    x, y, z = (_number(path, f"{place}.xyz", value, -_FARTHEST) for value in xyz)
    return Marker(name, link, (x, y, z), _number(path, f"{place}.std", entry["std"], LEAST_STD))


def _number(path: Path, place: str, value: Any, least: float) -> float:
    """Metres of a range that can be."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= _FARTHEST:
        remedy = f"metres from {least:g} to {_FARTHEST:g}"
        raise InputError(path, f"{shown(value)} cannot be a length here", place=place, remedy=remedy)
    return float(value)
