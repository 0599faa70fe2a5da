"""A subject's surface as triangle meshes on its joints, and its skeleton as line segments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import coal
import numpy as np
import pinocchio as pin
import trimesh

from humanoid.body import Body, PosedBody, points_in_world
from humanoid.errors import InputError
from humanoid.flesh import flesh_meshes, solid_mesh
from humanoid.solids import solids_of
from humanoid.subject import Flesh

Side = Literal["left", "right", "trunk"]

_LEFT = re.compile(r"left|(^|[_\W])l([_\W\d]|$)", re.IGNORECASE)
_RIGHT = re.compile(r"right|(^|[_\W])r([_\W\d]|$)", re.IGNORECASE)
_HULL_GRID = 14  # cells along a visual mesh's longest side when it is simplified

# pairs of landmark names, COCO's where COCO has one
LIMBS: tuple[tuple[str, str], ...] = (
    ("head_top", "neck"),
    ("neck", "mid_hip"),
    *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in (("eye", "ear"), ("shoulder", "elbow"))),
    *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in (("elbow", "wrist"), ("hip", "knee"))),
    *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in (("knee", "ankle"), ("ankle", "big_toe"))),
    *(
        (a, f"{s}_{b}")
        for a, b in (("nose", "eye"), ("neck", "shoulder"), ("mid_hip", "hip"))
        for s in ("left", "right")
    ),
)
# what stands in for the trunk where the body has no neck or no middle of the hips
_TRUNK: tuple[tuple[str, str], ...] = (
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"),
)


@dataclass(frozen=True)
class Solid:
    """A triangle mesh fixed to a joint.

    name: of the link (or geometry) it stands for. joint: index of the joint it moves with. side: for its colour.
    vertices (V, 3): in the joint's frame [m]. faces (F, 3): counter-clockwise seen from outside.
    """

    name: str
    joint: int
    side: Side
    vertices: np.ndarray
    faces: np.ndarray


@dataclass(frozen=True)
class Skeleton:
    """Line segments between points fixed to joints.

    joint (P,), local (P, 3) [m]: the points. segments (S, 2): indices of their ends. sides (S): for the colours.
    """

    joint: np.ndarray
    local: np.ndarray
    segments: np.ndarray
    sides: tuple[Side, ...]

    def at(self, posed: PosedBody) -> np.ndarray:
        """The points in the world [m], (P, 3)."""
        return points_in_world(posed, self.joint, self.local)


def side_of(name: str) -> Side:
    """The side a link, joint or landmark name speaks of: left_hip, l_hip, hip_L, ..."""
    if _LEFT.search(name):
        return "left"
    return "right" if _RIGHT.search(name) else "trunk"


def body_solids(body: Body, *, coarse: bool = False) -> tuple[Solid, ...]:
    """The body's surface: its flesh, else its visual geometry, else its joint tree as thin capsules.

    coarse: fewer triangles on the flesh, enough for a translucent hypothesis.
    """
    if body.subject.flesh:
        around, along = (12, 6) if coarse else (20, 12)
        meshes = flesh_meshes(body, around, along)
        return tuple(Solid(m.link, m.joint, side_of(m.link), m.vertices, m.faces) for m in meshes)
    return _visual_solids(body) or _tree_solids(body)


def merged(solids: Iterable[Solid]) -> tuple[Solid, ...]:
    """One solid per joint and side: fewer moving parts to send to a browser."""
    groups: dict[tuple[int, Side], list[Solid]] = {}
    for solid in solids:
        groups.setdefault((solid.joint, solid.side), []).append(solid)
    return tuple(_joined(group) for group in groups.values())


def _joined(group: Sequence[Solid]) -> Solid:
    starts = np.cumsum([0] + [len(s.vertices) for s in group[:-1]])
    faces = np.concatenate([s.faces + start for s, start in zip(group, starts, strict=True)])
    return Solid(group[0].name, group[0].joint, group[0].side, np.concatenate([s.vertices for s in group]), faces)


def _tree_solids(body: Body) -> tuple[Solid, ...]:
    """A thin capsule from every joint to each of its children."""
    model = body.model
    first = _first_joint(body)
    offsets = {j: np.array(model.jointPlacements[j].translation) for j in range(first, model.njoints)}
    reach = max((float(np.linalg.norm(offset)) for offset in offsets.values()), default=0.0)
    solids: list[Solid] = []
    for j, offset in offsets.items():
        length = float(np.linalg.norm(offset))
        if length > 0.05 * reach:
            R_joint_capsule = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), offset).toRotationMatrix()
            capsule = Flesh(model.names[j], "capsule", (min(0.04, 0.1 * reach), length, 0.0), (0, 0, 0), (0, 0, 0))
            vertices, faces = solid_mesh(capsule)
            name = model.names[j]
            solids.append(
                Solid(name, int(model.parents[j]), side_of(name), vertices @ R_joint_capsule.T + offset / 2.0, faces)
            )
    return tuple(solids)


def _first_joint(body: Body) -> int:
    """The first joint whose placement is a length of the body rather than its place in the world."""
    return 2 if body.subject.base == "free" else 1


def _visual_solids(body: Body) -> tuple[Solid, ...]:
    """The URDF's visual geometry, simplified; empty where there is none or its meshes cannot be read."""
    try:
        found = solids_of(body, "visual")
    except InputError:
        return ()
    solids = []
    for part in found:
        mesh = _shape_mesh(part.geometry)
        if mesh is not None:
            vertices = np.asarray(mesh.vertices) @ part.rotation.T + part.translation
            solids.append(Solid(part.link, part.joint, side_of(part.link), vertices, np.asarray(mesh.faces)))
    return tuple(solids)


def _shape_mesh(shape: Any) -> trimesh.Trimesh | None:
    """A coal shape as a mesh in its own frame; a hull of many corners is reduced to a coarse one."""
    if isinstance(shape, coal.ConvexBase):
        points = np.array([shape.point(i) for i in range(shape.num_points)])
        cell = max(float(np.ptp(points, axis=0).max()) / _HULL_GRID, 1e-6)
        _, kept = np.unique(np.round(points / cell), axis=0, return_index=True)
        # a part thinner than a cell keeps all its corners, or it would lose its volume
        return trimesh.Trimesh(points[kept] if len(kept) > 60 else points).convex_hull
    if isinstance(shape, coal.Sphere):
        return trimesh.creation.uv_sphere(radius=shape.radius, count=[12, 24])
    if isinstance(shape, coal.Box):
        return trimesh.creation.box(extents=2.0 * np.array(shape.halfSide))
    if isinstance(shape, coal.Cylinder):
        return trimesh.creation.cylinder(radius=shape.radius, height=2.0 * shape.halfLength, sections=20)
    return None


def skeleton(body: Body) -> Skeleton:
    """The body's skeleton: limbs between named landmarks where the names are known, else the joint tree."""
    index = {name: i for i, name in enumerate(body.landmark_names)}
    pairs = [(a, b) for a, b in LIMBS if a in index and b in index]
    if not {"neck", "mid_hip"} <= index.keys():
        pairs += [(a, b) for a, b in _TRUNK if a in index and b in index]
    if len(pairs) < 6:
        return _joint_tree(body)
    segments = np.array([(index[a], index[b]) for a, b in pairs])
    sides = tuple(_pair_side(a, b) for a, b in pairs)
    return Skeleton(body.landmark_joint, body.landmark_local, segments, sides)


def _pair_side(a: str, b: str) -> Side:
    sides = {side_of(a), side_of(b)} - {"trunk"}
    return next(iter(sides)) if len(sides) == 1 else "trunk"


def _joint_tree(body: Body) -> Skeleton:
    model = body.model
    first = _first_joint(body)
    children = [j for j in range(first, model.njoints) if np.linalg.norm(model.jointPlacements[j].translation) > 1e-3]
    joints = [j for child in children for j in (model.parents[child], child)]
    local = np.zeros((len(joints), 3))
    return Skeleton(
        np.array(joints, dtype=np.int64),
        local,
        np.arange(len(joints)).reshape(-1, 2),
        tuple(side_of(model.names[j]) for j in children),
    )
