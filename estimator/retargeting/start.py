"""The first configuration of a motion: the best of several beginnings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from estimator.numerics.alignment import similarity_onto
from estimator.retargeting.problem import MotionProblem
from estimator.retargeting.step import TRUST, constrained_step
from humanoid.kinematics.body import ROOT_Q, points_in_world

_TRIED, _STEPS = 12, 40
_STILL = 1e-3
_DAMPING = 1e-3
_UNMET = 1e6  # energy: what does not keep to its constraints is worse than anything that does


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
    """Each with its root placed on the targets and searched towards a minimum; that of the least energy, searched to
    the end."""
    ends = [searched(problem, placed_root(problem, q), steps=_TRIED) for q in starts]
    energies = [problem.model(0, q).value + (0.0 if met else _UNMET) for q, met in ends]
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
