"""The feet of a body: the points that say where each is and how it is turned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.shape.soles import heights_above_soles

_ASIDE = 0.05  # m: of the point that tells how a foot is rolled
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
