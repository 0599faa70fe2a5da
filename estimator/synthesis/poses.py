"""Random poses of a standing body: arms anywhere within their limits, the rest by its stabilisers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.inference.mixture import body_size
from estimator.search.examples.index import IndexRecipe
from estimator.search.jumps.anatomy import anatomy_of
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_Q, Body

OVERLAP = 0.005  # m by which parts may touch: flesh is softer than the solids that keep it apart
CALM = 0.3  # of the stabilisers' deviations, of legs that only stand
LEAN = 0.35  # rad, at least, of what bends the trunk forward: the pelvis is drawn upright, so the back leans for both
_ACROSS = 0.9  # of an axis, from which it is that of bending forward and back
_TRIES = 200
_TWO_FLOORS = 0.1  # of the body's size: limbs whose roots differ less in height begin at one height


class PoseSampler:
    """Draws poses q (nq,) of a body without overlaps, upright, the root at the origin.

    Limbs that begin high on the body have any angles within their limits (ELMO section 4: "constrained only by
    anatomical feasibility"); other joints are drawn from their stabilisers, within limits too, and those without one
    stay at rest. A free root has any heading within `headings` [degrees] about facing against x, to which
    `estimator.vision.person_view` looks. legs: whether they move as far as their stabilisers allow, or only a little.
    """

    def __init__(self, body: Body, *, headings: float = 360.0, legs: bool = False) -> None:
        self.body, self._half = body, 0.5 * np.radians(headings)
        self._collision = SelfCollision(body)
        arms, lower = _limb_dofs(body)
        model = body.model
        place = {str(model.names[j]): (int(model.idx_qs[j]), int(model.idx_vs[j])) for j in range(1, model.njoints)}
        known = [(*place[s.joint], *s.moments) for s in body.subject.stabilisers if s.joint in place]
        held = [k for k in known if k[1] not in arms]
        self._index = np.array([q for q, *_ in held], dtype=int)
        self._rest = np.array([rest for *_, rest, _ in held])
        leans = _leaning(body)
        self._std = np.array([
            (std if legs else CALM * std) if v in lower else max(std, LEAN) if leans[v] else std
            for _, v, _, std in held
        ])  # fmt: skip
        self._open = np.array([q for q, v in place.values() if v in arms], dtype=int)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """A pose (nq,)."""
        q = self._random_pose(rng)
        for _ in range(_TRIES):
            if self._collision.penetration(self.body.at(q)) <= OVERLAP:
                break
            q = self._random_pose(rng)
        return q

    def near(self, q: np.ndarray, rng: np.random.Generator, farthest: float) -> np.ndarray:
        """A pose in which every landmark is within `farthest` [m] of its place at q (nq,), most of them not near it."""
        body = self.body
        before = body.landmarks(body.at(q))
        step = 0.15 * rng.standard_normal(body.nv)
        step[: body.first_joint_dof] = 0.0
        if body.has_free_root:
            step[5] = 0.15 * rng.standard_normal()  # heading
        for _ in range(_TRIES):
            other = body.clamp(body.integrate(q, step))
            moved = np.linalg.norm(body.landmarks(body.at(other)) - before, axis=1).max()
            if moved <= farthest:
                return other
            step *= max(0.5, 0.95 * farthest / moved)
        return q

    def _random_pose(self, rng: np.random.Generator) -> np.ndarray:
        body, q = self.body, self.body.neutral.copy()
        q[self._open] = rng.uniform(body.lower[self._open], body.upper[self._open])
        q[self._index] = self._rest + self._std * rng.standard_normal(len(self._index))
        q = body.clamp(q)
        if body.has_free_root:
            heading = np.pi + rng.uniform(-self._half, self._half)
            q[ROOT_Q] = pin.SE3ToXYZQUAT(pin.SE3(pin.utils.rotate("z", heading), np.zeros(3)))
        return q


def _leaning(body: Body) -> np.ndarray:
    """Which degrees of freedom (nv,) bend what carries limbs forward and back."""
    across = np.abs(body.dof_jacobian(body.at(body.neutral))[:, 4]) > _ACROSS
    carries = body.landmark_support[[limb.landmarks[0] for limb in anatomy_of(body).limbs]].any(axis=0)
    return np.asarray(across & carries)


def _limb_dofs(body: Body) -> tuple[set[int], set[int]]:
    """Degrees of freedom of the limbs that begin high on the body at rest, as arms do, and of those that begin low; all
    are high where they begin at about one height."""
    heights = body.landmarks(body.at(body.neutral))[:, 2]
    limbs = anatomy_of(body).limbs
    roots = np.array([heights[limb.landmarks[0]] for limb in limbs])
    if not len(limbs) or np.ptp(roots) < _TWO_FLOORS * body_size(body):
        return {int(d) for limb in limbs for d in limb.dofs}, set()
    high = roots > 0.5 * (roots.min() + roots.max())
    of = [
        {int(d) for limb, up in zip(limbs, high, strict=True) if up == wanted for d in limb.dofs} for wanted in (1, 0)
    ]
    return of[0], of[1]


def sampler_of(body: Body, recipe: IndexRecipe) -> PoseSampler:
    """The sampler of a recipe's poses."""
    return PoseSampler(body, headings=recipe.headings, legs=recipe.legs)
