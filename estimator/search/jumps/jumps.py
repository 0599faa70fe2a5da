"""The kinematic jumps of one body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.search.jumps.anatomy import RigidPart, anatomy_of
from estimator.search.jumps.interpretations import JointPrior, interpretations
from estimator.search.jumps.limb_solutions import ROUGHLY, limb_solutions
from estimator.search.jumps.parts import part_mirrored, with_limbs_on_rays
from estimator.search.jumps.pose_on_rays import PoseOnRays, pose_on_rays, turned
from humanoid.kinematics.body import Body

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
