"""A motion improved in windows: the poses of a window together, those around it held, by a sparse quadratic program."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from estimator.numerics.quadratic_program import UNBOUNDED, QuadraticProgram, solve
from estimator.retargeting.following import FollowedFrames
from estimator.retargeting.problem import STANDING, MotionProblem

_ACCURACY, _ITERATIONS = 1e-5, 40
_MISSED = 2e-5  # rad: by which the solver may miss a velocity's bound
_ASKED = 4
_NEAR_LIMIT = 0.5  # share of a velocity limit from which it gets a row
_TRUST = 0.5  # rad or m
_STILL = 0.03  # rad or m: what a step moves by less has come to rest; what is left of the rows is its square
_TIED = 2  # frames around a window that its accelerations reach


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
    step = _step(problem, q, first, after)
    if step is None:
        return np.zeros(after - first)
    for k, move in enumerate(step):
        q[first + k] = problem.body.integrate(q[first + k], move)
    return np.asarray(np.abs(step).max(axis=1))


def _step(problem: MotionProblem, q: np.ndarray, first: int, after: int) -> np.ndarray | None:
    """The step (W, nv) of a window; None where none meets the rows."""
    models = [problem.model(t, q[t]) for t in range(first, after)]
    of_frames = [problem.rows(first + k, model) for k, model in enumerate(models)]
    smooth, pull = _smoothness(problem, q, first, after)
    hessian = sparse.csc_matrix(sparse.block_diag([m.hessian for m in models], format="csc") + smooth)
    gradient = np.concatenate([m.gradient for m in models]) + pull
    box = np.concatenate([_box(problem, q, first, after, t) for t in range(first, after)], axis=1)
    equal, above = (sparse.block_diag([rows[i] for rows in of_frames], format="csc") for i in (0, 2))
    to, least = (np.concatenate([rows[i] for rows in of_frames]) for i in (1, 3))
    most = np.full(len(least), UNBOUNDED)
    low, high = np.maximum(box[0], -_TRUST), np.minimum(box[1], _TRUST)
    program = QuadraticProgram(hessian, gradient, equal, to, above, least, most, low, high)
    for each in (program, program.softened(STANDING)):
        step = _within_velocities(each, _Velocities.of(problem, q, first, after))
        if step is not None:
            return step
    return None


def _within_velocities(program: QuadraticProgram, velocities: _Velocities) -> np.ndarray | None:
    """The step (W, nv) of a window, solved again with more rows as long as joints are too quick in it; None where none
    is found. Softened, a foot is as near to where it stands as it can be."""
    for _ in range(_ASKED):
        quick, low, high = velocities.rows
        rows = sparse.vstack([program.rows, quick], format="csc")
        least, most = np.append(program.least, low), np.append(program.most, high)
        answer = solve(program._replace(rows=rows, least=least, most=most), _ACCURACY, _ITERATIONS)
        if not answer.solved:
            return None
        step = np.clip(answer.x, program.low, program.high).reshape(len(velocities.moved) + 1, -1)
        if velocities.hold_after(step):
            return np.asarray(step)
    return None


def _box(problem: MotionProblem, q: np.ndarray, first: int, after: int, t: int) -> np.ndarray:
    """Bounds (2, nv) of the step of frame t of a window, by its limits, and the velocities to frames that are held."""
    held_before = q[t - 1] if t == first and t > 0 else None
    held_after = q[t + 1] if t == after - 1 and after < len(q) else None
    return problem.box(q[t], t, held_before, held_after)


class _Velocities(NamedTuple):
    """Between the frames of a window: moved (W - 1, nv), reach (W - 1, nv) at most, and which have rows, quick (W - 1,
    nv) bool."""

    moved: np.ndarray
    reach: np.ndarray
    quick: np.ndarray

    @staticmethod
    def of(problem: MotionProblem, q: np.ndarray, first: int, after: int) -> _Velocities:
        """Those that are quick already have rows."""
        moved = _moved(problem, q, first, after - 1)
        reach = problem.dt[first : after - 1, None] * problem.speed
        return _Velocities(moved, reach, np.abs(moved) > _NEAR_LIMIT * reach)

    @property
    def rows(self) -> tuple[sparse.csc_matrix, np.ndarray, np.ndarray]:
        """The rows and their bounds."""
        size, n = self.moved.size, self.moved.shape[1]
        matrix = sparse.eye(size, size + n, n, format="csr") - sparse.eye(size, size + n, format="csr")
        moved, reach = self.moved[self.quick], self.reach[self.quick] - _MISSED
        return matrix[self.quick.ravel()], -reach - moved, reach - moved

    def hold_after(self, step: np.ndarray) -> bool:
        """Whether all keep to their reach after a step (W, nv); those that do not get rows."""
        over = np.abs(self.moved + np.diff(step, axis=0)) > self.reach
        self.quick[over] = True
        return not over.any()


def _smoothness(problem: MotionProblem, q: np.ndarray, first: int, after: int) -> tuple[sparse.csc_matrix, np.ndarray]:
    """Hessian and gradient (W nv,) of accelerations in which frames of the window have a part, in units of their
    standard deviations; those around it are held, and steps just add up."""
    begin, end = max(0, first - 2), min(len(q) - 1, after + 1)
    rates, precision = 1.0 / problem.dt[begin:end], 1.0 / np.square(problem.stiff)
    span = 0.5 * (problem.dt[begin:end][:-1] + problem.dt[begin:end][1:])
    accelerations = np.diff(_moved(problem, q, begin, end) * rates[:, None], axis=0) / span[:, None]
    factors = np.stack([rates[:-1], -rates[:-1] - rates[1:], rates[1:]]) / span
    shares = sum(factor[:, None] * np.eye(len(span), len(span) + 2, k) for k, factor in enumerate(factors))
    shares = shares[:, first - begin : after - begin]  # of the window's frames in the accelerations
    hessian = sparse.kron(sparse.csc_matrix(shares.T @ shares), sparse.diags(precision), format="csc")
    return hessian, (shares.T @ (accelerations * precision)).ravel()


def _moved(problem: MotionProblem, q: np.ndarray, first: int, after: int) -> np.ndarray:
    """Steps (after - first, nv) of the body to the next frame, from each of these."""
    return np.reshape([problem.body.difference(q[t], q[t + 1]) for t in range(first, after)], (-1, problem.body.nv))
