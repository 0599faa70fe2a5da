"""Several ways to follow a motion, and the best of them in every frame.

Parts that keep clear of each other have more than one side to pass on: a motion that is followed frame by frame may get
stuck on the wrong one. It is followed forwards, backwards, and frame by frame from where the body would be if its parts
went through each other; the way of least energy through these is taken (Viterbi), in which joints keep to their
velocities.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.sequence import Progress
from estimator.retargeting.following import FollowedFrames, follow
from estimator.retargeting.problem import MotionProblem
from estimator.retargeting.start import searched

_UNMET = 1e4  # energy of a frame that does not keep to what it has to
_PACE = 3.0  # rad/s or m/s: standard deviation of what a body moves by from frame to frame
_STUCK = 3.0  # energy above that of the body whose parts do not count, from which a frame may be stuck
_PUSHES = 8
_APART = 1  # number of the branch whose frames were found each by itself: nothing has kept them to the velocities


def best_branch(problem: MotionProblem, start: np.ndarray, progress: Progress | None = None) -> FollowedFrames:
    """The motion from start (nq,) on; other branches are looked at only where the first may be stuck."""
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
