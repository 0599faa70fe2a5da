"""Limbs as nodes of a graph, and where they are in a pose (loose-limbed people, Sigal et al., CVPR 2004, section 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError
from humanoid.support.near_names import nearest


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
