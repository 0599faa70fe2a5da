"""Where feet stand: one place for as long as they do, and swings that lead from one to the next."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.numerics.stretches import stretches
from estimator.retargeting.feet import Foot, foot_rotation

HEEL, TOE = 0, 1
LIFT = 5e-4
"""[m] above the floor at which a sole stands: rounding must not put it below."""
SIDES_PARTS = {"left_heel": (0, HEEL), "left_big_toe": (0, TOE), "right_heel": (1, HEEL), "right_big_toe": (1, TOE)}


class FootStances(NamedTuple):
    """Of F feet in T frames. stands (T, F, 2) bool: heel and toe. place (T, F, 3, 3) [m]: of the feet's points (see
    `Foot`); those of what stands do not move while it does, and lie on the floor; swings meet them."""

    stands: np.ndarray
    place: np.ndarray


def stances_at(feet: tuple[Foot, ...], place: np.ndarray, stands: np.ndarray, times: np.ndarray) -> FootStances:
    """The stances of feet that would otherwise be at place (T, F, 3, 3) [m], and stand when the source does, stands
    (T, F, 2) bool of heel and toe, at times (T,) [s]."""
    place = place.copy()
    for f, foot in enumerate(feet):
        _hold(foot, place[:, f], stands[:, f], times)
    place[..., 2] = np.maximum(place[..., 2], LIFT)
    return FootStances(stands, place)


def _hold(foot: Foot, place: np.ndarray, stands: np.ndarray, times: np.ndarray) -> None:
    """Move place (T, 3, 3) of one foot so that what stands does not move, in place."""
    free = place.copy()
    held = np.full(place.shape, np.nan)
    for first, after in stretches(np.asarray(stands.any(axis=1))):
        _hold_stance(foot, free, held, stands, first, after)
    some = np.isfinite(held).all(axis=(1, 2))
    if not some.any():
        return
    correction = np.zeros(place.shape)
    correction[some] = held[some] - free[some]
    known = np.flatnonzero(some)
    for point in range(3):
        for axis in range(3):
            correction[:, point, axis] = np.interp(times, times[known], correction[known, point, axis])
    place[:] = free + correction


def _hold_stance(foot: Foot, free: np.ndarray, held: np.ndarray, stands: np.ndarray, first: int, after: int) -> None:
    """Fill held[first:after] (., 3, 3) of a foot that stands on something in all of these frames.

    A foot that is flat has one place and one heading for as long as it is. Between two flat stretches it turns on what
    stands all the while, so that the later one is moved to where that is; where nothing does, it has made a step.
    """
    flat = stretches(np.asarray(stands[first:after].all(axis=1)))
    before: np.ndarray | None = None  # of the flat stretch before: its points
    last = 0
    where = np.full((after - first, 3, 3), np.nan)
    for begin, end in flat:
        level = _level(foot, free[first + begin : first + end])
        if before is not None:
            between = stands[first + last : first + begin]
            on = [point for point in (TOE, HEEL) if between[:, point].all()]
            if on:
                level = level + (before[on[0]] - level[on[0]])
        where[begin:end] = level
        before, last = level, end
    for point in (HEEL, TOE):
        for begin, end in stretches(stands[first:after, point]):
            _turn_on(point, free[first + begin : first + end], where[begin:end])
    held[first:after] = where


def _level(foot: Foot, some: np.ndarray) -> np.ndarray:
    """A level foot (3, 3) on the floor, in the middle of some places (N, 3, 3)."""
    heel, toe = some[:, HEEL].mean(axis=0), some[:, TOE].mean(axis=0)
    points = foot.level @ foot_rotation(toe - heel).T
    points = points - 0.5 * (points[HEEL] + points[TOE]) + 0.5 * (heel + toe)
    points[:, 2] += LIFT - points[[HEEL, TOE], 2].mean()
    return points


def _turn_on(point: int, free: np.ndarray, where: np.ndarray) -> None:
    """Fill where (N, 3, 3) of a stretch in which a point stands, in the frames in which it does so alone: turned as the
    foot is (N, 3, 3), that point where the flat frames of the stretch have it, or, without any, where it is on the
    average."""
    alone = np.isnan(where[:, point, 0])
    place = np.append(free[:, point, :2].mean(axis=0), LIFT) if alone.all() else where[~alone][0, point]
    where[alone] = free[alone] + (place - free[alone, point])[:, None]
