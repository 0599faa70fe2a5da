"""The static trial of a laboratory: somebody stands upright, so that the angles of the joints are about known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.observation import Observation
from humanoid.kinematics.body import ROOT_Q, ROOT_V, Body
from humanoid.subject.landmarks import without_side

ANKLES = "ankle_dorsiflexion"
ANKLE_STD = 0.1
"""[rad] Of ankles in upright standing, at least: the centre of mass is 5 cm ahead of them, so that people lean by 3
degrees (D. Winter, Human balance and posture control during standing and walking, Gait and Posture 3, 1995), and shoes
lift heels."""


class StaticTrial(NamedTuple):
    """Frames of somebody who stands upright.

    std (nv,) [m, rad]: standard deviation of each degree of freedom from `standing_pose`, infinite where nothing is
    known of it. bent: names of the joints that plainly are not as `standing_pose` has them.
    """

    observations: Sequence[Observation]
    std: np.ndarray
    bent: tuple[str, ...]


def standing_pose(body: Body, q: np.ndarray) -> np.ndarray:
    """Configuration (nq,) of a body that stands upright where q (nq,) has its root, all joints at zero, or at the limit
    that is nearest to zero.

    These are not the rest positions (`Body.neutral`), which are the middle of everyday poses: knees and elbows are bent
    there.
    """
    standing = body.clamp(pin.neutral(body.model))
    if body.has_free_root:
        standing[ROOT_Q] = q[ROOT_Q]
    return standing


def static_trial(
    body: Body, observations: Sequence[Observation], poses: Sequence[np.ndarray], std: float, bent_from: float
) -> StaticTrial:
    """What a static trial tells of a body's joints.

    poses (F) of (nq,): of the frames, found without knowing that somebody stands. std [rad]: of every joint,
    ankles at least `ANKLE_STD`. bent_from [rad]: joints that are farther from zero, in the median of the frames, are
    not taken as known, such as those of arms that are held out.
    """
    away = np.array([body.difference(standing_pose(body, q), q) for q in poses])
    ankles = np.array([without_side(name) == ANKLES for name in body.v_names])
    joints = np.where(ankles, max(std, ANKLE_STD), std)
    bent = np.abs(np.median(away, axis=0)) > bent_from
    if body.has_free_root:
        joints[ROOT_V], bent[ROOT_V] = np.inf, False
    joints[bent] = np.inf
    return StaticTrial(observations, joints, tuple(body.v_names[v] for v in np.flatnonzero(bent)))
