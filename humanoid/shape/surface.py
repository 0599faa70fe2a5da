"""The body's surface as nodes with normals and triangles (CSS section 2, eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.shape.flesh import Nodes, even_nodes, flesh_normals, flesh_points, surface_area
from humanoid.shape.solids import Geometry
from humanoid.shape.surface_hulls import HullPart, hull_nodes, hull_parts
from humanoid.subject.subject import Flesh
from humanoid.support.errors import InputError

_ROUNDS = 3  # of matching the spacing to the requested number of nodes
_HIDDEN = 1e-3  # m; a part whose front rises this little over its own tangent planes hides nothing worth a test


@dataclass(frozen=True)
class Surface:
    """Nodes of every part, fixed to joints.

    links (B): the link that each part covers. convex (B,) bool: whether a part can hide no node of its own front.
    part (N,) int, joint (N,) int: of each node. local (N, 3) [m], normal (N, 3): in the joint's frame, outward.
    faces (F, 3) int: triangles of nodes of one part, counter-clockwise from outside; every part is closed.
    """

    links: tuple[str, ...]
    convex: np.ndarray
    part: np.ndarray
    joint: np.ndarray
    local: np.ndarray
    normal: np.ndarray
    faces: np.ndarray


def surface_of(body: Body, nodes: int = 1000, geometry: Geometry = "auto") -> Surface:
    """The body's surface with about `nodes` nodes, evenly spread over the area of all its parts.

    geometry: "flesh"; "visual" or "collision", the URDF's own shapes, each as its convex hull, which is covered with
    nodes of its own (`humanoid.shape.surface_hulls`); "auto": flesh, else visual, else collision. Every part has 17
    nodes at least, so a body of many small parts has more nodes than requested.

    Raises
    ------
    InputError: the body has no such geometry, a mesh cannot be read, or `nodes` is below 1.
    """
    if nodes < 1:
        raise InputError(str(nodes), "is not a number of nodes", place="nodes", remedy="about 1000")
    if geometry == "flesh" or (geometry == "auto" and body.subject.flesh):
        if not body.subject.flesh:
            raise InputError(body.subject.source, "has no flesh", remedy='add <flesh> to its links, or geometry="auto"')
        return flesh_surface(body, spread_nodes(body.subject.flesh, nodes))
    return _hull_surface(hull_parts(body, geometry), nodes)


def spread_nodes(flesh: Sequence[Flesh], nodes: int) -> tuple[Nodes, ...]:
    """Nodes of every part, about `nodes` of them together, at one spacing; their arrays are read-only."""
    return _spread_nodes(tuple(flesh), nodes)


@lru_cache(maxsize=16)  # a third of a second, needed by every tracker, renderer and picture of the same few bodies
def _spread_nodes(flesh: tuple[Flesh, ...], nodes: int) -> tuple[Nodes, ...]:
    spacing = np.sqrt(2.0 / np.sqrt(3.0) * sum(surface_area(f) for f in flesh) / nodes)  # of equilateral triangles
    for _ in range(_ROUNDS):
        parts = [even_nodes(f, spacing) for f in flesh]
        spacing *= np.sqrt(sum(len(n.u) for n in parts) / nodes)
    for array in (array for part in parts for array in part):
        array.flags.writeable = False
    return tuple(parts)


def flesh_surface(body: Body, nodes: Sequence[Nodes], flesh: Sequence[Flesh] | None = None) -> Surface:
    """The surface of given nodes of every part; `flesh` replaces the subject's parts, in their order."""
    flesh = body.subject.flesh if flesh is None else flesh
    frames = [body.model.frames[body.model.getFrameId(f.link, pin.FrameType.BODY)] for f in flesh]
    local = [
        flesh_points(f, n.u) @ frame.placement.rotation.T + frame.placement.translation
        for f, n, frame in zip(flesh, nodes, frames, strict=True)
    ]
    normal = [
        flesh_normals(f, n.u) @ frame.placement.rotation.T for f, n, frame in zip(flesh, nodes, frames, strict=True)
    ]
    joints = [int(frame.parentJoint) for frame in frames]
    convex = [_is_convex(p, n) for p, n in zip(local, normal, strict=True)]
    return _joined([f.link for f in flesh], joints, convex, local, normal, [n.faces for n in nodes])


def _hull_surface(parts: Sequence[HullPart], nodes: int) -> Surface:
    spacing = np.sqrt(2.0 / np.sqrt(3.0) * sum(p.area for p in parts) / nodes)
    for _ in range(_ROUNDS):
        spread = [hull_nodes(p, spacing) for p in parts]
        spacing *= np.sqrt(sum(len(local) for local, _, _ in spread) / nodes)
    local, normal, faces = ([f[k] for f in spread] for k in range(3))
    return _joined([p.link for p in parts], [p.joint for p in parts], [True] * len(parts), local, normal, faces)


def _joined(
    links: Sequence[str],
    joints: Sequence[int],
    convex: Sequence[bool],
    local: Sequence[np.ndarray],
    normal: Sequence[np.ndarray],
    faces: Sequence[np.ndarray],
) -> Surface:
    """One surface of parts, each with the triangles of its own nodes."""
    counts = [len(p) for p in local]
    starts = np.cumsum([0, *counts[:-1]])
    return Surface(
        tuple(links),
        np.array(convex),
        np.repeat(np.arange(len(links)), counts),
        np.repeat(np.array(joints, dtype=np.int64), counts),
        np.concatenate(local),
        np.concatenate(normal),
        np.concatenate([f + start for f, start in zip(faces, starts, strict=True)]),
    )


def _is_convex(local: np.ndarray, normal: np.ndarray) -> bool:
    """No node lies outside the tangent plane of another by more than a millimetre; some hundred of them are tested."""
    some = slice(None, None, 1 + len(local) // 400)
    return bool((local[some] @ normal[some].T - np.einsum("ni,ni->n", local, normal)[some]).max() < _HIDDEN)
