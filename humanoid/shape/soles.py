"""How high points of a body are above the sole under them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.shape.solids import farthest, solids_of


def heights_above_soles(body: Body, landmarks: Sequence[int]) -> np.ndarray:
    """How far landmarks (P,) are above the lowest point of what their own joint moves [m], (P,), where the foot is
    level: with all joints at zero, along the root's upright axis. 0 where that joint has no flesh, or the subject no
    such axis."""
    upright = body.subject.upright
    if upright is None:
        return np.zeros(len(landmarks))
    posed, solids = body.at(pin.neutral(body.model)), solids_of(body)
    up, heights = np.array(upright.axis), np.zeros(len(landmarks))
    for k, index in enumerate(landmarks):
        joint = body.landmark_joint[index]
        up_joint = posed.placements[joint, :9].reshape(3, 3) @ up  # stored column by column: the transpose
        depths = [farthest(solid, -up_joint) for solid in solids if solid.joint == joint]
        if depths:
            heights[k] = max(depths) + body.landmark_local[index] @ up_joint
    return heights
