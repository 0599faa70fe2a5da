"""Mode seeking: damped trust-region descent to a constrained local minimum (CSS section 4.1, eq. 13)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.optimise.box_step import model_decrease, projected_gradient
from estimator.optimise.qp import StepSolver
from estimator.terms.term import Cost, QuadraticModel
from humanoid.kinematics.body import Body
from humanoid.support.settings import setting

MAX_DAMPING = 1e12
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


class Solution(NamedTuple):
    """End of a search: the quadratic model at the last accepted q, status as in `Mode`, recomputed KKT residual,
    steps tried."""

    quadratic: QuadraticModel
    status: str
    kkt_residual: float
    iterations: int

    @property
    def q(self) -> np.ndarray:
        """Configuration (nq,)."""
        return self.quadratic.posed.q


class Seeker:
    """Searches on one body; holds the workspace, no state that outlives a search."""

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
        body = self.body
        return float(
            projected_gradient(
                quadratic.gradient, quadratic.posed.q, body.bounded_q, body.bounded_v, body.lower, body.upper,
                self._residual,
            )
        )  # fmt: skip

    def seek(self, cost: Cost, q: np.ndarray, settings: SeekSettings | None = None) -> Solution:
        """Descend from q (nq,), clamped into the limits first; the energy never rises."""
        settings = settings or self.settings
        here = cost.at(self.body.clamp(q))
        active = np.zeros(self.body.nv, dtype=np.int8)
        damping, growth, radius = settings.damping, 2.0, self.trust_box(settings)
        residual = self.kkt_residual(here)
        for iteration in range(settings.max_iterations):
            if residual < settings.kkt_tolerance:
                return Solution(here, "converged", residual, iteration)
            step, damping = self._step(here, damping, radius, active)
            if step is None:
                return Solution(here, "stalled", residual, iteration)
            predicted = model_decrease(here.hessian, here.gradient, step)
            if predicted < settings.decrease_tolerance:
                return Solution(here, "stalled", residual, iteration)
            trial = cost.at(self.body.integrate(here.posed.q, step), predicted < settings.exact_below)
            ratio = (here.value - trial.value) / max(predicted, 1e-300)
            trial_residual = self.kkt_residual(trial)
            if ratio > 1e-4 or _equal_but_flatter(here.value, trial.value, residual, trial_residual):
                here, residual = trial, trial_residual
                if ratio > TOO_CAUTIOUS and not trial.exact:
                    here = cost.of(trial.posed, exact=True)
                damping, growth = max(1e-12, damping * max(0.1, 1.0 - (2.0 * ratio - 1.0) ** 3)), 2.0
            else:
                damping, growth = max(damping, 1e-6) * growth, growth * 2.0
                if damping > MAX_DAMPING:
                    return Solution(here, "stalled", residual, iteration)
        status = "converged" if residual < settings.kkt_tolerance else "iterations"
        return Solution(here, status, residual, settings.max_iterations)

    def _step(
        self, here: QuadraticModel, damping: float, radius: np.ndarray, active: np.ndarray
    ) -> tuple[np.ndarray | None, float]:
        """A step and its damping, raised as far as an indefinite true curvature needs; None where that is too far."""
        while True:
            step = self.solver.solve(here.hessian, here.gradient, damping, radius, here.posed.q, active)
            if step is not None or damping >= MAX_DAMPING:
                return step, damping
            damping = max(4.0 * damping, 1e-3)


def _equal_but_flatter(value: float, trial: float, residual: float, trial_residual: float) -> bool:
    """At the bottom the energy's last digits are noise; there the gradient decides."""
    return trial <= value + ROUNDING * max(1.0, abs(value)) and trial_residual < 0.9 * residual


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
