"""The constrained step of a frame, by ProxQP."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from proxsuite import proxqp

from estimator.energy.descent.proxqp import UNBOUNDED

TRUST = 0.4
"""[rad or m] A frame's step: what stands may be far from where the body is, and rows are linear."""
STANDING = 1e7  # energy by m^2 of a foot that cannot be where it stands
SHORT = 1e8  # energy by m^2 of parts that cannot be as far from each other, or the floor, as they have to
_ACCURACY = 1e-6
_ITERATIONS, _INNER = 60, 60


class StepRows(NamedTuple):
    """What a step dx has to meet: equal dx = to, equal (m, nv) and to (m,), and above dx >= least, (k, nv) and (k,)."""

    equal: np.ndarray
    to: np.ndarray
    above: np.ndarray
    least: np.ndarray


def constrained_step(
    hessian: np.ndarray, gradient: np.ndarray, box: np.ndarray, rows: StepRows
) -> tuple[np.ndarray, bool]:
    """The step (n,) that minimises 1/2 dx'H dx + g'dx, within its box (2, n) to the last bit, and whether it meets the
    rows.

    Where nothing does, what stands counts as an energy; where that does not help either, all of `above` may fall short
    by as little as there can be. Equal problems have solutions that are equal to some 1e-9: the solver's last digits
    depend on where its memory lies.
    """
    x = _asked(hessian, gradient, box, rows)
    met = x is not None
    if x is None:
        hessian, gradient = hessian + STANDING * rows.equal.T @ rows.equal, gradient - STANDING * rows.to @ rows.equal
        rows = rows._replace(equal=rows.equal[:0], to=rows.to[:0])
        x = _asked(hessian, gradient, box, rows)
    if x is None:
        x = _falling_short(hessian, gradient, box, rows)
    return np.clip(np.zeros(len(gradient)) if x is None else x, box[0], box[1]), met


def _falling_short(hessian: np.ndarray, gradient: np.ndarray, box: np.ndarray, rows: StepRows) -> np.ndarray | None:
    """With above dx + s >= least, s as small as can be: a variable more. There are no equations."""
    n = len(gradient)
    larger = np.zeros((n + 1, n + 1))
    larger[:n, :n], larger[n, n] = hessian, SHORT
    with_slack = rows._replace(
        equal=np.zeros((0, n + 1)), above=np.column_stack([rows.above, np.ones(len(rows.least))])
    )
    x = _asked(larger, np.append(gradient, 0.0), np.column_stack([box, [0.0, np.inf]]), with_slack)
    return None if x is None else x[:n]


def _asked(hessian: np.ndarray, gradient: np.ndarray, box: np.ndarray, rows: StepRows) -> np.ndarray | None:
    """ProxQP's answer, None where it has none."""
    A, b = (rows.equal, rows.to) if len(rows.to) else (None, None)
    C = lowest = highest = None
    if len(rows.least):
        C, lowest, highest = rows.above, rows.least, np.full(len(rows.least), UNBOUNDED)
    low, high = np.maximum(box[0], -UNBOUNDED), np.minimum(box[1], UNBOUNDED)
    solver = proxqp.dense.QP(len(gradient), len(rows.to), len(rows.least), True)  # an old one's answers have a past
    settings = solver.settings
    settings.eps_abs, settings.eps_rel = _ACCURACY, 0.0
    settings.max_iter, settings.max_iter_in = _ITERATIONS, _INNER
    settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
    solver.init(hessian, gradient, A, b, C, lowest, highest, low, high)
    solver.solve()
    x = solver.results.x
    if not np.isfinite(x).all() or solver.results.info.status != proxqp.QPSolverOutput.PROXQP_SOLVED:
        return None
    return np.array(x)
