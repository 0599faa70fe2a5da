"""A motion improved in windows: the poses of a window together, those around it held, by ProxQP's sparse solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from proxsuite import proxqp
from scipy import sparse

from estimator.energy.descent.proxqp import UNBOUNDED
from estimator.retargeting.following import FollowedFrames
from estimator.retargeting.problem import FrameModel, MotionProblem
from estimator.retargeting.step import STANDING, StepRows

_ACCURACY = 1e-5
_ITERATIONS, _INNER = 40, 40
_MISSED = 2e-5  # rad: by which the solver may miss a velocity's bound
_ASKED = 4
_NEAR_LIMIT = 0.5  # share of a velocity limit from which it gets a row
_TRUST = 0.5  # rad or m
_STILL = 0.03  # rad or m: what a step moves by less has come to rest; what is left of the rows is its square
_TIED = 2  # frames around a window that its accelerations reach


class _Window(NamedTuple):
    """Frames first to after of a motion with their models and rows."""

    first: int
    after: int
    models: list[FrameModel]
    rows: list[StepRows]


def improve(problem: MotionProblem, followed: FollowedFrames) -> np.ndarray:
    """Configurations (T, nq) after at most `rounds` of sweeps over windows that overlap by half, those left out that
    have come to rest. A window in which nothing meets all rows stays as it is."""
    q = followed.q.copy()
    size = problem.settings.window
    half = max(1, size // 2)
    moved = np.full(len(q), np.inf)  # in the last sweep, the largest part of a frame's step
    for _ in range(problem.settings.rounds):
        before, moved = moved, np.zeros(len(q))
        for first in range(0, max(1, len(q) - half), half):
            after = min(len(q), first + size)
            if before[max(0, first - _TIED) : after + _TIED].max() < _STILL:
                continue
            step = improve_window(problem, q, first, after)
            moved[first:after] = np.maximum(moved[first:after], step)
        if moved.max() < _STILL:
            break
    return q


def improve_window(problem: MotionProblem, q: np.ndarray, first: int, after: int) -> np.ndarray:
    """One constrained step of the frames first to after of q (T, nq), in place; the largest part (after - first,) of
    each frame's."""
    models = [problem.model(t, q[t]) for t in range(first, after)]
    window = _Window(first, after, models, [problem.rows(first + k, m) for k, m in enumerate(models)])
    step = _step(problem, q, window)
    if step is None:
        return np.zeros(after - first)
    for k, move in enumerate(step):
        q[first + k] = problem.body.integrate(q[first + k], move)
    return np.asarray(np.abs(step).max(axis=1))


def _step(problem: MotionProblem, q: np.ndarray, window: _Window) -> np.ndarray | None:
    """The step (W, nv) of a window; None where none meets the rows."""
    count = window.after - window.first
    gradient = np.concatenate([m.gradient for m in window.models])
    hessian = sparse.block_diag([m.hessian for m in window.models], format="csc")
    smooth, pull = _smoothness(problem, q, window)
    hessian = sparse.csc_matrix(hessian + smooth)
    gradient += pull
    box = np.concatenate([_box(problem, q, window, k) for k in range(count)], axis=1)
    equal = sparse.block_diag([rows.equal for rows in window.rows], format="csc")
    to = np.concatenate([rows.to for rows in window.rows])
    above = sparse.block_diag([rows.above for rows in window.rows], format="csc")
    least = np.concatenate([rows.least for rows in window.rows])
    programme = _Programme(hessian, gradient, box, equal, to, above, least)
    for each in (programme, programme.softened):
        step = _within_velocities(each, _Velocities.of(problem, q, window))
        if step is not None:
            return step
    return None


class _Programme(NamedTuple):
    """The quadratic programme of a window but for its velocities: Hessian (n, n) and gradient (n,); bounds (2, n);
    equal (m, n) x = to (m,); above (k, n) x >= least (k,)."""

    hessian: sparse.csc_matrix
    gradient: np.ndarray
    box: np.ndarray
    equal: sparse.csc_matrix
    to: np.ndarray
    above: sparse.csc_matrix
    least: np.ndarray

    @property
    def softened(self) -> _Programme:
        """With an energy in place of what is to be met: a foot is as near to where it stands as it can be."""
        return self._replace(
            hessian=sparse.csc_matrix(self.hessian + STANDING * self.equal.T @ self.equal),
            gradient=self.gradient - STANDING * self.equal.T @ self.to,
            equal=self.equal[:0],
            to=self.to[:0],
        )


def _within_velocities(programme: _Programme, velocities: _Velocities) -> np.ndarray | None:
    """The step (W, nv) of a window, asked again with more rows as long as joints are too quick in it; None where the
    solver finds none."""
    size, box = len(programme.gradient), programme.box
    for _ in range(_ASKED):
        quick, low, high = velocities.rows
        C = sparse.vstack([sparse.identity(size), programme.above, quick], format="csc")
        lower = np.concatenate([np.maximum(box[0], -_TRUST), programme.least, low])
        upper = np.concatenate([np.minimum(box[1], _TRUST), np.full(len(programme.least), UNBOUNDED), high])
        x = _asked(programme.hessian, programme.gradient, programme.equal, programme.to, C, lower, upper)
        if x is None:
            return None
        step = np.clip(x, lower[:size], upper[:size]).reshape(len(velocities.moved) + 1, -1)
        if velocities.hold_after(step):
            return np.asarray(step)
    return None


def _asked(
    hessian: sparse.csc_matrix, gradient: np.ndarray, equal: sparse.csc_matrix, to: np.ndarray, C: sparse.csc_matrix,
    lower: np.ndarray, upper: np.ndarray,
) -> np.ndarray | None:  # fmt: skip
    """ProxQP's answer, None where it has none."""
    solver = proxqp.sparse.QP(len(gradient), len(to), len(lower))
    settings = solver.settings
    settings.eps_abs, settings.eps_rel = _ACCURACY, 0.0
    settings.max_iter, settings.max_iter_in = _ITERATIONS, _INNER
    solver.init(hessian, gradient, equal, to, C, lower, upper)
    solver.solve()
    return np.array(solver.results.x) if solver.results.info.status == proxqp.QPSolverOutput.PROXQP_SOLVED else None


def _box(problem: MotionProblem, q: np.ndarray, window: _Window, k: int) -> np.ndarray:
    """Bounds (2, nv) of the step of frame k of a window, by its limits, and the velocities to frames that are held."""
    t = window.first + k
    before = q[t - 1] if k == 0 and t > 0 else None
    after = q[t + 1] if t == window.after - 1 and t + 1 < len(q) else None
    return problem.box(q[t], t, before, after)


class _Velocities(NamedTuple):
    """Between the frames of a window: moved (W - 1, nv), reach (W - 1, nv) at most, and which have rows, quick (W - 1,
    nv) bool."""

    moved: np.ndarray
    reach: np.ndarray
    quick: np.ndarray

    @staticmethod
    def of(problem: MotionProblem, q: np.ndarray, window: _Window) -> _Velocities:
        """Those that are quick already have rows."""
        frames = range(window.first, window.after - 1)
        moved = np.array([problem.body.difference(q[t], q[t + 1]) for t in frames]).reshape(-1, problem.body.nv)
        reach = problem.dt[window.first : window.after - 1, None] * problem.speed
        return _Velocities(moved, reach, np.abs(moved) > _NEAR_LIMIT * reach)

    @property
    def rows(self) -> tuple[sparse.csc_matrix, np.ndarray, np.ndarray]:
        """The rows and their bounds."""
        n = self.moved.shape[1]
        first = np.flatnonzero(self.quick)
        number = np.arange(len(first))
        entries = np.concatenate([np.full(len(first), -1.0), np.ones(len(first))])
        places = np.tile(number, 2), np.concatenate([first, first + n])
        matrix = sparse.csc_matrix((entries, places), shape=(len(first), n * (len(self.moved) + 1)))
        moved, reach = self.moved[self.quick], self.reach[self.quick] - _MISSED
        return matrix, -reach - moved, reach - moved

    def hold_after(self, step: np.ndarray) -> bool:
        """Whether all keep to their reach after a step (W, nv); those that do not get rows."""
        over = np.abs(self.moved + np.diff(step, axis=0)) > self.reach
        self.quick[over] = True
        return not over.any()


def _smoothness(problem: MotionProblem, q: np.ndarray, window: _Window) -> tuple[sparse.csc_matrix, np.ndarray]:
    """Hessian and gradient (W nv,) of accelerations in which frames of the window have a part, in units of their
    standard deviations; those around it are held."""
    n, count = problem.body.nv, window.after - window.first
    gradient = np.zeros((count, n))
    bands = np.zeros((3, count))  # of the Hessian, of each degree of freedom alike but for its precision
    precision = 1.0 / np.square(problem.stiff)
    for t in range(max(1, window.first - 1), min(len(q) - 1, window.after + 1)):
        before, after = problem.dt[t - 1], problem.dt[t]
        mean = 0.5 * (before + after)
        share = np.array([1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after]) / mean
        a = problem.body.difference(q[t], q[t + 1]) / after - problem.body.difference(q[t - 1], q[t]) / before
        a *= precision / mean
        inside = [t + d - window.first for d in (-1, 0, 1)]
        for i, k in enumerate(inside):
            if not 0 <= k < count:
                continue
            gradient[k] += share[i] * a
            for j in range(i, 3):
                if 0 <= inside[j] < count:
                    bands[j - i, k] += share[i] * share[j]
    offsets = [d for d in (0, 1, -1, 2, -2) if abs(d) < count]
    tri = sparse.diags([bands[abs(d), : count - abs(d)] for d in offsets], offsets, shape=(count, count))
    return sparse.csc_matrix(sparse.kron(tri, sparse.diags(precision))), gradient.ravel()
