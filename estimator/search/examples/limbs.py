"""Limbs as examples have them, put onto a pose and ranked by the surface that is seen: limbs are nearly independent,
and few examples are near in all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from estimator.cues.depth.cue import Depth
from estimator.cues.depth.matching import spread_over
from estimator.imaging.observation import Observation
from estimator.numerics.closest import closest
from estimator.search.jumps.anatomy import Limb
from humanoid.kinematics.body import Body, directions_in_world, points_in_world
from humanoid.shape.surface import Surface
from humanoid.support.compiled import jit

_STILL = 0.25  # rad: a local search finds what moves less
_NODES, _POINTS = 40, 200  # of a limb, and of what a camera sees, at most
_ALIKE = 0.1  # m: limbs none of whose parts are farther apart lead to one mode


class SeenPoints(NamedTuple):
    """The person's surface as seen: points (P, 3) in the world [m], the eyes (E, 3) that see them, and by how much a
    point may lie beside the body that it is of [m]; robust with `nu` (Lorentzian)."""

    points: np.ndarray
    eyes: np.ndarray
    std: float
    nu: float


def seen_points(observation: Observation, noise: float, nu: float) -> SeenPoints | None:
    """Those of all cameras, where the body's surface is another than the person's by `noise` [m]; None where no camera
    has any."""
    seen = [(cues[Depth.name].points, cues.camera) for cues in observation.cues if Depth.name in cues]
    if not seen:
        return None
    chosen = [points.some(spread_over(len(points), _POINTS)) for points, _ in seen]
    std = float(np.median(np.concatenate([np.hypot(points.along, noise) for points in chosen])))
    eyes = np.array([camera.centre_world for _, camera in seen])
    return SeenPoints(np.concatenate([points.places for points in chosen]), eyes, std, nu)


class LimbBank:
    """Many poses' limbs, each by itself; those that are nearly alike in all of them are left out.

    Parameters
    ----------
    body: of the poses.
    surface: its nodes.
    limbs: which.
    q (B, nq): the poses.
    """

    def __init__(self, body: Body, surface: Surface, limbs: Sequence[Limb], q: np.ndarray) -> None:
        self.body, self.surface, self.q = body, surface, q
        place = dict(zip(body.bounded_v.tolist(), body.bounded_q.tolist(), strict=True))
        moved = np.flatnonzero(q.std(axis=0) > _STILL)
        able = [limb for limb in limbs if set(limb.dofs.tolist()) <= place.keys()]
        self.limbs = [limb for limb in able if np.isin([place[dof] for dof in limb.dofs.tolist()], moved).any()]
        self._places = [[place[dof] for dof in limb.dofs.tolist()] for limb in self.limbs]
        moves = np.array([body.support(joint) for joint in surface.joint])
        nodes = [np.flatnonzero(moves[:, limb.dofs[0]]) for limb in self.limbs]
        self._others = [np.setdiff1d(np.arange(len(surface.joint)), own) for own in nodes]
        self._nodes = [own[spread_over(len(own), _NODES)] for own in nodes]
        self._thinned = [len(few) / len(own) for few, own in zip(self._nodes, nodes, strict=True)]
        self._parts = [_middles(surface, own) for own in nodes]

    def with_limb(self, q: np.ndarray, k: int, others: np.ndarray) -> np.ndarray:
        """A pose q (nq,) with its k-th limb as other poses (N, nq) have it, (N, nq); not clamped."""
        changed = np.repeat(q[None], len(others), axis=0)
        changed[:, self._places[k]] = others[:, self._places[k]]
        return changed

    def best(self, q: np.ndarray, k: int, others: np.ndarray, seen: SeenPoints, count: int) -> np.ndarray:
        """Of a pose q (nq,) with its k-th limb as the bank's poses or others (N, nq) have it the `count` that lie best
        on what is seen, or as many as are not alike, (C, nq): by a cheap likeness of ELMO's eq. 1, both ways, in which
        no part hides another."""
        changed = self.with_limb(q, k, np.concatenate([others, self.q]))
        placements = self.body.placed(changed).placements
        order = np.argsort(self._scores(q, k, placements, seen), kind="stable")
        best = order[_apart(self._places_of_parts(k, placements)[order], count)]
        return np.array([self.body.clamp(pose) for pose in changed[best]])

    def _places_of_parts(self, k: int, placements: np.ndarray) -> np.ndarray:
        """Where the middles of the k-th limb's parts are in the world [m], (N, J, 3) of placements (N, njoints, 12)."""
        joints, local = self._parts[k]
        T_world_joint = placements[:, joints]
        columns = T_world_joint[..., :9].reshape(*T_world_joint.shape[:2], 3, 3)
        return np.asarray(np.einsum("njcr,jc->njr", columns, local) + T_world_joint[..., 9:])

    def _scores(self, q: np.ndarray, k: int, placements: np.ndarray, seen: SeenPoints) -> np.ndarray:
        """Energy (N,) of the pose changed to placements (N, njoints, 12), but for what does not change."""
        s, mine = self.surface, self._nodes[k]
        others, posed = self._others[k], self.body.at(q)
        rest = points_in_world(posed, s.joint[others], s.local[others])
        normals = directions_in_world(posed, s.joint[others], s.normal[others])
        rest = rest[(np.einsum("ni,eni->en", normals, rest - seen.eyes[:, None]) < 0.0).any(axis=0)]
        beside = cKDTree(rest).query(seen.points)[0] if len(rest) else np.full(len(seen.points), np.inf)
        score, limb = np.empty(len(placements)), (s.joint[mine], s.local[mine], s.normal[mine])
        scale = seen.nu * seen.std**2, self._thinned[k] * len(rest), float(len(seen.points))
        left = beside > seen.std  # the others belong to the rest of the body
        _score(placements, *limb, seen.eyes, seen.points, np.flatnonzero(left), np.square(beside[left]), scale, score)
        return score


def _middles(surface: Surface, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The joints (J,) that nodes are on, and the middles (J, 3) of those on each in its frame [m]."""
    joints = np.unique(surface.joint[nodes])
    return joints, np.array([surface.local[nodes[surface.joint[nodes] == j]].mean(axis=0) for j in joints])


def _apart(places: np.ndarray, count: int) -> list[int]:
    """The first `count` of limbs with parts at places (N, J, 3) that are not alike, or as many as there are."""
    far = np.full(len(places), np.inf)
    chosen: list[int] = []
    while len(chosen) < count and (far > _ALIKE).any():
        chosen.append(int(np.argmax(far > _ALIKE)))
        far = np.minimum(far, np.linalg.norm(places - places[chosen[-1]], axis=2).max(axis=1))
    return chosen


@jit
def _score(placements, joint, local, normal, eyes, points, left, beside, scale, score):  # type: ignore[no-untyped-def]
    """Fill score (N,) for placements (N, njoints, 12) of a limb whose nodes are on joint (L,) at local (L, 3) with
    normal (L, 3): those that face one of the eyes (E, 3), from the points (P, 3); and back, for the points left (R,)
    int, whose squared distances from the rest of the body are beside (R,). scale (3,): the squared distance that counts
    as log 2, how many other nodes face an eye, and how many points there are.
    """
    nodes, count = np.empty((placements.shape[0] * len(joint), 3)), np.zeros(placements.shape[0] + 1, np.int64)
    for n in range(placements.shape[0]):
        count[n + 1] = count[n] + _facing_nodes(placements[n], joint, local, normal, eyes, nodes[count[n] :])
    off = np.log1p(closest(nodes[: count[-1]], points)[1] / scale[0])
    apart, nearest = np.ascontiguousarray(points[left].T), np.empty(len(left))
    for n in range(placements.shape[0]):
        nearest[:] = beside
        for i in range(count[n], count[n + 1]):
            _keep_closer(nearest, apart, nodes[i])
        own = max(scale[1] + count[n + 1] - count[n], 1.0)
        score[n] = off[count[n] : count[n + 1]].sum() / own + np.log1p(nearest / scale[0]).sum() / scale[2]


@jit
def _facing_nodes(placements, joint, local, normal, eyes, nodes):  # type: ignore[no-untyped-def]
    """Fill the first of nodes (L, 3) with the places in the world of those of a limb that face one of the eyes (E, 3),
    and say how many: on joint (L,) at local (L, 3) with normal (L, 3); placements (njoints, 12)."""
    x, normal_world, count = np.empty(3), np.empty(3), 0
    for i in range(joint.shape[0]):
        M = placements[joint[i]]
        for k in range(3):
            x[k] = M[k] * local[i, 0] + M[3 + k] * local[i, 1] + M[6 + k] * local[i, 2] + M[9 + k]
            normal_world[k] = M[k] * normal[i, 0] + M[3 + k] * normal[i, 1] + M[6 + k] * normal[i, 2]
        if _faces(x, normal_world, eyes):
            nodes[count] = x
            count += 1
    return count


@jit
def _keep_closer(squared, places, x):  # type: ignore[no-untyped-def]
    """Lower the squared distances (P,) of places (3, P) to those from x (3,) that are less."""
    a, b, c = x[0], x[1], x[2]
    for p in range(squared.shape[0]):
        off = (places[0, p] - a) ** 2 + (places[1, p] - b) ** 2 + (places[2, p] - c) ** 2
        squared[p] = min(squared[p], off)


@jit
def _faces(x, normal, eyes):  # type: ignore[no-untyped-def]
    """Whether a surface at x (3,) with a normal (3,) faces one of the eyes (E, 3)."""
    for e in range(eyes.shape[0]):
        if (x[0] - eyes[e, 0]) * normal[0] + (x[1] - eyes[e, 1]) * normal[1] + (x[2] - eyes[e, 2]) * normal[2] < 0.0:
            return True
    return False
