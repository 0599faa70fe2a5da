"""Mode seeking: damped trust-region descent to a constrained local minimum (CSS section 4.1, eq. 13)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.energy.cost import Cost, QuadraticModel
from estimator.energy.descent.box_step import projected_gradient
from estimator.energy.descent.qp import PROXQP, StepSolver
from estimator.energy.descent.solution import Solution, StepCounts
from estimator.numerics.newton import Damping, NewtonSettings, Problem, Step, minimise
from humanoid.kinematics.body import Body
from humanoid.support.settings import setting

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

    max_iterations: int = setting(60, at_least=1)
    kkt_tolerance: float = setting(1e-6, above=0, tiny=True)
    decrease_tolerance: float = setting(0.0, at_least=0, tiny=True)
    damping: float = setting(1e-2, above=0)
    exact_below: float = setting(0.3, at_least=0)
    max_turn: float = setting(0.6, above=0)
    max_slide: float = setting(0.5, above=0)

    @cached_property
    def newton(self) -> NewtonSettings:
        """The settings that the loop needs."""
        return NewtonSettings(
            iterations=self.max_iterations,
            damping=replace(DAMPING, first=self.damping),
            accepted=ACCEPTED,
            least_promise=self.decrease_tolerance,
            unsolved="retry",
        )


class Seeker:
    """Searches on one body; holds the workspace, no state that outlives a search but counts.

    step_solver: who solves a constrained step, see `StepSolver`.
    """

    def __init__(self, body: Body, settings: SeekSettings | None = None, step_solver: str = PROXQP) -> None:
        self.body = body
        self.settings = settings or SeekSettings()
        self.solver = StepSolver(body, step_solver)
        self._residual = np.zeros(body.nv)
        self._boxes: dict[tuple[float, float], np.ndarray] = {}

    def trust_box(self, settings: SeekSettings) -> np.ndarray:
        """Half-width (nv,) of the trust box of a search."""
        size = settings.max_turn, settings.max_slide
        box = self._boxes.get(size)
        if box is None:
            box = self._boxes[size] = trust_box(self.body, *size)
        return box

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
        settings = settings or self.settings
        before = tuple(self.solver.tally)
        start = cost.at(self.body.clamp(q))
        search = _Search(self, cost, settings, self.kkt_residual(start))
        end, status, tried = minimise(search, start, settings.newton)
        return Solution(end, status, search.residual, tried, StepCounts.between(before, self.solver.tally))


class _Search(Problem[QuadraticModel]):
    """One search: a cost within joint limits and a trust box. residual: KKT residual of the model last taken."""

    def __init__(self, seeker: Seeker, cost: Cost, settings: SeekSettings, residual: float) -> None:
        self._seeker, self._solver, self._cost, self._settings = seeker, seeker.solver, cost, settings
        self._radius, self._integrate = seeker.trust_box(settings), seeker.body.integrate
        self._active = np.zeros(seeker.body.nv, dtype=np.int8)  # the last step's is the guess at the next one's
        self.residual = self._of_trial = residual

    def converged(self, model: QuadraticModel) -> bool:
        return self.residual < self._settings.kkt_tolerance

    def step(self, model: QuadraticModel, damping: float) -> Step | None:
        posed, _, gradient, hessian, _ = model
        return self._solver.solve(hessian, gradient, damping, self._radius, posed.q, self._active)

    def at(self, model: QuadraticModel, step: Step) -> QuadraticModel:
        """The true curvature is worth its cost once little is left to gain."""
        move, promised = step
        assert promised is not None
        trial = self._cost.at(self._integrate(model.posed.q, move), promised < self._settings.exact_below)
        self._of_trial = self._seeker.kkt_residual(trial)
        return trial

    def as_good(self, model: QuadraticModel, trial: QuadraticModel) -> bool:
        """Whether a trial is as good where the energy's last digits are noise: there the gradient decides."""
        equal = trial.value <= model.value + ROUNDING * max(1.0, abs(model.value))
        return equal and self._of_trial < 0.9 * self.residual

    def taken(self, trial: QuadraticModel, ratio: float) -> QuadraticModel:
        self.residual = self._of_trial
        if ratio > TOO_CAUTIOUS and not trial.exact:
            return self._cost.of(trial.posed, exact=True)
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
