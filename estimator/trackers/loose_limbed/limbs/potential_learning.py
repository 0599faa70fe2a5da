"""Potentials between limbs from poses: captured ones, or drawn at random without a capture (Sigal et al. 2004, 2.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from estimator.inference.beliefs.learning import LearnSettings, RelativePlacements, learned_mixture, mirrored_points
from estimator.inference.beliefs.space import PLACEMENTS, points_of
from estimator.trackers.loose_limbed.limbs.potentials import (
    Edge,
    LimbPotentials,
    LimbSteps,
    load_potentials,
    rest_offsets,
    shipped_potentials,
)
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limb_placements

_SAME = 0.02  # of the largest offset at rest, and of a rotation's entries: sides that differ less mirror each other


@dataclass(frozen=True)
class LimbPoses:
    """Placements of the limbs in poses, and in pairs of poses some time apart.

    spatial: by directed edge (i, j), X_i^-1 X_j of N poses, (N, 7). forward: by time step [s] and limb, X_i(t)^-1
    X_i(t + dt) of N pairs, (N, 7).
    """

    spatial: Mapping[Edge, np.ndarray]
    forward: Mapping[float, Sequence[np.ndarray]]

    @property
    def count(self) -> int:
        """The number of poses."""
        return len(next(iter(self.spatial.values())))

    def thinned(self, every: int) -> LimbPoses:
        """One of a number of poses, and of pairs."""
        spatial = {edge: points[::every] for edge, points in self.spatial.items()}
        return LimbPoses(spatial, {dt: [points[::every] for points in of] for dt, of in self.forward.items()})


def captured_poses(
    graph: LimbGraph, body: Body, motions: Sequence[tuple[np.ndarray, np.ndarray]], dt: float, steps: Sequence[float]
) -> LimbPoses:
    """The poses of motions: q (T, nq) `dt` [s] apart, and which of them (T,) are good enough.

    steps [s]: of the pairs, each from a pose to where the motion is later: on the straight way between two poses where
    that falls between them.
    """
    still = [q[good] for q, good in motions]
    pairs = {step: [_later(body, q, good, step / dt) for q, good in motions] for step in steps}
    return limb_poses(
        graph, body, np.concatenate(still),
        {s: (np.concatenate([a for a, _ in p]), np.concatenate([b for _, b in p])) for s, p in pairs.items()},
    )  # fmt: skip


def joined(clips: Sequence[LimbPoses]) -> LimbPoses:
    """The poses of all clips, with the same time steps."""
    spatial = {edge: np.concatenate([c.spatial[edge] for c in clips]) for edge in clips[0].spatial}
    forward = {
        dt: [np.concatenate([c.forward[dt][k] for c in clips]) for k in range(len(of))]
        for dt, of in clips[0].forward.items()
    }
    return LimbPoses(spatial, forward)


def _later(body: Body, q: np.ndarray, good: np.ndarray, frames: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, nq) and those that many frames later (N, nq); all that they come from are good."""
    whole = int(np.floor(frames + 1e-9))
    share = frames - whole if frames - whole > 1e-9 else 0.0
    last = whole + (share > 0.0)
    k = np.arange(max(len(q) - last, 0))
    k = k[good[k] & good[k + whole] & good[k + last]]
    later = q[k + whole]
    if share:
        way = [share * body.difference(a, b) for a, b in zip(later, q[k + last], strict=True)]
        later = body.integrated(later, np.array(way).reshape(-1, body.nv))
    return q[k], later


def random_poses(
    body: Body,
    graph: LimbGraph,
    count: int,
    steps: Sequence[float],
    speed: np.ndarray,
    rng: np.random.Generator,
) -> LimbPoses:
    """Random poses of any subject, for those without a capture, see `random_configurations`. A pose `dt` later differs
    by speed (nv,) [1/s] times dt times standard normal numbers."""
    q = random_configurations(body, count, rng)
    pairs = {dt: (q, body.integrated(q, dt * speed * rng.standard_normal((count, body.nv)))) for dt in steps}
    return limb_poses(graph, body, q, pairs)


def random_configurations(body: Body, count: int, rng: np.random.Generator) -> np.ndarray:
    """Configurations (count, nq) of any subject, a free root at the origin.

    Joints are drawn from their stabilisers' normal densities within the limits, those without one evenly within the
    limits; what has neither stays at rest.
    """
    q = np.repeat(body.neutral[None], count, axis=0)
    index = body.bounded_q
    low, high = body.lower[index], body.upper[index]
    q[:, index] = rng.uniform(low, high, (count, len(index)))
    for s in body.subject.stabilisers:
        if s.joint in body.q_names:
            k = body.q_names.index(s.joint)
            mean, std = s.moments
            share = ndtr((np.array([body.lower[k], body.upper[k]]) - mean) / std)
            lowest, highest = np.clip(share, 1e-12, 1.0 - 1e-12)
            q[:, k] = mean + std * ndtri(rng.uniform(float(lowest), float(highest), count))
    return np.array([body.clamp(pose) for pose in q])


def limb_poses(
    graph: LimbGraph, body: Body, q: np.ndarray, pairs: Mapping[float, tuple[np.ndarray, np.ndarray]]
) -> LimbPoses:
    """Placements in poses q (N, nq), and in pairs of poses by their time apart [s]."""
    t, R = limb_placements(graph, body, q)
    spatial = {(i, j): relative_points(t[:, i], R[:, i], t[:, j], R[:, j]) for i, j in graph.directed}
    forward = {}
    for dt, (now, later) in pairs.items():
        (t, R), (t1, R1) = limb_placements(graph, body, now), limb_placements(graph, body, later)
        forward[dt] = [relative_points(t[:, k], R[:, k], t1[:, k], R1[:, k]) for k in range(len(graph.limbs))]
    return LimbPoses(spatial, forward)


def relative_points(t_i: np.ndarray, R_i: np.ndarray, t_j: np.ndarray, R_j: np.ndarray) -> np.ndarray:
    """X_i^-1 X_j (eq. 2) as points (N, 7), of placements t (N, 3) [m], R (N, 3, 3)."""
    back = R_i.transpose(0, 2, 1)
    return points_of((back @ (t_j - t_i)[:, :, None])[:, :, 0], back @ R_j)


def learned_potentials(
    graph: LimbGraph, body: Body, poses: LimbPoses, settings: LearnSettings, seed: int = 0
) -> LimbPotentials:
    """Potentials of all edges in space and time of a graph; equal seeds, equal bits.

    Where the two sides of the body mirror each other at rest, both learn from both: the limbs of one side also from the
    mirrored poses, the other side has the mirror image of what they learn.

    Raises
    ------
    InputError: fewer poses, or pairs of any time step, than kernels.
    """
    other = graph.mirror if has_sides(graph, body) else tuple(range(len(graph.limbs)))
    mirrored = other != tuple(range(len(other)))
    spatial: dict[Edge, RelativePlacements] = {}
    for i, j in graph.directed:
        twin = other[i], other[j]
        if twin in spatial:
            spatial[i, j] = spatial[twin].mirrored()
            continue
        points = [poses.spatial[i, j], *([mirrored_points(poses.spatial[twin])] if mirrored else [])]
        spatial[i, j] = learned_mixture(np.concatenate(points), settings, np.random.default_rng((seed, i, j)))[0]
    steps = []
    for dt, forward in sorted(poses.forward.items()):
        both: list[tuple[RelativePlacements, RelativePlacements]] = []
        for k in range(len(other)):
            if other[k] < k:
                both.append((both[other[k]][0].mirrored(), both[other[k]][1].mirrored()))
                continue
            way = [forward[k], *([mirrored_points(forward[other[k]])] if mirrored else [])]
            there = np.concatenate(way)
            both.append(
                (
                    learned_mixture(there, settings, np.random.default_rng((seed, k)))[0],
                    learned_mixture(backward_points(there), settings, np.random.default_rng((seed, k)))[0],
                )
            )
        steps.append(LimbSteps(dt, tuple(f for f, _ in both), tuple(b for _, b in both)))
    return LimbPotentials(graph.names, spatial, rest_offsets(graph, body), tuple(steps))


def backward_points(points: np.ndarray) -> np.ndarray:
    """Relative placements (N, 7) the other way: X_ji of X_ij."""
    return PLACEMENTS.inverse(points)


def has_sides(graph: LimbGraph, body: Body) -> bool:
    """Whether the graph has limbs that mirror each other, and the body at rest is its own mirror image: then what is
    learned of one side applies to the other."""
    other = graph.mirror
    edges = set(graph.directed)
    if all(m == k for k, m in enumerate(other)) or any((other[i], other[j]) not in edges for i, j in edges):
        return False
    t, R = limb_placements(graph, body, body.neutral)
    size = max(float(np.linalg.norm(t[i] - t[j])) for i, j in edges)
    for i, j in edges:
        ends = [relative_points(t[[a]], R[[a]], t[[b]], R[[b]])[0] for a, b in ((i, j), (other[i], other[j]))]
        image = mirrored_points(ends[0][None])[0]
        turn = min(np.abs(image[3:] - s * ends[1][3:]).max() for s in (1.0, -1.0))
        if np.abs(image[:3] - ends[1][:3]).max() > _SAME * size or turn > _SAME:
            return False
    return True


def log_densities(potentials: LimbPotentials, poses: LimbPoses) -> tuple[float, dict[float, float]]:
    """Nats a pose of poses, mean of the directed edges in space; and by time step, mean of the limbs and of forward and
    backward.

    Raises
    ------
    InputError: a time step was not learned.
    """
    space = [float(p.log_density(poses.spatial[edge]).mean()) for edge, p in potentials.spatial.items()]
    time = {}
    for dt, forward in poses.forward.items():
        steps = potentials.steps(dt)
        ways = [(f, p) for f, p in zip(steps.forward, forward, strict=True)]
        ways += [(b, backward_points(p)) for b, p in zip(steps.backward, forward, strict=True)]
        time[dt] = float(np.mean([p.log_density(points).mean() for p, points in ways]))
    return float(np.mean(space)), time


_STEPS = (1.0 / 30.0, 1.0 / 10.0)  # s


_DRAWN = 400  # poses


_SEED = 0


def potentials_for(graph: LimbGraph, body: Body, speed: np.ndarray, path: str = "") -> LimbPotentials:
    """Potentials of a body's limb graph, for its lengths.

    path: a file of `LimbPotentials.save`. Without one the shipped ones where they are of a graph with these limbs, else
    they are learned from poses drawn within the joint limits, whose joints move at speed (nv,) [1/s], a standard
    deviation; the same ones every time.

    Raises
    ------
    InputError: the file is not readable, or is of another graph.
    """
    if path:
        return load_potentials(path).of_graph(graph, body, path)
    shipped = shipped_potentials()
    if set(shipped.limbs) == set(graph.names):
        return shipped.of_graph(graph, body)
    poses = random_poses(body, graph, _DRAWN, _STEPS, speed, np.random.default_rng(_SEED))
    return learned_potentials(graph, body, poses, LearnSettings())
