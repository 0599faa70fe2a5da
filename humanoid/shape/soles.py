"""Heights of a body's points above the sole under them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.shape.solids import farthest, solids_of


def heights_above_soles(body: Body, landmarks: Sequence[int], up: np.ndarray | None = None) -> np.ndarray:
    """Heights (P,) [m] of landmarks (P,) above the lowest point of what their own joint moves, where the foot is level:
    with all joints at zero, along the root's upright axis, or another unit vector up (3,). 0 where that joint has no
    solids, or the upright axis is unknown."""
    upright, heights = body.subject.upright, np.zeros(len(landmarks))
    if up is None:
        if upright is None:
            return heights
        up = np.array(upright.axis)
    posed, solids = body.at(pin.neutral(body.model)), solids_of(body)
    for k, index in enumerate(landmarks):
        joint = body.landmark_joint[index]
        up_joint = posed.placements[joint, :9].reshape(3, 3) @ up  # stored column by column: the transpose
        depths = [farthest(solid, -up_joint) for solid in solids if solid.joint == joint]
        if depths:
            heights[k] = max(depths) + body.landmark_local[index] @ up_joint
    return heights
