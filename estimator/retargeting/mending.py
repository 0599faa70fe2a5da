"""The last look at a motion: frames that do not keep to all they have to are solved again, between their neighbours."""

from __future__ import annotations

import numpy as np

from estimator.retargeting.problem import MotionProblem
from estimator.retargeting.step import TRUST, constrained_step

_SWEEPS = 40
_HELD = 30.0  # rad/s^2 or m/s^2: standard deviation of what a frame moves away from where it is, as an acceleration
_ALONE = 1.0 / 30.0  # s: for which a frame without neighbours moves


def mend(problem: MotionProblem, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q (T, nq) with the frames that do not keep to their rows moved until they do, each within what the velocities to
    its neighbours leave it; these move along where that is too little. And which keep to them (T,) then."""
    q = q.copy()
    bad = np.array([not problem.keeps(t, each) for t, each in enumerate(q)], dtype=bool)
    for sweep in range(_SWEEPS):
        if not bad.any():
            break
        wide = bad if sweep % 2 == 0 else bad | np.r_[bad[1:], False] | np.r_[False, bad[:-1]]
        for t in np.flatnonzero(wide)[:: 1 if sweep % 4 < 2 else -1].tolist():
            q[t], bad[t] = _mended(problem, q, t)
    return q, ~bad


def _mended(problem: MotionProblem, q: np.ndarray, t: int) -> tuple[np.ndarray, bool]:
    """Frame t after one step, and whether it still does not keep to its rows."""
    body = problem.body
    model = problem.model(t, q[t])
    dt = float(problem.dt[min(t, len(problem.dt) - 1)]) if len(problem.dt) else _ALONE
    hessian = model.hessian
    hessian[np.diag_indices(body.nv)] += 1.0 / (_HELD * problem.stiff / problem.stiff.max() * dt**2) ** 2
    box = problem.box(q[t], t, q[t - 1] if t > 0 else None, q[t + 1] if t + 1 < len(q) else None)
    step, _ = constrained_step(hessian, model.gradient, np.clip(box, -TRUST, TRUST), problem.rows(t, model))
    moved = body.integrate(q[t], step)
    return moved, not problem.keeps(t, moved)
