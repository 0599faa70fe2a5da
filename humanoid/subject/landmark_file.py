"""Landmarks and priors of a URDF that has none, in a small TOML next to it.

    [subject]
    base = "free"                                       # or "fixed"
    [landmarks]
    left_elbow = {link = "left_forearm", xyz = [0, 0, 0]}          # metres in the link's frame
    [stabilisers]
    elbow = {rest = 0.3, std = 0.8}                     # rad, metres for a sliding joint; also std_above = 1,
                                                        # where it is another above rest, and quickness = 1.2
    [proportions]
    elbow = {scale_min = 0.8, scale_max = 1.2, mean = 1, std = 0.06, symmetric_with = ["right_elbow"]}
    [limits]
    elbow = [0, 2.6]                                    # replaces the URDF's

Each table takes the place of the elements of its kind in the URDF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from humanoid.subject.urdf_document import Document, elements
from humanoid.support.errors import InputError, nearest, shown
from humanoid.support.files import read_toml

SUFFIX = ".landmarks.toml"
# table -> tag, attribute that takes the key, entries with their kind (a number, a list of numbers, a text, names)
_TABLES: dict[str, tuple[str, str, dict[str, str]]] = {
    "landmarks": ("landmark", "name", {"link": "text", "xyz": "three numbers"}),
    "upright": ("upright", "link", {"xyz": "three numbers", "std": "a number"}),
    "stabilisers": ("stabiliser", "joint", dict.fromkeys(("rest", "std", "std_above", "quickness"), "a number")),
    "proportions": (
        "proportion",
        "joint",
        {**dict.fromkeys(("scale_min", "scale_max", "mean", "std"), "a number"), "symmetric_with": "a list of names"},
    ),
}
_OPTIONAL = ("xyz", "symmetric_with", "std_above", "quickness")


def merge_landmark_file(document: Document, path: Path) -> None:
    """Put the content of a landmark file into a checked URDF document, as elements.

    Raises
    ------
    InputError: the file cannot be read, is not TOML, or has an entry that is unknown, misshapen or of an unknown joint.
    """
    content = read_toml(path, remedy='entries look like nose = {link = "head"}')
    for table, entries in content.items():
        if table not in (*_TABLES, "subject", "limits"):
            raise InputError(path, "unknown table", place=f"[{table}]", remedy=nearest(table, _tables(), "tables"))
        if not isinstance(entries, dict):
            raise InputError(path, "is not a table", place=table, remedy=f"write [{table}]")
        if table == "limits":
            _set_limits(document, path, entries)
        elif table == "subject":
            _set_subject(document, path, entries)
        else:
            _set_elements(document, path, table, entries)


def _tables() -> list[str]:
    return [*_TABLES, "subject", "limits"]


def _set_elements(document: Document, path: Path, table: str, entries: dict[str, Any]) -> None:
    tag, key, kinds = _TABLES[table]
    for old in list(elements(document.root, tag)):
        document.root.remove(old)
    for name, entry in entries.items():
        place = f"[{table}] {name}"
        if not name.strip() or not name.isprintable():
            problem = f"the name {shown(name)} cannot be written in a URDF"
            raise InputError(path, problem, place=place, remedy="rename it")
        if not isinstance(entry, dict):
            raise InputError(path, "is not a table", place=place, remedy="entries: " + ", ".join(kinds))
        for given in entry:
            if given not in kinds:
                remedy = nearest(given, kinds, "entries")
                raise InputError(path, f"unknown entry {shown(given)}", place=place, remedy=remedy)
        attributes = {key: name}
        for wanted, kind in kinds.items():
            if wanted in entry:
                attributes[wanted] = _as_text(path, f"{place}.{wanted}", kind, entry[wanted])
            elif wanted not in _OPTIONAL:
                raise InputError(path, f"lacks {wanted!r}", place=place, remedy=f"add {wanted} = {kind}")
        element = ET.SubElement(document.root, tag, attributes)
        document.places[element] = (str(path), place)


def _as_text(path: Path, place: str, kind: str, value: Any) -> str:
    """A TOML value as the text of an attribute; ranges are judged where the elements are read."""
    if kind == "text" and _is_name(value):
        return str(value)
    if kind == "a number" and _is_number(value):
        return repr(float(value))
    if kind == "three numbers" and isinstance(value, list) and len(value) == 3 and all(map(_is_number, value)):
        return " ".join(repr(float(v)) for v in value)
    if kind == "a list of names" and isinstance(value, list) and all(map(_is_name, value)):
        return " ".join(value)
    raise InputError(path, f"{shown(value)} is not {kind}", place=place, remedy=f"give {kind}")


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and value.isprintable()


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300


def _set_subject(document: Document, path: Path, entries: dict[str, Any]) -> None:
    for name in entries:
        if name != "base":
            remedy = nearest(name, ["base"], "entries")
            raise InputError(path, f"unknown entry {shown(name)}", place="[subject]", remedy=remedy)
    if "base" in entries:
        if entries["base"] not in ("free", "fixed"):
            problem = f"{shown(entries['base'])} is unknown"
            raise InputError(path, problem, place="[subject] base", remedy="free or fixed")
        for old in list(elements(document.root, "subject")):
            document.root.remove(old)
        element = ET.SubElement(document.root, "subject", {"base": entries["base"]})
        document.places[element] = (str(path), "[subject] base")


def _set_limits(document: Document, path: Path, entries: dict[str, Any]) -> None:
    joints = {
        j.get("name", ""): j
        for j in elements(document.root, "joint")
        if j.get("type") in ("revolute", "continuous", "prismatic")
    }
    for name, entry in entries.items():
        place = f"[limits] {name}"
        if name not in joints:
            raise InputError(path, "there is no such joint", place=place, remedy=nearest(name, joints, "joints"))
        if not (isinstance(entry, list) and len(entry) == 2 and all(map(_is_number, entry)) and entry[0] <= entry[1]):
            problem = f"{shown(entry)} is not [lower, upper]"
            raise InputError(path, problem, place=place, remedy="two numbers, lower first")
        joint = joints[name]
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = ET.SubElement(joint, "limit")
        limit.set("lower", repr(float(entry[0])))
        limit.set("upper", repr(float(entry[1])))
        for key in ("effort", "velocity"):  # URDF parsers refuse a limit without them
            limit.attrib.setdefault(key, "1000")
