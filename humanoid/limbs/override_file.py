"""Limbs given by the user in place of those of the rule: a small TOML.

    [limbs.left_leg]                          # a new limb, or with the name of one that the rule makes
    links = ["left_thigh", "left_shank"]      # merged into it; what stands between them belongs to it too
    link = "left_thigh"                       # which carries it; by default the longest
    proximal = "left_hip_flexion"             # joints, fixed ones too, that its z axis leads from and to
    distal = "left_knee_flexion"
    start = -0.05                             # where along z the cone begins and ends [m]
    end = 0.45
    proximal_radii = [0.09, 0.08]             # semi-axes along x and y there [m]
    distal_radii = [0.05, 0.05]

All entries may be left out. Links not in `links` are merged by the rule; without `links` the limb is the rule's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.limbs.bodies import Bodies
from humanoid.limbs.limb import Cone
from humanoid.limbs.merging import Group, topmost_first
from humanoid.subject.urdf_document import PLAUSIBLE
from humanoid.support.errors import InputError, nearest, shown
from humanoid.support.files import read_toml

_THINNEST = 1e-4  # m
_KINDS = {
    "links": "a list of names",
    "link": "a name",
    "proximal": "a name",
    "distal": "a name",
    "start": "a number",
    "end": "a number",
    "proximal_radii": "two lengths of 0.1 mm or more",
    "distal_radii": "two lengths of 0.1 mm or more",
}


@dataclass(frozen=True)
class Change:
    """The entries of one limb, see the module; None where not given. path: the file, for errors."""

    path: str = ""
    links: tuple[str, ...] | None = None
    link: str | None = None
    proximal: str | None = None
    distal: str | None = None
    start: float | None = None
    end: float | None = None
    proximal_radii: tuple[float, float] | None = None
    distal_radii: tuple[float, float] | None = None

    def joints(
        self, body: Body, bodies: Bodies, group: Group, name: str
    ) -> tuple[np.ndarray | None, np.ndarray | None]:
        """The places in the world (3,) of the joints that are given, with the body at rest [m]; else None."""
        places = [
            None if joint is None else _joint_place(self.path, body, bodies, group, (name, key, joint))
            for key, joint in (("proximal", self.proximal), ("distal", self.distal))
        ]
        if places[1] is not None:
            first = bodies.pivot[group.members[0]] if places[0] is None else places[0]
            if np.linalg.norm(first - places[1]) < 1e-6:
                problem = "proximal and distal joint are at the same place"
                raise InputError(self.path, problem, place=f"[limbs.{name}]", remedy="give another, or leave it out")
        return places[0], places[1]

    def cone(self, fitted: Cone, name: str) -> Cone:
        """The fitted cone with what is given instead."""
        start = fitted.start if self.start is None else self.start
        end = fitted.end if self.end is None else self.end
        if end < start + _THINNEST:
            problem = f"the cone would begin at {start:g} m and end at {end:g} m"
            raise InputError(self.path, problem, place=f"[limbs.{name}]", remedy="give an end beyond its start")
        proximal = fitted.proximal if self.proximal_radii is None else np.array(self.proximal_radii)
        distal = fitted.distal if self.distal_radii is None else np.array(self.distal_radii)
        return Cone(start, end, proximal, distal)


@dataclass(frozen=True)
class Overrides:
    """The overrides of a file, by limb names."""

    path: str = ""
    limbs: dict[str, Change] = field(default_factory=dict)

    def groups(self, bodies: Bodies) -> list[Group]:
        """The bodies of the limbs whose links are given.

        Raises
        ------
        InputError: an unknown link, one in two limbs, or links that are not connected.
        """
        owner: dict[int, str] = {}
        groups = []
        for name, change in self.limbs.items():
            if change.links is not None:
                group = _group(bodies, name, change)
                for j in group.members:
                    if j in owner:
                        link = next(iter(bodies.links[j]), "")
                        problem = f"link {link!r} is in the limb {owner[j]!r} too"
                        remedy = "links of one body, and of joints that act as one, belong to one limb"
                        raise InputError(self.path, problem, place=f"[limbs.{name}] links", remedy=remedy)
                    owner[j] = name
                groups.append(group)
        return groups

    def check(self, names: list[str]) -> None:
        """Raises InputError where a limb is changed that is not among the names, or two have the same."""
        for name in self.limbs:
            if name not in names:
                remedy = nearest(name, names, "limbs") + " A new limb needs links = [...]"
                raise InputError(self.path, "there is no such limb", place=f"[limbs.{name}]", remedy=remedy)
            if names.count(name) > 1:
                problem = "another limb, which the rule makes, has this name"
                raise InputError(self.path, problem, place=f"[limbs.{name}]", remedy="choose another name")


def read_overrides(path: str | Path) -> Overrides:
    """Read a file of limbs; whether it fits a body is checked when the graph is made.

    Raises
    ------
    InputError: the file cannot be read, is not TOML, or has an entry that is unknown or misshapen.
    """
    path = Path(path)
    content = read_toml(path, remedy='a limb begins with [limbs.NAME], then entries such as link = "thigh"')
    for table in content:
        if table != "limbs":
            remedy = "write [limbs.NAME]; " + nearest(table, ["limbs"], "tables")
            raise InputError(path, "unknown table", place=f"[{table}]", remedy=remedy)
    limbs = content.get("limbs", {})
    if not isinstance(limbs, dict):
        raise InputError(path, "is not a table", place="limbs", remedy="write [limbs.NAME]")
    return Overrides(str(path), {name: _change(path, name, entry) for name, entry in limbs.items()})


def _change(path: Path, name: str, entry: Any) -> Change:
    place = f"[limbs.{name}]"
    if not name.strip() or not name.isprintable():
        raise InputError(path, f"{shown(name)} is not a name", place=place, remedy="give it printable characters")
    if not isinstance(entry, dict):
        raise InputError(path, "is not a table", place=place, remedy="entries: " + ", ".join(_KINDS))
    values: dict[str, Any] = {}
    for key, value in entry.items():
        if key not in _KINDS:
            remedy = nearest(key, _KINDS, "entries")
            raise InputError(path, f"unknown entry {shown(key)}", place=place, remedy=remedy)
        if not _is_kind(_KINDS[key], value):
            problem = f"{shown(value)} is not {_KINDS[key]}"
            raise InputError(path, problem, place=f"{place} {key}", remedy=f"give {_KINDS[key]}")
        if isinstance(value, list):
            values[key] = tuple(value) if key == "links" else (float(value[0]), float(value[1]))
        else:
            values[key] = value if isinstance(value, str) else float(value)
    return Change(str(path), **values)


def _is_kind(kind: str, value: Any) -> bool:
    if kind == "a name":
        return isinstance(value, str)
    if kind == "a list of names":
        return isinstance(value, list) and len(value) > 0 and all(isinstance(v, str) for v in value)
    if kind == "a number":
        return _is_number(value)
    return isinstance(value, list) and len(value) == 2 and all(_is_number(v) and v >= _THINNEST for v in value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= PLAUSIBLE


def _group(bodies: Bodies, name: str, change: Change) -> Group:
    """The bodies of given links, with all whose joints act as one with theirs and what has no surface in between."""
    place = f"[limbs.{name}] links"
    body_of_link = {link: j for j, links in enumerate(bodies.links) for link in links if bodies.parent[j] >= -1}
    for link in (*(change.links or ()), *(() if change.link is None else (change.link,))):
        if link not in body_of_link:
            raise InputError(
                change.path, f"there is no link {link!r}", place=place, remedy=nearest(link, body_of_link, "links")
            )
    units = {int(bodies.unit[body_of_link[link]]) for link in change.links or ()}
    members = {j for j in range(len(bodies.parent)) if bodies.parent[j] >= -1 and int(bodies.unit[j]) in units}
    _connect(bodies, members, change, place)
    if change.link is None:
        by_unit = {u: [j for j in sorted(members) if bodies.unit[j] == u] for u in sorted(units)}
        carrier = max(units, key=lambda u: bodies.length(topmost_first(bodies, by_unit[u])))
    else:
        carrier = body_of_link[change.link]
    if carrier not in members:
        problem = f"{change.link!r} is not one of the links"
        raise InputError(
            change.path, problem, place=f"[limbs.{name}] link", remedy="name one of " + ", ".join(change.links or ())
        )
    return Group(tuple(topmost_first(bodies, members)), carrier, fixed=True, name=name)


def _connect(bodies: Bodies, members: set[int], change: Change, place: str) -> None:
    """Add the bodies without surface that part members; all have to hang together then."""
    for j in sorted(members):
        way, up = [], int(bodies.parent[j])
        while up >= 0 and up not in members and not len(bodies.points[up]):
            way.append(up)
            up = int(bodies.parent[up])
        if up in members:
            members.update(way)
    tops = [j for j in sorted(members) if int(bodies.parent[j]) not in members]
    if len(tops) > 1:
        names = " and ".join(repr(bodies.links[j][0]) for j in tops[:2] if bodies.links[j])
        remedy = "add the links between them, or make two limbs"
        raise InputError(change.path, f"{names} are not connected", place=place, remedy=remedy)


def _joint_place(path: str, body: Body, bodies: Bodies, group: Group, asked: tuple[str, str, str]) -> np.ndarray:
    """Place of a joint on a limb at rest (3,) [m]; asked: the limb, the entry, the joint."""
    name, key, joint = asked
    model, place = body.model, f"[limbs.{name}] {key}"
    moving = {str(n): j for j, n in enumerate(model.names) if j > 0 and bodies.parent[j] >= -1}
    fixed = {f.name: f for f in model.frames if f.type == pin.FrameType.FIXED_JOINT}
    if joint in moving:
        j = moving[joint]
        sides, where = {j, int(bodies.parent[j])}, bodies.pivot[j]
    elif joint in fixed:
        frame = fixed[joint]
        j = int(frame.parentJoint)
        sides, where = {j}, bodies.posed.rotations[j] @ frame.placement.translation + bodies.posed.translations[j]
    else:
        remedy = nearest(joint, [*moving, *fixed], "joints")
        raise InputError(path, f"there is no joint {joint!r}", place=place, remedy=remedy)
    if not sides & set(group.members):
        on_it = [n for n, k in moving.items() if {k, int(bodies.parent[k])} & set(group.members)]
        on_it += [n for n, f in fixed.items() if f.parentJoint in group.members]
        raise InputError(
            path, f"joint {joint!r} is not on this limb", place=place, remedy=nearest(joint, on_it, "joints")
        )
    return np.asarray(where)
