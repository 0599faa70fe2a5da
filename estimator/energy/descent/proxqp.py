"""ProxQP on the problem of one step: scaled, warm started, asked again more sharply where that is needed.

Measured on the steps of a tracked clip: scaled variables make the preconditioner needless; multipliers name the active
bounds where positions do not; a tolerance below 1e-8 without a cap on the iterations may not return.
"""

from __future__ import annotations

import numpy as np

from estimator.numerics.quadratic_program import UNBOUNDED, QuadraticProgram, WarmSolvers

ACCURACY, SHARP = 1e-6, 1e-9  # in scaled variables; the second where the first is not enough
PENALTY, PENALTY_OF_FEW = 1e-3, 1e-6  # of the solver's first round, in the whole problem and in that of few unknowns
FEW = 8  # unknowns at most that a smaller problem is made of

Rows = tuple[np.ndarray, np.ndarray]
"""A (m, n) and b (m,): A x >= b."""


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
    """With bounds alone."""
    none, nothing = np.zeros((0, len(gradient))), np.zeros(0)
    return QuadraticProgram(matrix, gradient, none, nothing, none, nothing, nothing, lower, upper)
