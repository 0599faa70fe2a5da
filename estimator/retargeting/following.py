"""A motion frame by frame: each from the one before."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.data.sequence import Progress
from estimator.retargeting.problem import MotionProblem
from estimator.retargeting.step import TRUST, constrained_step

_LOOSE = 15.0
"""By how much larger accelerations may be than in windows: what follows with inertia lags behind a quick limb, until it
is on the wrong side of it."""
_TOUCH = 1e-4  # m


class FollowedFrames(NamedTuple):
    """q (T, nq). met (T,): whether all that a frame has to keep to was met by its last step. pressed (T,): whether
    something kept it from going where it would, parts or the floor."""

    q: np.ndarray
    met: np.ndarray
    pressed: np.ndarray


def follow(
    problem: MotionProblem, start: np.ndarray, progress: Progress | None = None, *, backwards: bool = False
) -> FollowedFrames:
    """Frame after frame from start (nq,), the configuration of the first; or of the last, backwards."""
    body = problem.body
    q = np.empty((problem.frames, body.nq))
    met, pressed = np.ones(problem.frames, dtype=bool), np.zeros(problem.frames, dtype=bool)
    frames = range(problem.frames)[:: -1 if backwards else 1]
    q[frames[0]] = body.clamp(start)
    moved, last = np.zeros(body.nv), np.inf
    for before, t in pairwise(frames):
        dt = float(problem.dt[min(before, t)])
        q[t], met[t], pressed[t] = follow_frame(problem, t, q[before], moved * (dt / last), dt)
        moved, last = body.difference(q[before], q[t]), dt
        if progress is not None:
            progress(abs(t - frames[0]) + 1, problem.frames)
    return FollowedFrames(q, met, pressed)


def follow_frame(
    problem: MotionProblem, t: int, before: np.ndarray, ahead: np.ndarray, dt: float
) -> tuple[np.ndarray, bool, bool]:
    """Frame t from the configuration of a frame next to it (nq,), dt [s] away, that would move by ahead (nv,) if
    nothing happened; whether what it has to keep to was met, and pressed against it."""
    body = problem.body
    precision = 1.0 / (_LOOSE * problem.stiff * dt**2) ** 2
    low, high = problem.reach(before, before, dt)
    expected = body.integrate(before, np.clip(ahead, low, high))
    q, met, pressed = expected, True, False
    for _ in range(problem.settings.iterations):
        model = problem.model(t, q)
        rows = problem.rows(t, model)
        gradient = model.gradient + precision * body.difference(expected, q)
        hessian = model.hessian
        hessian[np.diag_indices(body.nv)] += precision
        box = np.clip(problem.reach(q, before, dt), -TRUST, TRUST)
        step, met = constrained_step(hessian, gradient, box, rows)
        pressed = bool((rows.above @ step < rows.least + _TOUCH).any())
        q = body.integrate(q, step)
    return q, met, pressed
