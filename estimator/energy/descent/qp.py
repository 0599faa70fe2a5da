"""The quadratic programme of one step, by ProxQP or by the compiled active set, certified by its KKT conditions.

Measured on the steps of a tracked clip: ProxQP's multipliers name the active bounds where its positions do not, and a
tolerance below 1e-8 without a cap on the iterations may not return.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.energy.descent.active_sets import settle
from estimator.energy.descent.box_step import (
    FREE,
    NOT_CONVEX,
    UNSETTLED,
    damped_step,
    free_minimum,
    free_or_scaled,
    model_decrease,
    scale,
    solve_box,
)
from estimator.energy.descent.solution import StepCounts
from estimator.numerics.newton import Step
from estimator.numerics.quadratic_program import UNBOUNDED, QuadraticProgram, WarmSolvers
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

PROXQP, ACTIVE_SET, PROXQP_ALWAYS = STEP_SOLVERS = ("proxqp", "active-set", "proxqp-always")
ROUNDS = 6  # of the compiled active set
MENDED = 2  # rounds given to ProxQP's sharper answer: a bound that hardly presses may be on either side
_FREE, _ACTIVE_SET, _PROXQP, _FAILED = range(4)  # see `StepCounts`
ACCURACY, SHARP = 1e-6, 1e-9  # in scaled variables; the second where the first is not enough
PENALTY, PENALTY_OF_FEW = 1e-3, 1e-6  # of the solver's first round, in the whole problem and in that of few unknowns
FEW = 8  # unknowns at most that a smaller problem is made of

Rows = tuple[np.ndarray, np.ndarray]
"""A (m, n) and b (m,): A x >= b."""


@dataclass
class StepSolver:
    """min 1/2 x'(H + damping diag H)x + g'x  s.t. joint limits, trust box, rows A x >= b  (CSS eq. 13 as a QP).

    step_solver: "proxqp": the free minimum where it satisfies all constraints, else ProxQP; "active-set": a compiled
    active set iteration from a guess, and ProxQP for what it does not settle or rows stop; "proxqp-always": ProxQP for
    every convex step. A matrix that is not positive definite is not a convex QP: the active set solves it nevertheless,
    as long as its free block is. Raises InputError for another word.

    The sets that ProxQP names as active are solved again by the operations that end the active set (`settle`): equal
    problems have equal solutions to the last bit, with any solver and history. Where ProxQP's answer is not certified
    it is solved to a tighter tolerance, whose sets may be corrected once (along unconstrained directions a bound's
    multiplier is rounding error); then the active set is tried.

    places (B, 2), limits (2, B): the indices of bounded joints in q and in the tangent, and their lower and upper
    limit. proxqp: the solver, with room for its problem. tally: how many steps each solver solved, in the order of
    `StepCounts`. uncertified: how many of ProxQP's answers were not certified, the first and the sharper one of a step
    both counted.
    """

    body: Body
    step_solver: str = PROXQP

    def __post_init__(self) -> None:
        if self.step_solver not in STEP_SOLVERS:
            raise InputError("step solver", f"is {self.step_solver!r}", remedy="one of " + ", ".join(STEP_SOLVERS))
        body, n = self.body, self.body.nv
        self._M, self._bounds = np.zeros((n, n)), np.zeros((2, n))
        self._sets, self.proxqp = np.zeros(n, dtype=np.int8), ProxQP(n)
        self._no_rows = np.zeros((0, n)), np.zeros(0)
        self.tally = [0, 0, 0, 0]
        self.uncertified = 0
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
        rows: Rows | None = None,
    ) -> Step | None:
        """The step (nv,) and the decrease that the undamped model promises of it.

        None if the damped model is not convex or no solver solved it.

        hessian (nv, nv), gradient (nv,): the model at q (nq,). radius (nv,): half-width of the trust box.
        active (nv,) int8: guess of the active bounds, updated in place. rows: A (m, nv) and b (m,).
        """
        step, proxqp = np.empty(self.body.nv), self.proxqp
        if self.step_solver == ACTIVE_SET:
            verdict, promised = damped_step(
                hessian, gradient, damping, radius, q, self.places, self.limits, active, ROUNDS, self._M,
                self._bounds, step,
            )  # fmt: skip
            ready = False
        else:
            verdict, promised = free_or_scaled(
                hessian, gradient, damping, radius, q, self.places, self.limits, active, ROUNDS, self._M,
                self._bounds, step, proxqp.scaled, proxqp.start,
            )  # fmt: skip
            ready = verdict == UNSETTLED
        if verdict == NOT_CONVEX:
            return None
        if not ready:
            asked = verdict == FREE and self.step_solver == PROXQP_ALWAYS
            if verdict > UNSETTLED and not asked and (rows is None or np.all(rows[0] @ step >= rows[1])):
                self.tally[_FREE if verdict == FREE else _ACTIVE_SET] += 1
                return step, promised
            if not self._scaled(gradient, step):  # the active set looks only at what it leaves free
                return None
        return self._by_proxqp(hessian, gradient, active, rows, step)

    def _scaled(self, gradient: np.ndarray, x: np.ndarray) -> bool:
        """Make the problem ready for ProxQP; False where it is not convex. x (nv,): overwritten."""
        if not free_minimum(self._M, gradient, x):
            return False
        scale(self._M, gradient, self._bounds, x, self.proxqp.scaled, self.proxqp.start)
        return True

    def _by_proxqp(
        self, hessian: np.ndarray, gradient: np.ndarray, active: np.ndarray, rows: Rows | None, step: np.ndarray
    ) -> Step | None:
        """The step of the problem that is ready, counted; `step` (nv,) is overwritten."""
        A, b = self._no_rows if rows is None else rows
        proxqp = self.proxqp
        for ask, rounds in ((proxqp.multipliers, 1), (proxqp.sharper, MENDED)):
            certified, promised = settle(
                hessian, self._M, gradient, self._bounds, A, b, ask(rows), self._sets, rounds, step
            )  # fmt: skip
            if certified:
                active[:] = self._sets
                self.tally[_PROXQP] += 1
                return step, promised
            self.uncertified += 1
        lower, upper = self._bounds
        if solve_box(self._M, gradient, lower, upper, active, ROUNDS, step) > 0 and np.all(A @ step >= b):
            self.tally[_ACTIVE_SET] += 1
            return step, model_decrease(hessian, gradient, step)
        self.tally[_FAILED] += 1
        return None


class ProxQP:
    """min 1/2 x'Mx + g'x within bounds and above rows, for any number of rows.

    scaled (n + 4, n), start (n,): a problem, written by `estimator.energy.descent.box_step.scale`. near (FEW,),
    few: the unknowns that bounds may stop, where they are few, and the problem in these, written by `box_step.reduce`.
    What multipliers come out may depend, in their last digits, on what was solved before.
    """

    def __init__(self, n: int) -> None:
        self.scaled, self.start = np.zeros((n + 4, n)), np.zeros(n)
        gradient, lower, upper, self._scale = self.scaled[n:]
        self._boxed = _program(self.scaled[:n], gradient, lower, upper)
        self.near, self.few = np.zeros(FEW, dtype=np.int64), np.zeros((FEW + 4) * FEW)
        self._few = [_parts(self.few, m) for m in range(FEW + 1)]
        self._of_few = np.zeros(n)
        self._solvers, self._solvers_of_few = (WarmSolvers(ACCURACY, 25, 50, p) for p in (PENALTY, PENALTY_OF_FEW))

    def multipliers(self, rows: Rows | None) -> np.ndarray:
        """Multipliers (m + n,) of the rows and the bounds, see `estimator.energy.descent.active_sets.settle`.

        rows: A (m, n) and b (m,), not scaled. The array is the solver's own, good until it solves again.
        """
        return self._solvers.multipliers(self._boxed if rows is None else self._above(rows), self.start)

    def multipliers_of_few(self, m: int) -> np.ndarray:
        """Multipliers (n,) of the bounds by the problem in m unknowns, zero for the others; good until the next."""
        self._of_few[:] = 0.0
        self._of_few[self.near[:m]] = self._solvers_of_few.multipliers(*self._few[m])
        return self._of_few

    def sharper(self, rows: Rows | None) -> np.ndarray:
        """The multipliers of the problem just solved, to a smaller residual, from where they are."""
        return self._solvers.sharper(len(self.start), 0 if rows is None else len(rows[1]), SHARP)

    def _above(self, rows: Rows) -> QuadraticProgram:
        """The problem with rows, which are in scaled variables and of length 1 then."""
        A = rows[0] / self._scale
        length = np.linalg.norm(A, axis=1)
        length = np.where(length > 0.0, length, 1.0)
        most = np.full(len(length), UNBOUNDED)
        return self._boxed._replace(rows=A / length[:, None], least=rows[1] / length, most=most)


def _parts(few: np.ndarray, m: int) -> tuple[QuadraticProgram, np.ndarray]:
    """The problem in m unknowns that `few` holds, see `box_step.reduce`, and its start (m,)."""
    gradient, lower, upper, start = few[m * m :][: 4 * m].reshape(4, m)
    return _program(few[: m * m].reshape(m, m), gradient, lower, upper), start


def _program(matrix: np.ndarray, gradient: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> QuadraticProgram:
    """A program with bounds alone."""
    none, nothing = np.zeros((0, len(gradient))), np.zeros(0)
    return QuadraticProgram(matrix, gradient, none, nothing, none, nothing, nothing, lower, upper)
