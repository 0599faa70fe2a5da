"""Limbs as nodes of a graph, and where they are in a pose (loose-limbed people, Sigal et al., CVPR 2004, section 2):
cones with elliptic section.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError, nearest


@dataclass(frozen=True, eq=False)
class Limb:
    """A tapered cone with elliptic section on a link.

    Its frame has its origin at the proximal joint, z towards the distal joint or the end, x and y along the main axes
    of the section. What is merged into a limb is rigid with `link`, which alone determines the limb's placement.

    name: that of the link with the most surface. links: the links merged into it. link: the link that carries it.
    t_link_limb (3,) [m], R_link_limb (3, 3): the limb's frame in that link's.
    length: from the proximal joint to the distal joint or end [m].
    start, end: where along z the cone begins and ends [m]; flesh extends beyond joints, so start is mostly below 0.
    proximal, distal (2,): semi-axes along x and y at start and at end [m].
    """

    name: str
    links: tuple[str, ...]
    link: str
    t_link_limb: np.ndarray
    R_link_limb: np.ndarray
    length: float
    start: float
    end: float
    proximal: np.ndarray
    distal: np.ndarray

    def semi_axes(self, z: np.ndarray) -> np.ndarray:
        """Semi-axes (..., 2) [m] of the section at z (...) [m]; beyond the ends, those of the ends."""
        share = np.clip((np.asarray(z, dtype=float) - self.start) / (self.end - self.start), 0.0, 1.0)
        return np.asarray(self.proximal + share[..., None] * (self.distal - self.proximal))


@dataclass(frozen=True, eq=False)
class LimbGraph:
    """limbs (L): inner ones first. edges: pairs (i, j), i < j, of limbs that joints connect; a subject's are a tree.
    mirror (L): index of the limb on the other side of the body, its own where there is none."""

    limbs: tuple[Limb, ...]
    edges: tuple[tuple[int, int], ...]
    mirror: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The limbs' names, (L)."""
        return tuple(limb.name for limb in self.limbs)

    @property
    def directed(self) -> tuple[tuple[int, int], ...]:
        """Every edge there and back: an edge of the tree carries two messages."""
        return tuple(pair for i, j in self.edges for pair in ((i, j), (j, i)))

    def index(self, name: str) -> int:
        """The place of a limb. Raises InputError for an unknown name."""
        if name not in self.names:
            raise InputError(name, "there is no such limb", place="limb", remedy=nearest(name, self.names, "limbs"))
        return self.names.index(name)


def limb_placements(
    graph: LimbGraph, body: Body, posed: PosedBody | PlacedBodies | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Placements of the limbs in the world: t (L, 3) [m] and R (L, 3, 3), T_world_limb of each.

    posed: a pose (`Body.at`) or q (nq,). Of many, `Body.placed` or q (N, nq), t (N, L, 3) and R (N, L, 3, 3): each is
    what it is alone, to the last bit. body: the graph's, or one of other lengths with the same links.

    Raises
    ------
    InputError: the body lacks a link of the graph, or q has the wrong size.
    """
    if isinstance(posed, PosedBody):
        placements, alone = posed.placements[None], True
    elif isinstance(posed, PlacedBodies):
        placements, alone = posed.placements, False
    else:
        q = np.asarray(posed, dtype=float)
        if q.ndim not in (1, 2) or q.shape[-1] != body.nq:
            remedy = f"({body.nq},) or (N, {body.nq})"
            raise InputError("q", f"has the shape {q.shape}", place="limb placements", remedy=remedy)
        alone = q.ndim == 1
        placements = body.placed(np.ascontiguousarray(np.atleast_2d(q))).placements
    t, R = limbs_placed(placements, *limbs_on_joints(graph, body))
    return (t[0], R[0]) if alone else (t, R)


def limbs_placed(placements: np.ndarray, joint: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`limb_placements` of N placements (N, njoints, 12), joint (L,) and local (L, 3, 4) being of `limbs_on_joints`."""
    t = np.empty((len(placements), len(joint), 3))
    R = np.empty((len(placements), len(joint), 3, 3))
    _place(np.ascontiguousarray(placements), joint, local, t, R)
    return t, R


def limbs_on_joints(graph: LimbGraph, body: Body) -> tuple[np.ndarray, np.ndarray]:
    """The joint that moves each limb (L,), and the limb's frame in the joint's, (L, 3, 4): R_joint_limb, t. Raises
    InputError for a body that lacks a link of the graph."""
    joint, local = np.empty(len(graph.limbs), dtype=np.int64), np.empty((len(graph.limbs), 3, 4))
    for k, limb in enumerate(graph.limbs):
        if not body.model.existBodyName(limb.link):
            remedy = "place limbs with the body, or one of the same links, that the graph was made of"
            raise InputError(body.subject.source, f"has no link {limb.link!r}", place=limb.name, remedy=remedy)
        frame = body.model.frames[body.model.getFrameId(limb.link, pin.FrameType.BODY)]
        joint[k] = frame.parentJoint
        local[k, :, :3] = frame.placement.rotation @ limb.R_link_limb
        local[k, :, 3] = frame.placement.act(limb.t_link_limb)
    return joint, local


@jit
def _place(placements, joint, local, t, R):  # type: ignore[no-untyped-def]
    """Fill t (N, L, 3) and R (N, L, 3, 3) of limbs on joint (L,), their frames there local (L, 3, 4), for placements
    (N, njoints, 12)."""
    for n in range(placements.shape[0]):
        for k in range(joint.shape[0]):
            M, x = placements[n, joint[k]], local[k]
            for i in range(3):
                for j in range(3):
                    R[n, k, i, j] = M[i] * x[0, j] + M[3 + i] * x[1, j] + M[6 + i] * x[2, j]
                t[n, k, i] = (M[i] * x[0, 3] + M[3 + i] * x[1, 3] + M[6 + i] * x[2, 3]) + M[9 + i]


_THINNEST = 1e-3  # m
_MOST = 100  # evaluations of a fit
_FEWEST = 6  # nodes, below which nothing is fitted


@dataclass(frozen=True, eq=False)
class Cone:
    """Along z from start to end [m], semi-axes along x and y proximal (2,) and distal (2,) there [m]."""

    start: float
    end: float
    proximal: np.ndarray
    distal: np.ndarray


def cone_distance(cone: Cone, points: np.ndarray) -> np.ndarray:
    """Signed distance (N,) [m] of points (N, 3) in the cone's frame from its surface, negative inside.

    Sideways it is taken along the ray from the cone's axis, which is exact for a circular section and no taper.
    """
    return _distance(np.concatenate([[cone.start, cone.end], cone.proximal, cone.distal]), points)


def _distance(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    share = np.clip((points[:, 2] - p[0]) / (p[1] - p[0]), 0.0, 1.0)[:, None]
    axes = p[2:4] + share * (p[4:6] - p[2:4])
    off = np.hypot(points[:, 0], points[:, 1])
    level = np.hypot(points[:, 0] / axes[:, 0], points[:, 1] / axes[:, 1])
    inner = level < 1e-9  # on the axis
    reach = np.where(inner, axes.min(axis=1), off / np.where(inner, 1.0, level))
    side, cap = off - reach, np.maximum(p[0] - points[:, 2], points[:, 2] - p[1])
    outside = np.hypot(np.maximum(side, 0.0), np.maximum(cap, 0.0))
    return np.asarray(np.where(outside > 0.0, outside, np.maximum(side, cap)))


def fitted_cone(points: np.ndarray, near: float) -> Cone:
    """The cone nearest to points (N, 3) in its frame [m].

    Distances beyond `near` [m] count linearly. Starts from the points' own extent and spread; no semi-axis becomes
    longer than the points reach along it.
    """
    z = points[:, 2]
    low, high = float(z.min()), float(z.max())
    if high - low < 2.0 * _THINNEST:
        middle = (low + high) / 2.0
        low, high = middle - _THINNEST, middle + _THINNEST
    spread = np.maximum(np.sqrt(2.0 * np.mean(points[:, :2] ** 2, axis=0)), 2.0 * _THINNEST)
    if len(points) < _FEWEST:
        return Cone(low, high, spread, spread.copy())
    size = high - low
    widest = np.abs(points[:, :2]).max(axis=0) + 4.0 * _THINNEST
    # the ends stay apart: each has its own half of the extent, and a little beyond
    middle, over = (low + high) / 2.0, 0.1 * size
    lower = np.array([low - over, middle + 0.05 * size, *(4 * [_THINNEST])])
    upper = np.array([middle - 0.05 * size, high + over, *widest, *widest])
    first = np.clip([low, high, *spread, *spread], lower, upper)
    x = least_squares(
        _distance, first, bounds=(lower, upper), loss="soft_l1", f_scale=near, args=(points,), max_nfev=_MOST
    ).x
    return Cone(float(x[0]), float(x[1]), x[2:4].copy(), x[4:6].copy())


def cone_surface(cone: Cone, around: int = 48, along: int = 24) -> np.ndarray:
    """Points on the cone's surface, ends included, (around * (2 along + 1), 3) [m]."""
    angle = 2.0 * np.pi * np.arange(around) / around
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    share = np.linspace(0.0, 1.0, along + 1)
    axes = cone.proximal + share[:, None] * (cone.distal - cone.proximal)
    height = np.repeat(cone.start + share * (cone.end - cone.start), around)
    rings = [np.concatenate([(axes[:, None] * circle).reshape(-1, 2), height[:, None]], axis=1)]
    for axes_there, z in ((cone.proximal, cone.start), (cone.distal, cone.end)):
        disc = (np.linspace(0.0, 1.0, along // 2, endpoint=False)[:, None, None] * axes_there * circle).reshape(-1, 2)
        rings.append(np.concatenate([disc, np.full((len(disc), 1), z)], axis=1))
    return np.concatenate(rings)
