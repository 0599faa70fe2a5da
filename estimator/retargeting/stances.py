"""Feet of a body, and where they stand: one place for as long as they do, and swings that lead from one to the next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.numerics.stretches import stretches
from humanoid.kinematics.body import Body
from humanoid.shape.solids import heights_above_soles

_ASIDE = 0.05  # m: of the point that gives a foot's roll
_ANYWHERE = 6  # degrees of freedom
_UP = np.array([0.0, 0.0, 1.0])
SIDES = ("left", "right")


class Foot(NamedTuple):
    """A foot whose sole is level when all joints are at zero.

    side: "left" or "right"; number: 0 or 1 of them. joint: that it is fixed to. local (3, 3): points of the sole under
    heel and toe, and one beside the heel in the joint's frame [m]. level (3, 3): the same from the ankle, in the frame
    of the foot: x from heel to toe, z up [m]. rolls: whether its leg has the six degrees of freedom that put it
    anywhere; what has fewer is not held level from side to side.
    """

    side: str
    number: int
    joint: int
    local: np.ndarray
    level: np.ndarray
    rolls: bool


def feet_of(body: Body) -> tuple[Foot, ...]:
    """The feet whose ankle, heel and big toe are landmarks, heel and toe on one link; level with all joints at zero."""
    posed = body.at(pin.neutral(body.model))
    places = dict(zip(body.landmark_names, body.landmarks(posed), strict=True))
    feet = []
    for side in SIDES:
        names = [f"{side}_{part}" for part in ("heel", "big_toe", "ankle")]
        if not set(names) <= set(places):
            continue
        joint = int(body.landmark_joint[body.landmark_names.index(names[0])])
        if joint != body.landmark_joint[body.landmark_names.index(names[1])]:
            continue
        heel, toe, ankle = (places[name] for name in names)
        on_sole = heights_above_soles(body, [body.landmark_names.index(name) for name in names[:2]], _UP)
        heel, toe = heel - on_sole[0] * _UP, toe - on_sole[1] * _UP
        R_world_foot = foot_rotation(toe - heel)
        points = np.stack([heel, toe, heel + _ASIDE * R_world_foot[:, 1]])
        local = (points - posed.translations[joint]) @ posed.rotations[joint]
        feet.append(Foot(side, SIDES.index(side), joint, local, (points - ankle) @ R_world_foot, True))
    legs = _legs(body.model, [foot.joint for foot in feet])
    return tuple(foot._replace(rolls=leg >= _ANYWHERE) for foot, leg in zip(feet, legs, strict=True))


def _legs(model: pin.Model, feet: Sequence[int]) -> list[int]:
    """Degrees of freedom of the leg of each foot, by the feet's joints: of what moves it, and not all feet."""
    above = [set(model.supports[joint]) for joint in feet]
    shared = set.intersection(*above) if len(above) > 1 else {0, 1}
    return [sum(model.joints[joint].nv for joint in own - shared - {0}) for own in above]


def foot_rotation(forward: np.ndarray, pitch: float = 0.0) -> np.ndarray:
    """R_world_foot (3, 3) of a foot that is not rolled, whose toes point along the level part of forward (3,), and
    upwards by pitch [rad]."""
    yaw = np.arctan2(forward[1], forward[0])
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    x = np.cos(pitch) * ahead + np.sin(pitch) * _UP
    y = np.cross(_UP, ahead)
    return np.stack([x, y, np.cross(x, y)], axis=1)


HEEL, TOE = 0, 1
LIFT = 5e-4
"""[m] above the floor at which a sole stands: rounding must not put it below."""
SIDES_PARTS = {"left_heel": (0, HEEL), "left_big_toe": (0, TOE), "right_heel": (1, HEEL), "right_big_toe": (1, TOE)}


class FootStances(NamedTuple):
    """The stances of F feet in T frames. stands (T, F, 2) bool: heel and toe. place (T, F, 3, 3) [m]: of the feet's
    points (see `Foot`); those of what stands do not move while it does, and lie on the floor; swings meet them."""

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
