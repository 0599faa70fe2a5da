"""A motion frame by frame: each from the one before.

Several ways to follow a motion, and the best of them in every frame.

Parts that keep clear of each other have more than one side to pass on: a motion that is followed frame by frame may get
stuck on the wrong one. It is followed forwards, backwards, and frame by frame from where the body would be if its parts
went through each other; the way of least energy through these is taken (Viterbi), in which joints keep to their
velocities.

The first configuration of a motion: the best of several beginnings.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.sequence import Progress
from estimator.numerics.alignment import similarity_onto
from estimator.retargeting.problem import TRUST, MotionProblem, constrained_step
from humanoid.kinematics.body import ROOT_Q, points_in_world

_TRIED, _STEPS = 12, 40
_STILL = 1e-3
_DAMPING = 1e-3
_UNMET_AT_FIRST = 1e6  # energy: what does not keep to its constraints is worse than anything that does


def best_start(problem: MotionProblem, rng: np.random.Generator, count: int) -> np.ndarray:
    """Configuration (nq,) of the first frame: the best that is found from the neutral one and count - 1 random ones."""
    body, starts = problem.body, [problem.body.neutral]
    for _ in range(1, count):
        q = body.neutral.copy()
        low, high = body.lower[body.bounded_q], body.upper[body.bounded_q]
        q[body.bounded_q] = low + rng.uniform(0.25, 0.75, len(low)) * (high - low)
        starts.append(q)
    return _best_of(problem, starts)


def start_from(problem: MotionProblem, q: np.ndarray) -> np.ndarray:
    """Configuration (nq,) of the first frame: the best that is found from q (nq,), clamped into the limits, from rest,
    and from half of the way between them. A limb that begins on the wrong side of the body may never come around it."""
    body = problem.body
    q = body.clamp(q)
    way = body.difference(body.neutral, q)
    return _best_of(problem, [q, body.clamp(body.integrate(body.neutral, 0.5 * way)), body.neutral])


def _best_of(problem: MotionProblem, starts: Sequence[np.ndarray]) -> np.ndarray:
    """The start of least energy among those with the root placed on the targets and searched towards a minimum,
    searched to the end."""
    ends = [searched(problem, placed_root(problem, q), steps=_TRIED) for q in starts]
    energies = [problem.model(0, q).value + (0.0 if met else _UNMET_AT_FIRST) for q, met in ends]
    return searched(problem, ends[int(np.argmin(energies))][0])[0]


def searched(problem: MotionProblem, q: np.ndarray, *, frame: int = 0, steps: int = _STEPS) -> tuple[np.ndarray, bool]:
    """A minimum of a frame by itself from q (nq,), clamped into the limits first, and whether it keeps to its rows."""
    body, met = problem.body, False
    q = body.clamp(q)
    for _ in range(steps):
        model = problem.model(frame, q)
        hessian = model.hessian + _DAMPING * np.diag(np.diag(model.hessian))
        box = np.clip(problem.box(q, frame, None, None), -TRUST, TRUST)
        step, met = constrained_step(hessian, model.gradient, box, problem.rows(frame, model))
        q = body.integrate(q, step)
        if np.abs(step).max() < _STILL:
            break
    return q, met


def placed_root(problem: MotionProblem, q: np.ndarray) -> np.ndarray:
    """q (nq,) with its root where places and directions fit the first frame's best; as it is with a fixed root."""
    body, targets = problem.body, problem.targets
    if not body.has_free_root:
        return q
    own = targets.combination @ points_in_world(body.at(q), targets.joint, targets.local)
    wanted, known = targets.target[0], targets.weight[0] > 0.0
    is_place = np.abs(targets.combination.sum(axis=1) - 1.0) < 1e-9  # of a direction the shares cancel
    if not (known & is_place).any():
        return q
    centre, centre_wanted = (x[known & is_place].mean(axis=0) for x in (own, wanted))
    a = np.concatenate([own[known & ~is_place], own[known & is_place] - centre])
    b = np.concatenate([wanted[known & ~is_place], wanted[known & is_place] - centre_wanted])
    R = similarity_onto(np.concatenate([a, -a]), np.concatenate([b, -b])).R
    turn = pin.SE3(R, centre_wanted - R @ centre)
    placed = q.copy()
    placed[ROOT_Q] = pin.SE3ToXYZQUAT(turn * pin.XYZQUATToSE3(q[ROOT_Q]))
    return placed


_LOOSE = 15.0
"""Factor of accelerations over those in windows: a follower with inertia lags behind a quick limb, until it
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


_UNMET = 1e4  # energy of a frame that does not keep to what it has to
_PACE = 3.0  # rad/s or m/s: standard deviation of what a body moves by from frame to frame
_STUCK = 3.0  # energy above that of the body whose parts do not count, from which a frame may be stuck
_PUSHES = 8
_APART = 1  # number of the branch whose frames were found each by itself: nothing has kept them to the velocities


def best_branch(problem: MotionProblem, start: np.ndarray, progress: Progress | None = None) -> FollowedFrames:
    """The motion from start (nq,) on; other branches are tried only where the first may be stuck."""
    forwards = follow(problem, start, progress)
    if problem.collision is None or problem.frames < 2 or not forwards.pressed.any():
        return forwards
    free = follow(problem.without_parts(), start)
    energy, least = _energies(problem, forwards), _energies(problem, free)
    if not (energy > least + _STUCK).any():
        return forwards
    pushed = _pushed(problem, free, energy > least + _STUCK)
    branches = [forwards, pushed, follow(problem, pushed.q[-1], backwards=True)]
    return _chosen(problem, branches, [energy, *(_energies(problem, branch) for branch in branches[1:])])


def _energies(problem: MotionProblem, branch: FollowedFrames) -> np.ndarray:
    """Energy (T,) of every frame by itself."""
    values = [problem.model(t, q).value for t, q in enumerate(branch.q)]
    return np.array(values) + np.where(branch.met, 0.0, _UNMET)


def _pushed(problem: MotionProblem, free: FollowedFrames, where: np.ndarray) -> FollowedFrames:
    """Configurations of a body whose parts went through each other, pushed apart in the frames `where` (T,)."""
    q, met = free.q.copy(), free.met.copy()
    for t in np.flatnonzero(where | ~met):
        q[t], met[t] = searched(problem, q[t], frame=int(t), steps=_PUSHES)
    return FollowedFrames(q, met, free.pressed)


def _chosen(
    problem: MotionProblem, branches: Sequence[FollowedFrames], energies: Sequence[np.ndarray]
) -> FollowedFrames:
    """The way of least energy and movement through the branches."""
    body, count = problem.body, len(branches)
    cost, before = np.array([e[0] for e in energies]), np.zeros((problem.frames, count), dtype=int)
    for t in range(1, problem.frames):
        dt = float(problem.dt[t - 1])
        ways = np.empty((count, count))
        for a, first in enumerate(branches):
            for b, second in enumerate(branches):
                moved = body.difference(first.q[t - 1], second.q[t])
                ways[a, b] = 0.5 * float(np.square(moved / (_PACE * dt)).sum())
                if (a != b or a == _APART) and (np.abs(moved) > problem.speed * dt).any():
                    ways[a, b] = np.inf
        total = cost[:, None] + ways
        before[t] = total.argmin(axis=0)
        cost = total.min(axis=0) + np.array([e[t] for e in energies])
    path = [int(cost.argmin())]
    for t in range(problem.frames - 1, 0, -1):
        path.append(int(before[t, path[-1]]))
    path.reverse()
    rows = list(enumerate(path))
    each = ([getattr(branches[k], name)[t] for t, k in rows] for name in FollowedFrames._fields)
    return FollowedFrames(*(np.array(values) for values in each))
