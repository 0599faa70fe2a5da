"""Flesh of a single part as nodes and meshes: its surface over a 2D domain, and triangulations of that domain.

A node u = (latitude, longitude) is a place in the domain of `humanoid.subject.superquadric`. A capsule, (r, length l),
has the same longitudes; its latitudes run from -2 to 2: the cylinder between -1 and 1, z = u l / 2, and a hemisphere
beyond either. Points are linear in a capsule's sizes then, as they are in the radii of the other shapes.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.subject import superquadric
from humanoid.subject.urdf_flesh import Flesh

_FINE = 97  # points that arc lengths are measured on
_FEWEST = 5  # nodes on a ring


class Nodes(NamedTuple):
    """A closed triangulation. u (N, 2): nodes in the domain. faces (F, 3): counter-clockwise seen from outside."""

    u: np.ndarray
    faces: np.ndarray


def flesh_points(flesh: Flesh, u: np.ndarray) -> np.ndarray:
    """Points (N, 3) [m] of a part at u (N, 2), in the frame of its link."""
    if flesh.shape == "capsule":
        own = flesh.size[0] * _capsule_normals(u)
        own[:, 2] += np.clip(u[:, 0], -1.0, 1.0) * flesh.size[1] / 2.0
    else:
        own = superquadric.points(flesh.parameters, u)
    return own @ flesh.R_link_part.T + np.array(flesh.xyz)


def flesh_normals(flesh: Flesh, u: np.ndarray) -> np.ndarray:
    """Outward unit normals (N, 3) of a part at u (N, 2), in the frame of its link."""
    own = _capsule_normals(u) if flesh.shape == "capsule" else superquadric.normals(flesh.parameters, u)
    return own @ flesh.R_link_part.T


def flesh_derivatives(flesh: Flesh, u: np.ndarray) -> np.ndarray:
    """Derivatives of the points by `Flesh.parameters`, (N, 3, 9), in the frame of the link.

    A capsule has two: by its radius and its length; the other seven are zero.
    """
    if flesh.shape == "capsule":
        own = np.zeros((len(u), 3, 9))
        own[:, :, 0] = _capsule_normals(u)
        own[:, 2, 1] = np.clip(u[:, 0], -1.0, 1.0) / 2.0
    else:
        own = superquadric.derivatives(flesh.parameters, u)
    return np.einsum("ij,njk->nik", flesh.R_link_part, own)


def _capsule_normals(u: np.ndarray) -> np.ndarray:
    latitude = np.sign(u[:, 0]) * np.maximum(np.abs(u[:, 0]) - 1.0, 0.0) * np.pi / 2.0
    across = np.cos(latitude)
    return np.stack([across * np.cos(u[:, 1]), across * np.sin(u[:, 1]), np.sin(latitude)], axis=-1)


def even_nodes(flesh: Flesh, spacing: float) -> Nodes:
    """Rings about the part's z axis `spacing` [m] apart, with nodes as far apart on them, and a node at each pole.

    Lengths are measured on the surface, so that neither the poles nor the edges of squarish parts are crowded.
    """
    arc, latitudes = _meridian(flesh)
    count = max(4, round(arc[-1] / spacing))
    rings = [np.array([[latitudes[0], 0.0]])]
    within = np.interp(arc[-1] * np.arange(1, count) / count, arc, latitudes)
    lengths, longitudes = _parallels(flesh, within)
    for k, (latitude, around) in enumerate(zip(within, lengths, strict=True), start=1):
        nodes = max(_FEWEST, round(around[-1] / spacing))
        at = (np.arange(nodes) + 0.5 * (k % 2)) / nodes  # every other ring is turned: triangles, not slivers
        rings.append(np.stack([np.full(nodes, latitude), np.interp(at * around[-1], around, longitudes)], axis=-1))
    rings.append(np.array([[latitudes[-1], 0.0]]))
    return _stitched(rings)


def grid_nodes(flesh: Flesh, around: int, along: int) -> Nodes:
    """`along` rings of `around` nodes each, and a node at each pole: (around * along + 2) nodes."""
    arc, latitudes = _meridian(flesh)
    rings = [np.array([[latitudes[0], 0.0]])]
    within = np.interp(arc[-1] * (np.arange(along) + 0.5) / along, arc, latitudes)
    lengths, longitudes = _parallels(flesh, within)
    for latitude, length in zip(within, lengths, strict=True):
        at = np.interp(np.arange(around) / around * length[-1], length, longitudes)
        rings.append(np.stack([np.full(around, latitude), at], axis=-1))
    rings.append(np.array([[latitudes[-1], 0.0]]))
    return _stitched(rings)


def surface_area(flesh: Flesh) -> float:
    """Area of a part's surface [m^2], to a few per cent."""
    u, faces = grid_nodes(flesh, 16, 12)
    p = flesh_points(flesh, u)[faces]
    return float(np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2.0)


def _meridian(flesh: Flesh) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths from the lower pole, mean of two meridians a quarter turn apart, and their latitudes."""
    if flesh.shape == "capsule":
        latitudes = np.linspace(-2.0, 2.0, 4 * (_FINE // 4) + 1)
    else:
        latitudes = _spread(np.linspace(-np.pi / 2, np.pi / 2, _FINE), flesh.exponents[0])
    steps = np.zeros(len(latitudes) - 1)
    for longitude in (0.0, np.pi / 2):
        p = flesh_points(flesh, np.stack([latitudes, np.full(len(latitudes), longitude)], axis=-1))
        steps += np.linalg.norm(np.diff(p, axis=0), axis=1) / 2.0
    return np.concatenate([[0.0], np.cumsum(steps)]), latitudes


def _parallels(flesh: Flesh, latitudes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths (R, F) [m] around a part at latitudes (R,), and their longitudes (F,), once round."""
    longitudes = np.linspace(-np.pi, np.pi, _FINE)
    if flesh.shape != "capsule":
        longitudes = _spread(longitudes, flesh.exponents[1])
    u = np.stack(np.broadcast_arrays(latitudes[:, None], longitudes), axis=-1)  # all at once: a dozen calls cost more
    p = flesh_points(flesh, u.reshape(-1, 2)).reshape(*u.shape[:2], 3)
    lengths = np.zeros(u.shape[:2])
    np.cumsum(np.linalg.norm(np.diff(p, axis=1), axis=2), axis=1, out=lengths[:, 1:])
    return lengths, longitudes


def _spread(direction: np.ndarray, exponent: float) -> np.ndarray:
    """Angles whose points (cos^e, sin^e) lie in the given directions: even on squarish curves too."""
    cos, sin = np.cos(direction), np.sin(direction)
    cos[np.abs(cos) < 1e-15] = 0.0
    sin[np.abs(sin) < 1e-15] = 0.0
    angles = np.arctan2(np.sign(sin) * np.abs(sin) ** (1.0 / exponent), np.sign(cos) * np.abs(cos) ** (1.0 / exponent))
    angles[0], angles[-1] = direction[0], direction[-1]  # -pi, which arctan2 gives as pi
    return angles


def _stitched(rings: list[np.ndarray]) -> Nodes:
    """Triangles between neighbouring rings, each ring's nodes being evenly spaced and in order of longitude."""
    faces: list[tuple[int, int, int]] = []
    low = 0
    for lower, upper in pairwise(rings):
        high = low + len(lower)
        faces += _strip(low, len(lower), high, len(upper), _phase(lower), _phase(upper))
        low = high
    return Nodes(np.concatenate(rings), np.array(faces, dtype=np.int64))


def _phase(ring: np.ndarray) -> float:
    """Phase of the ring's first node, in steps between its nodes."""
    return 0.5 if len(ring) > 1 and ring[0, 1] > -np.pi + 1e-9 else 0.0


def _strip(low: int, m: int, high: int, n: int, p: float, q: float) -> list[tuple[int, int, int]]:
    """Triangles between a ring of m nodes from index `low` on and the ring of n above it from index `high` on.

    It goes round once, each time taking the next node of the ring that is behind; a ring of one node is a pole.
    """
    i = j = 0
    faces = []
    ends = (m if m > 1 else 0), (n if n > 1 else 0)
    while i < ends[0] or j < ends[1]:
        if j >= ends[1] or (i < ends[0] and (i + 0.5 + p) / m <= (j + 0.5 + q) / n):
            faces.append((low + i % m, low + (i + 1) % m, high + j % n))
            i += 1
        else:
            faces.append((low + i % m, high + (j + 1) % n, high + j % n))
            j += 1
    return faces


class FleshMesh(NamedTuple):
    """One part as triangles.

    link: the link it covers. joint: the Pinocchio joint that moves it.
    vertices (V, 3): in the joint's frame [m]. faces (F, 3) int: indices of vertices, counter-clockwise from outside.
    """

    link: str
    joint: int
    vertices: np.ndarray
    faces: np.ndarray


def solid_mesh(flesh: Flesh, around: int = 20, along: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a part in the frame of its link.

    `around` vertices on each ring about the part's z axis, `along` rings between the poles, evenly spaced on the
    surface. Returns vertices (around * along + 2, 3) [m] and faces (2 * around * along, 3).
    """
    nodes = grid_nodes(flesh, around, along)
    return flesh_points(flesh, nodes.u), nodes.faces


def flesh_meshes(body: Body, around: int = 20, along: int = 12) -> list[FleshMesh]:
    """Every part of the body's subject, in the file's order, in the frame of the joint that moves it."""
    meshes = []
    for flesh in body.subject.flesh:
        frame = body.model.frames[body.model.getFrameId(flesh.link, pin.FrameType.BODY)]
        vertices, faces = solid_mesh(flesh, around, along)
        placed = vertices @ frame.placement.rotation.T + frame.placement.translation
        meshes.append(FleshMesh(flesh.link, int(frame.parentJoint), placed, faces))
    return meshes
