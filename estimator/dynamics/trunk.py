"""The trunk of a body and what it carries, which move along the spine where that bends as one joint cannot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from humanoid.kinematics.body import ROOT_JOINT, Body
from humanoid.support.per_object import per_object

_TOP = "neck"


class Trunk(NamedTuple):
    """joint: that carries the trunk. axis (3,): unit vector from it to the neck, in its frame. above (n,): the joints
    that move with it, its own too."""

    joint: int
    axis: np.ndarray
    above: np.ndarray

    @staticmethod
    @per_object
    def of(body: Body) -> Trunk | None:
        """None for a body with a fixed base, without a neck among its landmarks, or whose trunk is the root."""
        if not body.has_free_root or _TOP not in body.landmark_names:
            return None
        k = body.landmark_names.index(_TOP)
        joint, local = int(body.landmark_joint[k]), body.landmark_local[k]
        if joint == ROOT_JOINT:
            return None
        return Trunk(joint, local / np.linalg.norm(local), np.array(list(body.model.subtrees[joint])))
