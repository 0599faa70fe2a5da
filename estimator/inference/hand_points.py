"""Hands that stand on the floor, as in a cartwheel, a push-up or a crawl."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.inference.foot_contact import standing_probability
from estimator.inference.ground import Ground
from humanoid.kinematics.body import Body

_WRISTS = ("left_wrist", "right_wrist")
_ABOVE = 0.05  # m: of a wrist above the floor that its palm is on
_NEAR = 0.12  # m: points higher above their standing place are not on the floor, however still they are


class HandPoints(NamedTuple):
    """Wrists. names (H): of the landmarks, the left one's first. landmark (H,): their numbers among the body's."""

    names: tuple[str, ...]
    landmark: np.ndarray

    @staticmethod
    def of(body: Body) -> HandPoints | None:
        """None of a body without wrists as landmarks."""
        names = tuple(name for name in _WRISTS if name in body.landmark_names)
        return HandPoints(names, np.array([body.landmark_names.index(n) for n in names])) if names else None

    def standing(self, points: np.ndarray, time: np.ndarray, floor: Ground | None) -> np.ndarray:
        """Probability (T, H) that wrists at points (T, H, 3) [m] stand at times (T,) [s]; 0 without a floor."""
        if floor is None:
            return np.zeros(points.shape[:2])
        height = points @ floor.normal - floor.height - _ABOVE
        return np.where(height < _NEAR, standing_probability(points, time, height), 0.0)
