"""Kinematic jumps: the other depths of a limb's segments (CSS footnote 1; Sminchisescu and Triggs, CVPR 2003)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from estimator.imaging.camera import Camera
from estimator.imaging.observation import Observation
from humanoid.body import Body
from humanoid.compiled import jit

CHAINS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
STEPS = 7
LARGEST_TURN = 0.8  # rad a step
DAMPING = 1e-3  # m^2: of the limb's inverse kinematics
TWISTS = (0.0, 1.5, -1.5)  # rad
CLOSE, REACHED = 0.04, 0.06  # m; good enough to stop, and to be refined by the mode search
ROUGHLY = 0.25  # m; where a limb that takes another's place may start its search from
SAME = 0.10  # m; flips nearer than this to the pose they come from say nothing new


class Limb(NamedTuple):
    """landmarks (3,): root, middle and end of the limb. dofs (n,): what turns it about its root. lengths: of its two
    segments [m]."""

    landmarks: np.ndarray
    dofs: np.ndarray
    lengths: tuple[float, float]


class Flips:
    """For each limb the poses whose middle and end joints lie on the same rays of a camera at other depths.

    A limb is a chain of three landmarks (shoulder, elbow, wrist; hip, knee, ankle); each segment of given length meets
    the ray of its outer end twice, nearer and farther (CSS footnote 1).
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        names = body.landmark_names
        support = body.landmark_support
        self.limbs: list[Limb] = []
        at_rest = body.landmarks(body.at(body.neutral))
        self.pairs: list[tuple[Limb, Limb]] = []
        for chain in CHAINS:
            sides = []
            for side in ("left", "right"):
                points = [f"{side}_{p}" for p in chain]
                if all(p in names for p in points):
                    a, b, c = (names.index(p) for p in points)
                    turning = _moves(body, a)
                    dofs = np.flatnonzero((support[b] | support[c]) & ~turning)
                    lengths = tuple(float(x) for x in np.linalg.norm(np.diff(at_rest[[a, b, c]], axis=0), axis=1))
                    if len(dofs):
                        sides.append(Limb(np.array([a, b, c]), dofs, (lengths[0], lengths[1])))
            self.limbs += sides
            if len(sides) == 2:
                self.pairs.append((sides[0], sides[1]))

    def of(self, q: np.ndarray, camera: Camera) -> Iterator[np.ndarray]:
        """Every configuration (nq,) with one limb of q (nq,) at another depth that its joints can reach."""
        points = self.body.landmarks(self.body.at(q))
        for limb in self.limbs:
            for targets in _targets(points, limb, camera):
                found = self._reach(q, limb, targets)
                if found is not None:
                    yield found

    def draw(self, rng: np.random.Generator, q: np.ndarray, camera: Camera) -> np.ndarray | None:
        """One of them at random; None where the limb drawn has none."""
        limb = self.limbs[rng.integers(len(self.limbs))]
        targets = _targets(self.body.landmarks(self.body.at(q)), limb, camera)
        return self._reach(q, limb, targets[rng.integers(len(targets))]) if targets else None

    def exchange(self, rng: np.random.Generator, q: np.ndarray, camera: Camera) -> np.ndarray | None:
        """q (nq,) with a left and a right limb on each other's rays: limbs that pass are taken for one another.

        Which pair of limbs, and which of the depths their segments can have there, is random; None where they cannot.
        """
        if not self.pairs:
            return None
        pair = self.pairs[rng.integers(len(self.pairs))]
        points = self.body.landmarks(self.body.at(q))
        found = q
        for limb, other in (pair, pair[::-1]):
            there = points.copy()
            there[limb.landmarks[1:]] = points[other.landmarks[1:]]
            places = _places(there, limb, camera)
            reached = self._reach(found, limb, places[rng.integers(len(places))], ROUGHLY)
            if reached is None:
                return None
            found = reached
        return found

    def _reach(self, q: np.ndarray, limb: Limb, targets: np.ndarray, near: float = REACHED) -> np.ndarray | None:
        """Inverse kinematics of the limb's own joints towards its middle and end (2, 3), limits kept; None if it
        cannot. The limb is first twisted, since a straight pull often ends at a limit."""
        best, least = None, np.inf
        for twist in TWISTS:
            start = np.zeros(self.body.nv)
            start[limb.dofs[min(2, len(limb.dofs) - 1)]] = twist
            found, error = self._pull(self.body.integrate(q, start), limb, targets)
            if error < least:
                best, least = found, error
            if least < CLOSE:
                break
        return best if least < near else None

    def _pull(self, q: np.ndarray, limb: Limb, targets: np.ndarray) -> tuple[np.ndarray, float]:
        """Damped Gauss-Newton steps of the limb's joints; the pose and its largest error [m]."""
        body, outer = self.body, limb.landmarks[1:]
        joints, local, moved = body.landmark_joint[outer], body.landmark_local[outer], body.landmark_support[outer]
        step, error = np.zeros(body.nv), np.inf
        for k in range(STEPS + 1):  # the last one only measures
            posed = body.at(q)
            error = pull_step(posed.placements, posed.columns, limb.dofs, joints, local, moved, targets, step)
            if error < CLOSE or k == STEPS:
                break
            q = body.integrate(q, step)  # which keeps the limits
        return q, error


@jit
def pull_step(placements, columns, dofs, joints, local, moved, targets, step):  # type: ignore[no-untyped-def]
    """Fill `step` (nv,) with a damped Gauss-Newton step of `dofs` (n,) that brings points towards targets.

    joints (P,), local (P, 3): the points, fixed to joints. moved (P, nv): which degrees of freedom move them.
    targets (P, 3) [m]. Returns the largest error before the step [m].
    """
    n, count = dofs.shape[0], joints.shape[0]
    A, g, row = np.zeros((n, n)), np.zeros(n), np.zeros((n, 3))
    error = 0.0
    p = np.zeros(3)
    for i in range(count):
        for k in range(3):
            p[k] = placements[joints[i], 9 + k]
            for m in range(3):
                p[k] += placements[joints[i], 3 * m + k] * local[i, m]
            error = max(error, abs(targets[i, k] - p[k]))
        row[:] = 0.0
        for a in range(n):
            if moved[i, dofs[a]]:
                c = columns[dofs[a]]
                row[a, 0] = c[0] + c[4] * p[2] - c[5] * p[1]
                row[a, 1] = c[1] + c[5] * p[0] - c[3] * p[2]
                row[a, 2] = c[2] + c[3] * p[1] - c[4] * p[0]
        for a in range(n):
            for k in range(3):
                g[a] += row[a, k] * (targets[i, k] - p[k])
                for b in range(n):
                    A[a, b] += row[a, k] * row[b, k]
    for a in range(n):  # Cholesky of A + damping, in place
        A[a, a] += DAMPING
        for b in range(a + 1):
            s = A[a, b]
            for c in range(b):
                s -= A[a, c] * A[b, c]
            A[a, b] = math.sqrt(s) if a == b else s / A[b, b]
    for a in range(n):
        for b in range(a):
            g[a] -= A[a, b] * g[b]
        g[a] /= A[a, a]
    for a in range(n - 1, -1, -1):
        for b in range(a + 1, n):
            g[a] -= A[b, a] * g[b]
        g[a] /= A[a, a]
        step[dofs[a]] = min(max(g[a], -LARGEST_TURN), LARGEST_TURN)
    return error


def _moves(body: Body, landmark: int) -> np.ndarray:
    """Degrees of freedom that displace a landmark, (nv,) bool: those through whose axis it lies do not."""
    moved: np.ndarray = np.abs(body.landmark_jacobians(body.at(body.neutral))[landmark]).max(axis=0) > 1e-9
    return moved


def _targets(points: np.ndarray, limb: Limb, camera: Camera) -> list[np.ndarray]:
    """Places (2, 3) [m] of the limb's middle and end on their rays, except where they are already."""
    now = points[limb.landmarks[1:]]
    return [p for p in _places(points, limb, camera) if np.linalg.norm(p - now, axis=1).max() > SAME]


def _places(points: np.ndarray, limb: Limb, camera: Camera) -> list[np.ndarray]:
    """Places (2, 3) [m] that the limb's middle and end can have on their rays."""
    a, b, c = points[limb.landmarks]
    eye = camera.centre_world
    upper, lower = limb.lengths
    return [np.stack([m, e]) for m in _depths(eye, b, a, upper) for e in _depths(eye, c, m, lower)]


def _depths(o: np.ndarray, p: np.ndarray, centre: np.ndarray, radius: float) -> list[np.ndarray]:
    """Where the ray from o through p meets a sphere; its nearest point where it misses."""
    d = (p - o) / np.linalg.norm(p - o)
    along = d @ (centre - o)
    gap = radius**2 - (centre - o) @ (centre - o) + along**2
    if gap <= 0.0:
        return [o + along * d]
    return [o + (along - np.sqrt(gap)) * d, o + (along + np.sqrt(gap)) * d]


def only_camera(observation: Observation) -> Camera | None:
    """The camera that alone sees the body; None where several do, since depth is then known."""
    if observation.cues:
        return observation.cameras[0] if len(observation.cues) == 1 else None
    seeing = np.flatnonzero((observation.confidence > 0.0).any(axis=1))
    return observation.cameras[int(seeing[0])] if len(seeing) == 1 else None
