"""ProxQP on the problem of one step: scaled, warm started, asked again more sharply where that is needed.

Measured on the steps of a tracked clip: scaled variables make the preconditioner needless, which takes longer than the
solver itself; multipliers name the active bounds where positions do not; a tolerance below 1e-8 without a cap on the
iterations may not return.
"""

from __future__ import annotations

import numpy as np
from proxsuite import proxqp

ACCURACY, SHARP = 1e-6, 1e-9  # absolute, in scaled variables; the second where the first is not enough
# of the augmented Lagrangian's first round: on rows and bounds of the whole problem, on those of few unknowns, and on
# the variables
PENALTY, PENALTY_OF_FEW, PROXIMAL = 1e-3, 1e-6, 1e-6
OUTER, INNER = 25, 50  # iterations
FEW = 8  # unknowns at most that a smaller problem is made of
UNBOUNDED = 1e20  # what ProxQP takes for infinity
_NO_ROWS = None, None, None

Rows = tuple[np.ndarray, np.ndarray]
"""A (m, n) and b (m,): A x >= b."""
QuadraticProgram = tuple[np.ndarray | None, ...]
"""What ProxQP takes: matrix, gradient, no equations, rows with their lower and upper sides, lower and upper bounds."""


class ProxQP:
    """min 1/2 x'Mx + g'x within bounds and above rows, for any number of rows; one persistent object for each number of
    unknowns and rows.

    scaled (n + 4, n), start (n,): a problem, written by `estimator.energy.descent.box_step.scale`. near (FEW,),
    few: the unknowns that bounds may stop, where they are few, and the problem in these, written by `box_step.reduce`.
    What multipliers come out may depend, in their last digits, on what was solved before.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self.scaled, self.start = np.zeros((n + 4, n)), np.zeros(n)
        self._matrix, (self._gradient, self._lower, self._upper, self._scale) = self.scaled[:n], self.scaled[n:]
        self.near, self.few = np.zeros(FEW, dtype=np.int64), np.zeros((FEW + 4) * FEW)
        self._few = [_parts(self.few, m) for m in range(FEW + 1)]
        self._of_few = np.zeros(n)
        self._solvers: dict[tuple[int, int], proxqp.dense.QP] = {}  # by unknowns and rows
        self._zeros = np.zeros(n)

    def multipliers(self, rows: Rows | None) -> np.ndarray:
        """Multipliers (m + n,) of the rows and the bounds, see `estimator.energy.descent.active_sets.settle`.

        rows: A (m, n) and b (m,), not scaled. The array is the solver's own, good until it solves again.
        """
        scaled = _NO_ROWS if rows is None else self._scaled(rows)
        problem = self._matrix, self._gradient, None, None, *scaled, self._lower, self._upper
        return self._solved(self._n, 0 if rows is None else len(rows[1]), problem, self.start)

    def multipliers_of_few(self, m: int) -> np.ndarray:
        """Multipliers (n,) of the bounds by the problem in m unknowns, zero for the others; good until the next."""
        problem, start = self._few[m]
        self._of_few[:] = 0.0
        self._of_few[self.near[:m]] = self._solved(m, 0, problem, start)
        return self._of_few

    def _solved(self, n: int, m: int, problem: QuadraticProgram, start: np.ndarray) -> np.ndarray:
        """Multipliers (m + n,) of a problem in n unknowns with m rows, from a start (n,); the solver's own array."""
        solver = self._solvers.get((n, m))
        if solver is None:
            solver = self._solvers[n, m] = _made(n, m, PENALTY if n == self._n else PENALTY_OF_FEW)
            solver.init(*problem, compute_preconditioner=False)
        else:
            solver.update(*problem)
        results = solver.results  # an update clears them
        results.x, results.z = start, self._zeros[:n] if m == 0 else np.zeros(m + n)
        solver.solve()
        return results.z

    def sharper(self, rows: Rows | None) -> np.ndarray:
        """The multipliers of the problem just solved, to a smaller residual, from where they are."""
        solver = self._solvers[self._n, 0 if rows is None else len(rows[1])]
        settings = solver.settings
        settings.eps_abs, settings.initial_guess = SHARP, proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        solver.solve()
        settings.eps_abs, settings.initial_guess = ACCURACY, proxqp.InitialGuess.WARM_START
        return solver.results.z

    def _scaled(self, rows: Rows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The rows in scaled variables, each of length 1, and their bounds."""
        A = rows[0] / self._scale
        length = np.linalg.norm(A, axis=1)
        length = np.where(length > 0.0, length, 1.0)
        return A / length[:, None], rows[1] / length, np.full(len(length), UNBOUNDED)


def _parts(few: np.ndarray, m: int) -> tuple[QuadraticProgram, np.ndarray]:
    """The problem in m unknowns that `few` holds, see `box_step.reduce`, and its start (m,)."""
    gradient, lower, upper, start = few[m * m :][: 4 * m].reshape(4, m)
    return (few[: m * m].reshape(m, m), gradient, None, None, *_NO_ROWS, lower, upper), start


def _made(n: int, m: int, penalty: float) -> proxqp.dense.QP:
    dense = proxqp.dense
    solver = dense.QP(n, 0, m, True, dense.HessianType.Dense, dense.DenseBackend.PrimalDualLDLT)
    settings = solver.settings
    settings.eps_abs, settings.eps_rel = ACCURACY, 0.0
    settings.default_mu_in, settings.default_rho = penalty, PROXIMAL
    settings.max_iter, settings.max_iter_in = OUTER, INNER
    settings.frequence_infeasibility_check = 1_000_000  # never: a step of nothing is feasible
    settings.initial_guess = proxqp.InitialGuess.WARM_START
    return solver
