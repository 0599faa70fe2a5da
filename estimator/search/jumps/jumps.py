"""The kinematic jumps of one body, and their combinations: interpretations of one picture, the most plausible first."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import combinations

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.kernels.priors import STABILISER_NU
from estimator.energy.priors import world_up
from estimator.search.jumps.anatomy import Anatomy, RigidPart, anatomy_of
from estimator.search.jumps.limb_solutions import (
    ROUGHLY,
    LimbSolution,
    PoseOnRays,
    limb_solutions,
    pose_on_rays,
    turned,
)
from estimator.search.jumps.parts import part_mirrored, with_limbs_on_rays
from humanoid.kinematics.body import ROOT_TURN_Q, Body

MISS = 0.005  # m: standard deviation of the distance from a ray, about a pixel
PART_PENALTY = 3.0  # energy of a pose with mirrored parts, since these keep the image only nearly
UNREACHED = 10.0  # energy of a limb that no solution brings back onto its rays


class JointPrior:
    """A cheap prior of joints: the stabilisers' energy, and the tilt of a free root."""

    def __init__(self, body: Body) -> None:
        self._rest, self._precision = np.zeros(body.nv), np.zeros((body.nv, 2))
        self._q_index = np.zeros(body.nv, dtype=np.int64)
        for s in body.subject.stabilisers:
            joint = body.model.getJointId(s.joint)
            v = body.model.idx_vs[joint]
            self._rest[v], self._q_index[v] = s.rest, body.model.idx_qs[joint]
            self._precision[v] = s.std**-2, s.std_above**-2
        self._body = body

    def energy(self, q: np.ndarray, dofs: np.ndarray, turns: np.ndarray | float = 0.0) -> float:
        """Energy of some degrees of freedom (m,) of q (nq,), turned by `turns` (m,) [rad]."""
        x = q[self._q_index[dofs]] + turns - self._rest[dofs]
        return _lorentzian(np.square(x) * np.where(x > 0.0, self._precision[dofs, 1], self._precision[dofs, 0]))

    def tilt(self, q: np.ndarray, camera: Camera) -> float:
        """Energy of the root's tilt at q (nq,); zero for a body without an up axis."""
        upright = self._body.subject.upright
        if upright is None or not self._body.has_free_root:
            return 0.0
        x, y, z, w = q[ROOT_TURN_Q]
        a = np.array(upright.axis)
        v = np.array([x, y, z])
        up = a + 2.0 * np.cross(v, np.cross(v, a) + w * a)
        return _lorentzian(np.square(up - world_up((camera,))).sum() / upright.std**2)


def _lorentzian(squares: np.ndarray) -> float:
    return float(0.5 * STABILISER_NU * np.log1p(squares / STABILISER_NU).sum())


def interpretations(
    body: Body, anatomy: Anatomy, prior: JointPrior, on_rays: PoseOnRays, camera: Camera
) -> Iterator[np.ndarray]:
    """Configurations (nq,) on the same rays as a pose, with every combination of its limbs' solutions and of up to two
    mirrored parts, the pose itself left out.

    Given the parts, limbs do not depend on each other: each is solved once, and their combinations are merged best
    first by the joints' prior and the distance from the rays. Only the requested ones are made.
    """
    heap: list[tuple[float, int, tuple[int, ...], int]] = []
    scenes = []
    for mirrored in _scenes(body, anatomy, on_rays):
        options = [_options(body, anatomy, prior, mirrored, k) for k in range(len(anatomy.limbs))]
        scenes.append((mirrored, options))
        penalty = PART_PENALTY if scenes[1:] else 0.0
        start = penalty + _base_energy(body, anatomy, prior, mirrored, camera) + sum(o[0][0] for o in options)
        heap.append((start, len(scenes) - 1, (0,) * len(options), 0))
    heapq.heapify(heap)
    while heap:
        energy, s, chosen, first = heapq.heappop(heap)
        mirrored, options = scenes[s]
        for i in range(first, len(chosen)):  # every combination has one that it comes from
            if chosen[i] + 1 < len(options[i]):
                more = options[i][chosen[i] + 1][0] - options[i][chosen[i]][0]
                heapq.heappush(heap, (energy + more, s, (*chosen[:i], chosen[i] + 1, *chosen[i + 1 :]), i))
        picked = [o[c][1] for o, c in zip(options, chosen, strict=True)]
        if s == 0 and not any(r is not None and r.moved > anatomy.same for r in picked):
            continue
        step = np.zeros(body.nv)
        for limb, solution in zip(anatomy.limbs, picked, strict=True):
            if solution is not None:
                step[limb.dofs] = solution.turns
        yield body.integrate(mirrored.q, step)


def _scenes(body: Body, anatomy: Anatomy, on_rays: PoseOnRays) -> Iterator[PoseOnRays]:
    """The pose, and those with parts mirrored, inner ones first."""
    yield on_rays
    able = [(p, f) for p in anatomy.parts if (f := part_mirrored(body, anatomy, on_rays, p)) is not None]
    yield from (f for _, f in able)
    for (_, first), (second, _) in combinations(able, 2):
        both = part_mirrored(body, anatomy, first, second)
        if both is not None:
            yield both


def _options(
    body: Body, anatomy: Anatomy, prior: JointPrior, on_rays: PoseOnRays, k: int
) -> list[tuple[float, LimbSolution | None]]:
    """The solutions of a limb with their energies, best first."""
    limb = anatomy.limbs[k]
    options: list[tuple[float, LimbSolution | None]] = [
        (prior.energy(on_rays.q, limb.dofs, s.turns) + 0.5 * (s.error / MISS) ** 2, s)
        for s in limb_solutions(body, on_rays, limb)
    ]
    return sorted(options, key=lambda x: x[0]) or [(UNREACHED, None)]


def _base_energy(body: Body, anatomy: Anatomy, prior: JointPrior, on_rays: PoseOnRays, camera: Camera) -> float:
    """Energy of what is not of a limb."""
    limbs = [d for limb in anatomy.limbs for d in limb.dofs]
    others = np.setdiff1d(np.arange(body.nv), np.array(limbs, dtype=np.int64))
    return prior.energy(on_rays.q, others) + prior.tilt(on_rays.q, camera)


FAR = 2.0  # times the distance of poses that are the same: jumps to nearer ones would be a way round the transition


class KinematicJumps:
    """The poses of a body that look alike to one camera.

    With its inner end given, a segment's outer end meets its ray twice, nearer and farther (Lee and Chen 1985). For
    limbs of two segments the joints that bring it there are solved in closed form. Parts that turn about a point, and
    the whole of a free body, are met as nearly as a rigid part can be mirrored in depth. Limits are always kept.

    limbs, parts: what can jump (`Anatomy`). pairs: left and right limbs, which can change places.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.anatomy = anatomy_of(body)
        self.limbs, self.parts = self.anatomy.limbs, self.anatomy.parts
        self.pairs = [(self.limbs[i], self.limbs[j]) for i, j in self.anatomy.pairs]
        self._prior = JointPrior(body)

    def of(self, q: np.ndarray, camera: Camera) -> Iterator[np.ndarray]:
        """Every configuration (nq,) with one limb or one part of q (nq,) at another depth that its joints can reach."""
        on_rays = pose_on_rays(self.body, q, camera)
        for limb in self.limbs:
            for solution in limb_solutions(self.body, on_rays, limb):
                if solution.moved > self.anatomy.same:
                    yield turned(self.body, q, limb.dofs, solution.turns)
        for part in self.parts:
            mirrored = self._with_limbs(on_rays, part)
            if mirrored is not None:
                yield mirrored

    def draw(self, rng: np.random.Generator, q: np.ndarray, camera: Camera) -> np.ndarray | None:
        """One of them at random that is well away from q; None where the limb or part drawn has none."""
        count = len(self.limbs) + len(self.parts)
        if count == 0:
            return None
        k, on_rays = int(rng.integers(count)), pose_on_rays(self.body, q, camera)
        if k >= len(self.limbs):
            return self._with_limbs(on_rays, self.parts[k - len(self.limbs)])
        limb = self.limbs[k]
        far = [s for s in limb_solutions(self.body, on_rays, limb) if s.moved > FAR * self.anatomy.same]
        return turned(self.body, q, limb.dofs, far[rng.integers(len(far))].turns) if far else None

    def trunk_turned(self, q: np.ndarray, camera: Camera) -> np.ndarray | None:
        """The other reading of the trunk: what is beyond the hips mirrored in depth about their middle, the legs where
        they are, arms and head with their images. None for a body without one, or where its joints cannot reach it."""
        trunk = self.anatomy.trunk
        return None if trunk is None else self._with_limbs(pose_on_rays(self.body, q, camera), self.parts[trunk])

    def interpretations(self, q: np.ndarray, camera: Camera) -> Iterator[np.ndarray]:
        """Configurations (nq,) that combine such jumps, the most plausible first; see `interpretations`."""
        return interpretations(self.body, self.anatomy, self._prior, pose_on_rays(self.body, q, camera), camera)

    def exchange(self, rng: np.random.Generator, q: np.ndarray, camera: Camera) -> np.ndarray | None:
        """q (nq,) with left and right limbs on each other's rays: limbs that pass each other are confused.

        Which pair of limbs, or all of them, and which of the depths their segments can have there, is random; None
        where they cannot.
        """
        if not self.pairs:
            return None
        k = int(rng.integers(len(self.pairs) + (len(self.pairs) > 1)))
        on_rays = pose_on_rays(self.body, q, camera)
        for a, b in self.pairs[k : k + 1] or self.pairs:
            for limb, other in ((a, b), (b, a)):
                eyes, rays = on_rays.eyes.copy(), on_rays.rays.copy()
                eyes[limb.landmarks[1:]] = on_rays.eyes[other.landmarks[1:]]
                rays[limb.landmarks[1:]] = on_rays.rays[other.landmarks[1:]]
                solutions = limb_solutions(self.body, on_rays._replace(eyes=eyes, rays=rays), limb, ROUGHLY)
                if not solutions:
                    return None
                q = turned(self.body, q, limb.dofs, solutions[rng.integers(len(solutions))].turns)
        return q

    def _with_limbs(self, on_rays: PoseOnRays, part: RigidPart) -> np.ndarray | None:
        mirrored = part_mirrored(self.body, self.anatomy, on_rays, part)
        return None if mirrored is None else with_limbs_on_rays(self.body, self.anatomy, mirrored, part, on_rays)
