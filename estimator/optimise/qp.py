"""The quadratic programme of one step: ProxQP wherever the guessed active set does not settle it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from proxsuite import proxqp

from estimator.optimise.box_step import FREE, NOT_CONVEX, UNSETTLED, damped_step, model_decrease, solve_sets
from estimator.optimise.newton import Step
from estimator.optimise.solution import StepCounts
from humanoid.kinematics.body import Body

ACCURACY = 1e-8
_FREE, _ACTIVE_SET, _PROXQP, _FAILED = range(4)  # see `StepCounts`
UNBOUNDED = 1e20  # what ProxQP takes for infinity


@dataclass
class StepSolver:
    """min 1/2 x'(H + damping diag H)x + g'x  s.t. joint limits, trust box, rows A x >= b  (CSS eq. 13 as a QP).

    One persistent solver object for each number of rows; equal problems have equal solutions, regardless of what was
    solved before (`_exact`). places (B, 2), limits (2, B): where the bounded joints stand in q and in the tangent, and
    their lower and upper limits. tally: how many steps each solver solved, in the order of `StepCounts`.
    """

    body: Body
    active_set_rounds: int = 6

    def __post_init__(self) -> None:
        body, n = self.body, self.body.nv
        self._M, self._bounds = np.zeros((n, n)), np.zeros((2, n))
        self._lower, self._upper = self._bounds
        self._solvers: dict[int, proxqp.dense.QP] = {}
        self.tally = [0, 0, 0, 0]
        self.places = np.stack((body.bounded_q, body.bounded_v), axis=1)
        self.limits = np.stack((body.lower[body.bounded_q], body.upper[body.bounded_q]))

    @property
    def counts(self) -> StepCounts:
        """Steps solved so far."""
        return StepCounts(*self.tally)

    def solve(
        self,
        hessian: np.ndarray,
        gradient: np.ndarray,
        damping: float,
        radius: np.ndarray,
        q: np.ndarray,
        active: np.ndarray,
        rows: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> Step | None:
        """The step (nv,) and the decrease that the undamped model promises of it.

        None if the damped model is not convex or the solver failed.

        hessian (nv, nv), gradient (nv,): the model at q (nq,). radius (nv,): half-width of the trust box.
        active (nv,) int8: guess of the active bounds, updated in place. rows: A (m, nv) and b (m,).
        """
        step = np.empty(self.body.nv)
        verdict, promised = damped_step(
            hessian, gradient, damping, radius, q, self.places, self.limits, active, self.active_set_rounds, self._M,
            self._bounds, step,
        )  # fmt: skip
        if verdict > UNSETTLED and (rows is None or np.all(rows[0] @ step >= rows[1])):
            self.tally[_FREE if verdict == FREE else _ACTIVE_SET] += 1
            return step, promised
        if verdict == NOT_CONVEX or not _convex(self._M):  # the rounds look only at the variables they left free
            return None
        solved = self._proxqp(gradient, active, rows)
        return None if solved is None else (solved, model_decrease(hessian, gradient, solved))

    def _proxqp(
        self, gradient: np.ndarray, active: np.ndarray, rows: tuple[np.ndarray, np.ndarray] | None
    ) -> np.ndarray | None:
        n, m = self.body.nv, 0 if rows is None else len(rows[1])
        solver = self._solvers.get(m)
        C, low, high = (None, None, None) if rows is None else (rows[0], rows[1], np.full(m, UNBOUNDED))
        if solver is None:
            solver = proxqp.dense.QP(n, 0, m, True)
            solver.settings.eps_abs = ACCURACY
            solver.settings.eps_rel = 0.0
            solver.settings.max_iter = 25
            solver.settings.max_iter_in = 50
            solver.settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
            solver.init(self._M, gradient, None, None, C, low, high, self._lower, self._upper)
            self._solvers[m] = solver
        else:
            solver.update(self._M, gradient, None, None, C, low, high, self._lower, self._upper, True)
        solver.solve()
        x = np.array(solver.results.x)
        if not np.all(np.isfinite(x)):
            self.tally[_FAILED] += 1
            return None
        self.tally[_PROXQP] += 1
        return self._exact(x, np.array(solver.results.z), gradient, active, rows)

    def _exact(
        self,
        x: np.ndarray,
        multipliers: np.ndarray,
        gradient: np.ndarray,
        active: np.ndarray,
        rows: tuple[np.ndarray, np.ndarray] | None,
    ) -> np.ndarray:
        """The vertex that ProxQP's answer stands for.

        Its last digits depend on what the solver did before and on where its memory lies; the sets of active bounds
        and rows do not, so the step is solved anew from them. Where they do not certify, it is cut to the digits that
        ProxQP guarantees.
        """
        A, b = (np.zeros((0, self.body.nv)), np.zeros(0)) if rows is None else rows
        m = len(b)
        near = 1e-7
        at_low, at_high = x <= self._lower + near, x >= self._upper - near
        active[:] = np.where(at_low, -1, np.where(at_high, 1, 0))
        step = np.empty(self.body.nv)
        held = np.abs(multipliers[:m]) > 1e-7
        if solve_sets(self._M, gradient, self._lower, self._upper, A, b, active, held, step):
            return step
        step = np.round(x, 6)
        step = np.where(at_low, self._lower, np.where(at_high, self._upper, step))
        return np.minimum(np.maximum(step, self._lower), self._upper)


def _convex(M: np.ndarray) -> bool:
    """Whether M (n, n) is positive definite."""
    try:
        np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        return False
    return True
