"""Limbs as examples have them, put onto a pose and ranked by the surface that is seen: limbs are nearly independent,
and few examples are near in all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.numerics.closest import closest
from estimator.search.jumps.anatomy import TwoSegmentLimb
from estimator.vision.cues.depth import Depth
from estimator.vision.cues.depth_reading import spread_over
from humanoid.kinematics.body import Body, PlacedBodies, directions_in_world, points_in_world, points_of_each
from humanoid.shape.surface import Surface
from humanoid.support.compiled import jit

_STILL = 0.25  # rad: a local search finds what moves less
_NODES, _POINTS = 40, 200  # of a limb, and of what a camera sees, at most
_ALIKE = 0.1  # m: limbs none of whose parts are farther apart lead to one mode


class SeenPoints(NamedTuple):
    """The person's surface as seen: points (P, 3) in the world [m], the eyes (E, 3) that see them, and the deviation of
    a point from its body [m]; robust with `nu` (Lorentzian)."""

    points: np.ndarray
    eyes: np.ndarray
    std: float
    nu: float


def seen_points(observation: Observation, noise: float, nu: float) -> SeenPoints | None:
    """The seen points of all cameras, where the body's surface differs from the person's by `noise` [m]; None where no
    camera has any."""
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

    def __init__(self, body: Body, surface: Surface, limbs: Sequence[TwoSegmentLimb], q: np.ndarray) -> None:
        self.body, self.surface, self.q = body, surface, q
        place = dict(zip(body.bounded_v.tolist(), body.bounded_q.tolist(), strict=True))
        moved = np.flatnonzero(q.std(axis=0) > _STILL)
        turned = [_behind(body, int(limb.dofs[0])) for limb in limbs]
        able = [k for k, dofs in enumerate(turned) if set(dofs) <= place.keys()]
        chosen = [k for k in able if np.isin([place[dof] for dof in limbs[k].dofs.tolist()], moved).any()]
        self.limbs = [limbs[k] for k in chosen]
        self._places = [[place[dof] for dof in turned[k]] for k in chosen]
        moves = np.array([body.support(joint) for joint in surface.joint])
        nodes = [np.flatnonzero(moves[:, limb.dofs[0]]) for limb in self.limbs]
        self._others = [np.setdiff1d(np.arange(len(surface.joint)), own) for own in nodes]
        self._nodes = [own[spread_over(len(own), _NODES)] for own in nodes]
        self._thinned = [len(few) / len(own) for few, own in zip(self._nodes, nodes, strict=True)]
        self._parts = [_parts(body, surface, limb, own) for limb, own in zip(self.limbs, nodes, strict=True)]
        placements = body.placed(q).placements
        self._T_root_parts = [_about(placements, part.root, part.joints) for part in self._parts]

    def with_limb(self, q: np.ndarray, k: int, others: np.ndarray) -> np.ndarray:
        """Poses (N, nq): q (nq,) with its k-th limb, and what that carries, from other poses (N, nq); not clamped."""
        changed = np.repeat(q[None], len(others), axis=0)
        changed[:, self._places[k]] = others[:, self._places[k]]
        return changed

    def best(self, q: np.ndarray, k: int, others: np.ndarray, seen: SeenPoints, count: int) -> np.ndarray:
        """The `count` poses (C, nq), or as many as are distinct, that fit the observation best, among q (nq,) with its
        k-th limb from the bank's poses or others (N, nq): by a cheap likeness of ELMO's eq. 1, both ways, in which no
        part hides another."""
        changed, placements = self.with_limb(q, k, np.concatenate([others, self.q])), self._placed(q, k, others)
        order, parts = np.argsort(self._scores(q, k, placements, seen), kind="stable"), self._parts[k]
        middles = points_of_each(PlacedBodies(changed, placements), np.arange(len(parts.joints)), parts.middle)
        best = order[_apart(middles[order], count)]
        return np.array([self.body.clamp(pose) for pose in changed[best]])

    def _placed(self, q: np.ndarray, k: int, others: np.ndarray) -> np.ndarray:
        """Placements (N + B, J, 12) in the world of the k-th limb's joints as other poses (N, nq) and the bank's have
        it, on a pose q (nq,)."""
        root, joints, _ = self._parts[k]
        T_root_parts = np.concatenate(
            [_about(self.body.placed(others).placements, root, joints), self._T_root_parts[k]]
        )
        columns = T_root_parts.reshape(*T_root_parts.shape[:2], 4, 3)
        T_world_root = self.body.at(q).placements[root]
        turned = np.einsum("cr,njkc->njkr", T_world_root[:9].reshape(3, 3), columns)
        turned[:, :, 3] += T_world_root[9:]
        return np.asarray(turned.reshape(T_root_parts.shape))

    def _scores(self, q: np.ndarray, k: int, placements: np.ndarray, seen: SeenPoints) -> np.ndarray:
        """Energy (N,) of a pose q (nq,) with the joints of its k-th limb at placements (N, J, 12), except a common
        constant."""
        s, mine = self.surface, self._nodes[k]
        others, posed = self._others[k], self.body.at(q)
        rest = points_in_world(posed, s.joint[others], s.local[others])
        normals = directions_in_world(posed, s.joint[others], s.normal[others])
        rest = rest[(np.einsum("ni,eni->en", normals, rest - seen.eyes[:, None]) < 0.0).any(axis=0)]
        beside = closest(seen.points, rest)[1]
        joint = np.searchsorted(self._parts[k].joints, s.joint[mine])
        score, limb = np.empty(len(placements)), (joint, s.local[mine], s.normal[mine])
        scale = seen.nu * seen.std**2, self._thinned[k] * len(rest), float(len(seen.points))
        left = beside > seen.std**2  # the others belong to the rest of the body
        _score(placements, *limb, seen.eyes, seen.points, np.flatnonzero(left), beside[left], scale, score)
        return score


class _Parts(NamedTuple):
    """The joint that a limb hangs on, the joints (J,) that its nodes are on, and in the frame of each the middle (J, 3)
    of its nodes [m]."""

    root: int
    joints: np.ndarray
    middle: np.ndarray


def _parts(body: Body, surface: Surface, limb: TwoSegmentLimb, nodes: np.ndarray) -> _Parts:
    """The parts of a limb with some nodes."""
    joints = np.unique(surface.joint[nodes])
    middle = np.array([surface.local[nodes[surface.joint[nodes] == j]].mean(axis=0) for j in joints])
    return _Parts(int(body.model.parents[int(body.tree.dof_joint[limb.dofs[0]])]), joints, middle)


def _behind(body: Body, first: int) -> list[int]:
    """A degree of freedom and those that it turns."""
    turned = {first}
    for dof in range(first + 1, body.nv):
        if int(body.tree.dof_parent[dof]) in turned:
            turned.add(dof)
    return sorted(turned)


def _about(placements: np.ndarray, root: int, joints: np.ndarray) -> np.ndarray:
    """Placements (N, J, 12) of some joints in the frame of another, of all in the world (N, njoints, 12)."""
    columns = placements[:, joints].reshape(len(placements), len(joints), 4, 3)
    columns[:, :, 3] -= placements[:, None, root, 9:]
    R_world_root = placements[:, root, :9].reshape(-1, 3, 3)  # transposed
    return np.asarray(np.einsum("ncr,njkr->njkc", R_world_root, columns).reshape(len(placements), len(joints), 12))


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
    """Fill score (N,) for placements (N, J, 12) of a limb whose nodes are on joint (L,) of these at local (L, 3) with
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
    and return how many: on joint (L,) at local (L, 3) with normal (L, 3); placements (J, 12)."""
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
