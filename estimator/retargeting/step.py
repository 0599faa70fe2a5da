"""The constrained step of a frame, or of a window of frames, by ProxQP."""

from __future__ import annotations

import numpy as np
from proxsuite import proxqp

ACCURACY = 1e-6
STANDING = 1e7  # energy by m^2 of a foot that cannot be where it stands
SHORT = 1e8  # energy by m^2 of parts that cannot be as far from each other, or the floor, as they have to
_ITERATIONS, _INNER = 60, 60
_FAR = 1e20


class DenseStep:
    """min 1/2 dx'H dx + g'dx within bounds, with rows. Equal problems have solutions that are equal to some 1e-9: the
    solver's last digits depend on where its memory lies."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._with_slack: DenseStep | None = None

    def solve(
        self,
        hessian: np.ndarray,
        gradient: np.ndarray,
        box: np.ndarray,
        equal: np.ndarray,
        to: np.ndarray,
        above: np.ndarray,
        least: np.ndarray,
    ) -> tuple[np.ndarray, bool]:
        """The step (n,), within its box (2, n) to the last bit, and whether it meets the rows: equal (m, n) dx = to
        (m,), above (k, n) dx >= least (k,). Where nothing does, what stands counts as an energy; where that does not
        help either, all of `above` may fall short by as little as there can be."""
        x = self._ask(hessian, gradient, box, equal, to, above, least)
        if x is not None:
            return np.clip(x, box[0], box[1]), True
        soft = hessian + STANDING * equal.T @ equal, gradient - STANDING * to @ equal
        none = np.zeros((0, self._n)), np.zeros(0)
        x = self._ask(*soft, box, *none, above, least)
        if x is None:
            x = self._falling_short(*soft, box, above, least)
        return np.clip(np.zeros(self._n) if x is None else x, box[0], box[1]), False

    def _falling_short(
        self, hessian: np.ndarray, gradient: np.ndarray, box: np.ndarray, above: np.ndarray, least: np.ndarray
    ) -> np.ndarray | None:
        """With above dx + s >= least, s as small as can be: a variable more."""
        n = self._n
        larger = np.zeros((n + 1, n + 1))
        larger[:n, :n], larger[n, n] = hessian, SHORT
        bounds = np.column_stack([box, [0.0, np.inf]])
        rows = np.column_stack([above, np.ones(len(least))])
        if self._with_slack is None:
            self._with_slack = DenseStep(n + 1)
        x = self._with_slack._ask(
            larger, np.append(gradient, 0.0), bounds, np.zeros((0, n + 1)), np.zeros(0), rows, least
        )
        return None if x is None else x[:n]

    def _ask(
        self,
        hessian: np.ndarray,
        gradient: np.ndarray,
        box: np.ndarray,
        equal: np.ndarray,
        to: np.ndarray,
        above: np.ndarray,
        least: np.ndarray,
    ) -> np.ndarray | None:
        n = self._n
        sizes = len(to), len(least)
        A, b = (equal, to) if len(to) else (None, None)
        C = lowest = highest = None
        if sizes[1]:
            C, lowest, highest = above, least, np.full(len(least), _FAR)
        low, high = np.maximum(box[0], -_FAR), np.minimum(box[1], _FAR)
        solver = proxqp.dense.QP(n, sizes[0], sizes[1], True)  # a new one: an old one's answers depend on its past
        settings = solver.settings
        settings.eps_abs, settings.eps_rel = ACCURACY, 0.0
        settings.max_iter, settings.max_iter_in = _ITERATIONS, _INNER
        settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
        solver.init(hessian, gradient, A, b, C, lowest, highest, low, high)
        solver.solve()
        x = solver.results.x
        if not np.isfinite(x).all() or solver.results.info.status != proxqp.QPSolverOutput.PROXQP_SOLVED:
            return None
        return np.array(x)
