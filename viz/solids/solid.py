"""Triangle meshes fixed to joints, and the side of the body they belong to."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from humanoid.shape.surface_hulls import vertex_normals
from viz.palette import SIDES, Rgb

Side = Literal["left", "right", "trunk"]

_LEFT = re.compile(r"left|(^|[_\W])l([_\W\d]|$)", re.IGNORECASE)
_RIGHT = re.compile(r"right|(^|[_\W])r([_\W\d]|$)", re.IGNORECASE)
_SIDE = re.compile(r"(left|right)[_\W]?|(^|(?<=[_\W]))[lr]([_\W]|(?=\d)|$)", re.IGNORECASE)


@dataclass(frozen=True)
class DrawnMesh:
    """A triangle mesh fixed to a joint.

    name: of the link (or geometry) it stands for. joint: index of the joint it moves with. side: for its colour.
    vertices (V, 3): in the joint's frame [m]. faces (F, 3): counter-clockwise seen from outside.
    colour: its own, None where its side decides. normals (V, 3): of the surface at the vertices, in the joint's frame;
    None where they are the means of the faces around. closed: its back faces are never seen.
    """

    name: str
    joint: int
    side: Side
    vertices: np.ndarray
    faces: np.ndarray
    colour: Rgb | None = None
    normals: np.ndarray | None = None
    closed: bool = True

    @property
    def paint(self) -> Rgb:
        """The colour it is drawn in."""
        return SIDES[self.side] if self.colour is None else self.colour

    def shading(self) -> np.ndarray:
        """Unit normals at the vertices (V, 3), in the joint's frame."""
        return vertex_normals(self.vertices, self.faces) if self.normals is None else self.normals


def side_of(name: str) -> Side:
    """The side in a link, joint or landmark name: left_hip, l_hip, hip_L, ..."""
    if _LEFT.search(name):
        return "left"
    return "right" if _RIGHT.search(name) else "trunk"


def without_side(name: str) -> str:
    """A name without its side: hip of left_hip, l_hip, hip_L; itself where nothing would be left."""
    return _SIDE.sub("", name).strip("_- ") or name


def sides_among(names: Iterable[str]) -> tuple[Side, ...]:
    """The sides in names, left and right before trunk; none where all is trunk."""
    sides = {side_of(name) for name in names}
    return tuple(side for side in SIDES if side in sides) if sides - {"trunk"} else ()


def merged(solids: Iterable[DrawnMesh]) -> tuple[DrawnMesh, ...]:
    """One solid per joint and colour: fewer moving parts to send to a browser."""
    groups: dict[tuple[int, Rgb, bool, bool], list[DrawnMesh]] = {}
    for solid in solids:
        groups.setdefault((solid.joint, solid.paint, solid.closed, solid.normals is None), []).append(solid)
    return tuple(_joined(group) for group in groups.values())


def _joined(group: Sequence[DrawnMesh]) -> DrawnMesh:
    first = group[0]
    starts = np.cumsum([0] + [len(s.vertices) for s in group[:-1]])
    faces = np.concatenate([s.faces + start for s, start in zip(group, starts, strict=True)])
    vertices = np.concatenate([s.vertices for s in group])
    normals = None if first.normals is None else np.concatenate([s.shading() for s in group])
    return DrawnMesh(first.name, first.joint, first.side, vertices, faces, first.colour, normals, first.closed)
