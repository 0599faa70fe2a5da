"""Whether left is left in a source: toes point to the front of who has the left hip on the left."""

from __future__ import annotations

import numpy as np

from estimator.retargeting.source import SourceMotion

_SIDES = ("left", "right")
_PARTS = ("hip", "knee", "ankle", "big_toe")
_BACK = -0.2
"""Cosine of foot and front, in the middle of all frames. Of 126 motions the least is 0.32."""
_SHORTEST = 1e-9  # m


def is_mirrored(source: SourceMotion) -> bool:
    """Whether the toes of both feet point backwards, as where left and right are exchanged, or axes are left-handed.

    The front is across the hips and the shank, which a foot is never behind, however far somebody bends.
    """
    if not {f"{side}_{part}" for side in _SIDES for part in _PARTS} <= set(source.names):
        return False
    across = source.landmark("left_hip") - source.landmark("right_hip")
    cosines = [_forward(source, side, across) for side in _SIDES]
    return all(len(cosine) and float(np.median(cosine)) < _BACK for cosine in cosines)


def _forward(source: SourceMotion, side: str, across: np.ndarray) -> np.ndarray:
    """Cosines of a foot with the front, in the frames in which it is known."""
    knee, ankle, toe = (source.landmark(f"{side}_{part}") for part in _PARTS[1:])
    front, foot = np.cross(across, knee - ankle), toe - ankle
    length = np.linalg.norm(front, axis=1) * np.linalg.norm(foot, axis=1)
    known = length > _SHORTEST
    return np.asarray((front * foot).sum(axis=1)[known] / length[known])
