"""Valleys of Figure 7: the least cost at every place along a direction, followed without leaping between basins."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from benchmarks.papers_css.css_tables_problem import SEARCH, Problem
from estimator.energy.descent.seek import Seeker
from humanoid.kinematics.body import PosedBody

HELD = 1e4  # weight of holding a search at its place along a direction
OFF = 0.05  # rad or m: a search that ends farther from its place was not held there: limits end the valley
LEAP = 0.1  # rad or m, of any parameter from one place to the next
FINEST = 64  # a leap that stays one in steps so many times smaller is a discontinuity of the minimiser
MOST = 5  # basins fallen into, one after the other, to each side


class Place:
    """Holds the step from a mode at a place along one of its directions: a term of the cost."""

    name = "place"

    def __init__(self, problem: Problem, k: int, place: float) -> None:
        self._model, self._q, self._axis, self._place = (
            problem.body.model, problem.mode.q, problem.axes[:, k], place,
        )  # fmt: skip

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        off = self._off(posed)
        slope = pin.dDifference(self._model, self._q, posed.q, pin.ARG1).T @ self._axis
        gradient += HELD * off * slope
        hessian += HELD * np.outer(slope, slope)
        return 0.5 * HELD * off * off

    def value(self, posed: PosedBody) -> float:
        """See `estimator.energy.term.Term`."""
        return 0.5 * HELD * self._off(posed) * self._off(posed)

    def _off(self, posed: PosedBody) -> float:
        return float(self._axis @ pin.difference(self._model, self._q, posed.q)) - self._place


class Valley(NamedTuple):
    """One basin's minimiser as the place moves: t (T,) rising, cost (T,) and q (T, nq) there. folded: whether it ends
    before the first and before the last requested place because there is no longer a minimum, so that a search falls
    into another basin; otherwise limits end it or the range does. The cost is NaN where a valley before this has the
    same minimiser."""

    t: np.ndarray
    cost: np.ndarray
    q: np.ndarray
    folded: tuple[bool, bool]


class _Course(NamedTuple):
    """A valley followed to one side: places, costs, configurations; where it folds, the place behind the fold and the
    configuration that a search from the fold falls to."""

    t: list[float]
    cost: list[float]
    q: list[np.ndarray]
    fallen: tuple[float, np.ndarray] | None


def valleys(problem: Problem, k: int, reach: float, points: int) -> list[Valley]:
    """The mode's valley along direction k within +-reach [rad, m], then those that searches fall into at its ends.

    points: over the whole range, at least; steps are halved where a parameter leaps.
    """
    step = 2.0 * reach / max(1, points - 1)
    right, left = (_followed(problem, k, (0.0, problem.mode.q), side * reach, step) for side in (1.0, -1.0))
    result = [_joined(left, right)]
    for side, course in ((1.0, right), (-1.0, left)):
        for _ in range(MOST):
            if course.fallen is None:
                break
            seed = course.fallen
            course = _followed(problem, k, seed, side * reach, step)
            back = _followed(problem, k, seed, -side * reach, step)
            result.append(_unlike(problem, result, _joined(back, course) if side > 0.0 else _joined(course, back)))
    return result


def _unlike(problem: Problem, before: list[Valley], valley: Valley) -> Valley:
    """A valley without its common part with earlier ones."""
    cost = valley.cost.copy()
    for i, (t, q) in enumerate(zip(valley.t, valley.q, strict=True)):
        for other in before:
            nearest = int(np.abs(other.t - t).argmin())
            if float(np.abs(problem.body.difference(other.q[nearest], q)).max()) < LEAP:
                cost[i] = np.nan
    return valley._replace(cost=cost)


def _followed(problem: Problem, k: int, seed: tuple[float, np.ndarray], end: float, step: float) -> _Course:
    """From a place and its minimiser towards `end`, as far as the minimiser moves without a leap."""
    seeker, (t, q) = Seeker(problem.body, SEARCH), seed
    course = _Course([t], [problem.cost.value_at(q)], [q], None)
    side, size = float(np.sign(end - t)), step
    while side * (end - t) > 1e-9 * step:
        to = t + side * min(size, abs(end - t))
        trial = seeker.seek(problem.cost.plus([Place(problem, k, to)]), q).q
        if abs(float(problem.axes[:, k] @ problem.body.difference(problem.mode.q, trial)) - to) > OFF:
            return course
        if float(np.abs(problem.body.difference(q, trial)).max()) > LEAP:
            if size <= step / FINEST:
                return course._replace(fallen=(to, trial))
            size *= 0.5
            continue
        t, q, size = to, trial, min(step, 2.0 * size)
        course.t.append(t)
        course.cost.append(problem.cost.value_at(q))
        course.q.append(q)
    return course


def _joined(left: _Course, right: _Course) -> Valley:
    """Two courses from the same place to the two sides as one."""
    t = [*reversed(left.t), *right.t[1:]]
    cost = [*reversed(left.cost), *right.cost[1:]]
    q = [*reversed(left.q), *right.q[1:]]
    return Valley(np.array(t), np.array(cost), np.array(q), (left.fallen is not None, right.fallen is not None))
