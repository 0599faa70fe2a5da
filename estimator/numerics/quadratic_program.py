"""Convex quadratic programs by ProxQP, dense or sparse, alone or one after the other from warm starts.

The solver's own status is not trusted: `solve` checks the answer against the program, and users of `WarmSolvers`, whose
calls take microseconds, certify the active constraints that its multipliers name. No program raises.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from proxsuite import proxqp
from scipy import sparse

UNBOUNDED = 1e20  # what ProxQP takes for infinity
_ROUNDED = 1.001  # what an answer may miss its accuracy by, as the solver computes the residual with other roundings

Matrix: TypeAlias = np.ndarray | sparse.csc_matrix


class QuadraticProgram(NamedTuple):
    """min 1/2 x'Hx + g'x  subject to  equal x = to,  least <= rows x <= most,  low <= x <= high.

    hessian (n, n), gradient (n,); equal (m, n), to (m,); rows (k, n), least, most (k,); low, high (n,). Matrices are
    arrays, or all of them sparse. The fields are in ProxQP's order.
    """

    hessian: Matrix
    gradient: np.ndarray
    equal: Matrix
    to: np.ndarray
    rows: Matrix
    least: np.ndarray
    most: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def softened(self, stiffness: float) -> QuadraticProgram:
        """The program with an energy of 1/2 stiffness |equal x - to|^2 in place of the equations."""
        weighted = stiffness * self.equal.T
        return self._replace(
            hessian=self.hessian + weighted @ self.equal, gradient=self.gradient - weighted @ self.to,
            equal=self.equal[:0], to=self.to[:0],
        )  # fmt: skip

    def residual(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> float:
        """The largest violation of a constraint, or of the gradient's balance, by x (n,) and the multipliers of the
        equations (m,) and of rows and bounds together (k + n,). NaN where one of these is."""
        k, reached, missed = len(self.least), self.rows @ x, self.equal @ x - self.to
        balance = self.hessian @ x + self.gradient + self.equal.T @ y + self.rows.T @ z[:k] + z[k:]
        off = balance, -balance, missed, -missed, self.least - reached, reached - self.most, self.low - x, x - self.high
        return float(np.concatenate(off).max(initial=0.0))


class Answer(NamedTuple):
    """x (n,). residual: see `QuadraticProgram.residual`. solved: whether it is within the requested accuracy."""

    x: np.ndarray
    residual: float
    solved: bool


def solve(program: QuadraticProgram, accuracy: float, iterations: int) -> Answer:
    """The answer of a new solver, as those of an old one depend on what it solved before; the last digits, some 1e-9,
    depend on its memory alignment nevertheless. accuracy: absolute. iterations: at most, inner ones of each too."""
    low, high = np.maximum(program.low, -UNBOUNDED), np.minimum(program.high, UNBOUNDED)
    program = program._replace(low=low, high=high)
    n, m, k = len(low), len(program.to), len(program.least)
    if sparse.issparse(program.hessian):
        solver = proxqp.sparse.QP(n, m, k + n)  # which takes no bounds but as rows
        rows = sparse.vstack([program.rows, sparse.identity(n)], format="csc")
        given: tuple[Matrix, ...] = *program[:4], rows, np.append(program.least, low), np.append(program.most, high)
    else:
        solver, given = proxqp.dense.QP(n, m, k, True), program
        solver.settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
    _limit(solver.settings, accuracy, iterations, iterations)
    solver.init(*given)
    solver.solve()
    x, y, z = solver.results.x, solver.results.y, solver.results.z
    return Answer(np.array(x), residual := program.residual(x, y, z), residual <= _ROUNDED * accuracy)


class WarmSolvers:
    """Dense programs without equations, each solved from a start, by a solver for each number of unknowns and rows.

    The programs are feasible and scaled: the search for a proof of the contrary is left out, and the preconditioner,
    which takes longer than the solver itself. accuracy, outer, inner: as in `solve`. penalty: of the augmented
    Lagrangian's first round, on rows and bounds. Multipliers are a solver's own array, good until it solves again;
    their last digits may depend on what was solved before.
    """

    def __init__(self, accuracy: float, outer: int, inner: int, penalty: float) -> None:
        self._limits, self._penalty = (accuracy, outer, inner), penalty
        self._solvers: dict[tuple[int, int], Any] = {}

    def multipliers(self, program: QuadraticProgram, start: np.ndarray) -> np.ndarray:
        """Those (m + n,) of rows and bounds, from a start (n,)."""
        size = n, m = len(start), len(program.least)
        hessian, gradient, _, _, rows, least, most, low, high = program
        of_rows = (rows, least, most) if m else (None, None, None)  # which is quicker than empty ones
        solver = self._solvers.get(size)
        if solver is None:
            solver = self._solvers[size] = self._made(n, m)
            solver.init(hessian, gradient, None, None, *of_rows, low, high, compute_preconditioner=False)
        else:
            solver.update(hessian, gradient, None, None, *of_rows, low, high)
        results = solver.results  # an update clears them
        results.x, results.z = start, np.zeros(n + m)
        solver.solve()
        return results.z

    def sharper(self, n: int, m: int, accuracy: float) -> np.ndarray:
        """The multipliers of the last program in n unknowns with m rows to another accuracy, from where they are."""
        solver, guess = self._solvers[n, m], proxqp.InitialGuess
        settings = solver.settings
        settings.eps_abs, settings.initial_guess = accuracy, guess.WARM_START_WITH_PREVIOUS_RESULT
        solver.solve()
        settings.eps_abs, settings.initial_guess = self._limits[0], guess.WARM_START
        return solver.results.z

    def _made(self, n: int, m: int) -> Any:
        kind = proxqp.dense
        solver = kind.QP(n, 0, m, True, kind.HessianType.Dense, kind.DenseBackend.PrimalDualLDLT)
        settings = solver.settings
        settings.default_mu_in, settings.initial_guess = self._penalty, proxqp.InitialGuess.WARM_START
        settings.frequence_infeasibility_check = 1_000_000  # never
        _limit(settings, *self._limits)
        return solver


def _limit(settings: Any, accuracy: float, outer: int, inner: int) -> None:
    settings.eps_abs, settings.eps_rel = accuracy, 0.0
    settings.max_iter, settings.max_iter_in = outer, inner
