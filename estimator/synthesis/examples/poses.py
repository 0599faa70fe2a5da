"""Random poses of a standing body: arms anywhere within their limits, the rest as its stabilisers have it; some bend
forward."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.modes.merge import body_size
from estimator.search.examples.index import IndexRecipe
from estimator.search.jumps.anatomy import Limb, anatomy_of
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_Q, Body

OVERLAP = 0.005  # m by which parts may touch: flesh is softer than the solids that keep it apart
CALM = 0.3  # of the stabilisers' deviations, of legs that only stand
_TRIES = 200
_STEPS = 12  # of the legs of a body that bends, to where they stood
_TWO_FLOORS = 0.1  # of the body's size: limbs whose roots differ less in height begin at one height


class PoseSampler:
    """Draws poses q (nq,) of a body without overlaps, upright, the root at the origin.

    Limbs that begin high on the body have any angles within their limits (ELMO section 4: "constrained
    only by anatomical feasibility"); other joints are drawn from their stabilisers, within limits too, and those
    without one stay at rest. A free root has any heading within `headings` [degrees] about facing against x, to which
    `estimator.imaging.person_view` looks. bends: how far it leans forward at most [degrees], while legs stand where
    they stood as far as their limits let them; half of the poses lean less than a quarter of that. legs: whether they
    move as far as their stabilisers say, or only a little.
    """

    def __init__(self, body: Body, *, headings: float = 120.0, bends: float = 0.0, legs: bool = False) -> None:
        self.body, self._half = body, 0.5 * np.radians(headings)
        self._collision = SelfCollision(body)
        self._bends = np.radians(bends)
        high, low = _limbs(body)
        arms, lower = ({int(d) for limb in limbs for d in limb.dofs} for limbs in (high, low))
        self._stands_on = np.array([k for limb in low for k in limb.landmarks[1:]], dtype=int)
        self._legs = np.array(sorted(lower), dtype=int)
        model = body.model
        place = {str(model.names[j]): (int(model.idx_qs[j]), int(model.idx_vs[j])) for j in range(1, model.njoints)}
        known = [(*place[s.joint], s.rest, s.std) for s in body.subject.stabilisers if s.joint in place]
        held = [k for k in known if k[1] not in arms]
        self._index = np.array([q for q, *_ in held], dtype=int)
        self._rest = np.array([rest for *_, rest, _ in held])
        self._std = np.array([std * (CALM if v in lower and not legs else 1.0) for _, v, _, std in held])
        self._open = np.array([q for q, v in place.values() if v in arms], dtype=int)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """A pose (nq,)."""
        q = self._drawn(rng)
        for _ in range(_TRIES):
            if self._collision.penetration(self.body.at(q)) <= OVERLAP:
                break
            q = self._drawn(rng)
        return q

    def near(self, q: np.ndarray, rng: np.random.Generator, farthest: float) -> np.ndarray:
        """A pose in which every landmark is within `farthest` [m] of where q (nq,) has it, most of them not near it."""
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

    def _drawn(self, rng: np.random.Generator) -> np.ndarray:
        body, q = self.body, self.body.neutral.copy()
        q[self._open] = rng.uniform(body.lower[self._open], body.upper[self._open])
        q[self._index] = self._rest + self._std * rng.standard_normal(len(self._index))
        q = body.clamp(q)
        if self._bends and body.has_free_root:
            q = self._bent(q, self._bends * rng.uniform() ** 2)
        if body.has_free_root:
            heading = np.pi + rng.uniform(-self._half, self._half)
            turned = pin.SE3(pin.utils.rotate("z", heading), np.zeros(3))
            q[ROOT_Q] = pin.SE3ToXYZQUAT(turned * pin.XYZQUATToSE3(q[ROOT_Q]))
        return q

    def _bent(self, q: np.ndarray, angle: float) -> np.ndarray:
        """A pose (nq,) leaning forward by an angle [rad] about its root, knees and ankles where they were."""
        body, stood = self.body, self._stands_on
        before = body.landmarks(body.at(q))[stood]
        lean = np.zeros(body.nv)
        lean[4] = angle  # about the root's own y, to the left
        q = body.integrate(q, lean)
        for _ in range(_STEPS if len(stood) else 0):
            posed = body.at(q)
            away = before - body.landmarks(posed)[stood]
            step = np.zeros(body.nv)
            jacobian = body.landmark_jacobians(posed)[stood][:, :, self._legs].reshape(-1, len(self._legs))
            step[self._legs] = np.linalg.lstsq(jacobian, away.ravel(), rcond=0.01)[0]
            q = body.clamp(body.integrate(q, step))
        return q


def _limbs(body: Body) -> tuple[list[Limb], list[Limb]]:
    """The limbs that begin high on the body at rest, as arms do, and those that begin low; all are high where they
    begin at about one height."""
    heights = body.landmarks(body.at(body.neutral))[:, 2]
    limbs = anatomy_of(body).limbs
    roots = np.array([heights[limb.landmarks[0]] for limb in limbs])
    if not len(limbs) or np.ptp(roots) < _TWO_FLOORS * body_size(body):
        return list(limbs), []
    high = roots > 0.5 * (roots.min() + roots.max())
    sorted_by = [[limb for limb, up in zip(limbs, high, strict=True) if up == wanted] for wanted in (True, False)]
    return sorted_by[0], sorted_by[1]


def sampler_of(body: Body, recipe: IndexRecipe) -> PoseSampler:
    """That of a recipe's poses."""
    return PoseSampler(body, headings=recipe.headings, bends=recipe.bends, legs=recipe.legs)
