"""Mode seeking: damped trust-region descent to a constrained local minimum (CSS section 4.1, eq. 13)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimator.optimise.box_step import model_decrease, projected_gradient
from estimator.optimise.newton import Damping, NewtonSettings, Problem, Step, minimise
from estimator.optimise.qp import StepSolver
from estimator.optimise.solution import Solution
from estimator.terms.term import Cost, QuadraticModel
from humanoid.kinematics.body import Body

DAMPING = Damping(least=1e-12, most=1e12, growth=2.0, grown_from=1e-6, by_ratio=True)
ACCEPTED = 1e-4  # share of the promised decrease that a step has to bring
ROUNDING = 16.0 * float(np.finfo(float).eps)  # relative; the energy sums about a hundred terms
TOO_CAUTIOUS = 1.5  # actual over promised decrease from which Gauss-Newton's curvature is plainly too large


@dataclass(frozen=True)
class SeekSettings:
    """When a search ends and how far it steps.

    max_iterations: steps tried. kkt_tolerance: largest entry of the projected gradient at convergence [energy per rad
    or m]. decrease_tolerance: the search also ends, "stalled", when the model promises less than this much energy;
    0 leaves that to the KKT residual. damping: first damping factor. exact_below: the true Hessian is used once the
    model promises less than this, near a minimum, where it makes convergence quadratic. max_turn [rad], max_slide [m]:
    half-width of the trust box.
    """

    max_iterations: int = 60
    kkt_tolerance: float = 1e-6
    decrease_tolerance: float = 0.0
    damping: float = 1e-2
    exact_below: float = 0.3
    max_turn: float = 0.6
    max_slide: float = 0.5

    @cached_property
    def newton(self) -> NewtonSettings:
        """What of this the loop has to know."""
        return NewtonSettings(
            iterations=self.max_iterations,
            damping=replace(DAMPING, first=self.damping),
            accepted=ACCEPTED,
            least_promise=self.decrease_tolerance,
            unsolved="retry",
        )


class _Point(NamedTuple):
    """A pose looked at: its energy, the quadratic model, and the KKT residual."""

    value: float
    quadratic: QuadraticModel
    residual: float


class Seeker:
    """Searches on one body; holds the workspace, no state that outlives a search but counts."""

    def __init__(self, body: Body, settings: SeekSettings | None = None) -> None:
        self.body = body
        self.settings = settings or SeekSettings()
        self.solver = StepSolver(body)
        self._residual = np.zeros(body.nv)
        self._boxes: dict[tuple[float, float], np.ndarray] = {}

    def trust_box(self, settings: SeekSettings) -> np.ndarray:
        """Half-width (nv,) of the trust box of a search."""
        size = settings.max_turn, settings.max_slide
        if size not in self._boxes:
            self._boxes[size] = trust_box(self.body, *size)
        return self._boxes[size]

    def kkt_residual(self, quadratic: QuadraticModel) -> float:
        """Largest entry of the projected gradient at a posed body: zero at a minimum within the joint limits."""
        solver = self.solver
        return float(
            projected_gradient(
                quadratic.gradient, quadratic.posed.q, solver.places, solver.limits, self._residual
            )
        )  # fmt: skip

    def seek(self, cost: Cost, q: np.ndarray, settings: SeekSettings | None = None) -> Solution:
        """Descend from q (nq,), clamped into the limits first; the energy never rises but by rounding."""
        settings, before = settings or self.settings, self.solver.counts
        search = _Search(self, cost, settings)
        end, status, tried = minimise(search, search.point(cost.at(self.body.clamp(q))), settings.newton)
        return Solution(end.quadratic, status, end.residual, tried, self.solver.counts.since(before))


class _Search(Problem[_Point]):
    """One search: a cost within joint limits and a trust box."""

    def __init__(self, seeker: Seeker, cost: Cost, settings: SeekSettings) -> None:
        self._seeker, self._cost, self._settings = seeker, cost, settings
        self._body, self._radius = seeker.body, seeker.trust_box(settings)
        self._active = np.zeros(seeker.body.nv, dtype=np.int8)  # the last step's is the guess at the next one's

    def point(self, quadratic: QuadraticModel) -> _Point:
        """A quadratic model with its residual."""
        return _Point(quadratic.value, quadratic, self._seeker.kkt_residual(quadratic))

    def converged(self, model: _Point) -> bool:
        return model.residual < self._settings.kkt_tolerance

    def step(self, model: _Point, damping: float) -> Step | None:
        posed, _, gradient, hessian, _ = model.quadratic
        move = self._seeker.solver.solve(hessian, gradient, damping, self._radius, posed.q, self._active)
        return None if move is None else Step(move, model_decrease(hessian, gradient, move))

    def at(self, model: _Point, step: Step) -> _Point:
        """The true curvature is worth its price once little is left to gain."""
        q = self._body.integrate(model.quadratic.posed.q, step.move)
        assert step.promised is not None
        return self.point(self._cost.at(q, step.promised < self._settings.exact_below))

    def as_good(self, model: _Point, trial: _Point) -> bool:
        """At the bottom the energy's last digits are noise; there the gradient decides."""
        equal = trial.value <= model.value + ROUNDING * max(1.0, abs(model.value))
        return equal and trial.residual < 0.9 * model.residual

    def taken(self, trial: _Point, ratio: float) -> _Point:
        if ratio > TOO_CAUTIOUS and not trial.quadratic.exact:
            exact = self._cost.of(trial.quadratic.posed, exact=True)
            return _Point(exact.value, exact, trial.residual)
        return trial


def trust_box(body: Body, max_turn: float, max_slide: float) -> np.ndarray:
    """Half-width (nv,) of the trust box: radians for turning, metres for sliding degrees of freedom."""
    radius = np.full(body.nv, max_turn)
    for j in range(1, body.njoints):
        first = body.model.idx_vs[j]
        if body.model.nvs[j] == 6:
            radius[first : first + 3] = max_slide
        elif body.model.joints[j].shortname().startswith("JointModelP"):
            radius[first] = max_slide
    return radius
