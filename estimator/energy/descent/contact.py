"""Hard clearance: a mode whose parts overlap, each other or the floor, is searched again with signed distances as rows
of the step's QP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from estimator.energy.cost import Cost, QuadraticModel
from estimator.energy.descent.seek import Seeker
from estimator.energy.descent.solution import SEPARATED, Solution, StepCounts
from estimator.numerics.newton import CONVERGED, Damping, NewtonSettings, Problem, Step, minimise
from humanoid.collision.floor import Clearance
from humanoid.kinematics.body import PosedBody
from humanoid.support.settings import setting

TOUCH = 1e-5  # m; closer pairs can carry a contact force
STILL = 1e-9  # rad or m; smaller steps are none
DAMPING = Damping(most=1e9, growth=8.0, shrink=0.2, grown_from=1e-6)
ENOUGH = 1e-9  # energy: a step that gains and promises less is the last


@dataclass(frozen=True)
class ContactSettings:
    """Settings of the treatment of overlapping parts.

    tolerance: tolerated overlap [m]. limit: overlap [m] with which a mode is given up where there are others.
    margin: distance [m] below which a pair gets a row. steps: steps tried. force: energy per metre of overlap that a
    step may gain and still be refused for it.
    """

    tolerance: float = setting(0.005, at_least=0, tiny=True)
    limit: float = setting(0.01, above=0)
    margin: float = setting(0.03, above=0)
    steps: int = setting(30, at_least=1)
    force: float = setting(1e5, above=0)


class _Point(NamedTuple):
    """An evaluated pose: energy + force * overlap, and the energy's quadratic model."""

    value: float
    quadratic: QuadraticModel


class _Separation(Problem[_Point]):
    """Energy and overlap of a pose, with the linearised signed distances of near pairs as rows of the step's QP."""

    def __init__(self, seeker: Seeker, clearance: Clearance, cost: Cost, settings: ContactSettings) -> None:
        self._seeker, self._clearance, self._cost, self._settings = seeker, clearance, cost, settings
        self._radius = seeker.trust_box(seeker.settings)
        self._active = np.zeros(seeker.body.nv, dtype=np.int8)

    def point(self, quadratic: QuadraticModel, depth: float) -> _Point:
        """A quadratic model with the deepest overlap [m] at its pose."""
        return _Point(quadratic.value + self._settings.force * depth, quadratic)

    def step(self, model: _Point, damping: float) -> Step | None:
        posed, _, gradient, hessian, _ = model.quadratic
        rows = clearance_rows(self._clearance, posed, self._settings.margin)
        step = self._seeker.solver.solve(hessian, gradient, damping, self._radius, posed.q, self._active, rows)
        return None if step is None or not np.any(np.abs(step[0]) > STILL) else step

    def at(self, model: _Point, step: Step) -> _Point:
        quadratic = self._cost.at(self._seeker.body.integrate(model.quadratic.posed.q, step[0]))
        return self.point(quadratic, self._clearance.penetration(quadratic.posed))


def separate(
    seeker: Seeker, clearance: Clearance, cost: Cost, overlapping: Solution, settings: ContactSettings
) -> Solution:
    """`overlapping` itself if no parts overlap by more than the tolerance, else the end of a search with hard rows.

    Every step solves the QP with the linearised signed distance d + n'J dx >= target of all near pairs, target being 0
    or, deep inside, half of the overlap; a step is taken when it lowers energy + force * overlap.
    """
    depth = clearance.penetration(overlapping.quadratic.posed)
    if depth <= settings.tolerance:
        return overlapping
    before = tuple(seeker.solver.tally)
    separation = _Separation(seeker, clearance, cost, settings)
    newton = NewtonSettings(settings.steps, DAMPING, least_promise=-np.inf, enough=ENOUGH, unsolved="stop")
    end, _, tried = minimise(separation, separation.point(overlapping.quadratic, depth), newton)
    residual = contact_kkt_residual(seeker, clearance, end.quadratic)
    status = CONVERGED if residual < seeker.settings.kkt_tolerance else SEPARATED
    steps = overlapping.steps.plus(StepCounts.between(before, seeker.solver.tally))
    return Solution(end.quadratic, status, residual, overlapping.iterations + tried, steps)


def contact_kkt_residual(seeker: Seeker, clearance: Clearance, quadratic: QuadraticModel) -> float:
    """Largest entry of the gradient that neither joint limits nor touching parts can balance.

    The multipliers, none negative, are the least-squares ones of the active limits and of the pairs in touch.
    """
    body, q = seeker.body, quadratic.posed.q
    touching = clearance.near(quadratic.posed, TOUCH).gradient
    identity = np.eye(body.nv)
    low = identity[body.bounded_v[q[body.bounded_q] <= body.lower[body.bounded_q]]]
    high = -identity[body.bounded_v[q[body.bounded_q] >= body.upper[body.bounded_q]]]
    pressing = np.concatenate([touching, low, high]).T
    if pressing.shape[1] == 0:
        return seeker.kkt_residual(quadratic)
    multipliers, _ = nnls(pressing, quadratic.gradient)
    return float(np.max(np.abs(quadratic.gradient - pressing @ multipliers)))


def clearance_rows(clearance: Clearance, posed: PosedBody, margin: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Rows A (m, nv), b (m,) with A dx >= b for every pair nearer than `margin`; None where there is no such pair."""
    contacts = clearance.near(posed, margin)
    if len(contacts.distance) == 0:
        return None
    target = np.minimum(0.0, 0.5 * contacts.distance)
    return contacts.gradient, target - contacts.distance
