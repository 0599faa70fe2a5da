"""The points of a body's feet, by which it stands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.data.floor import KnownFloor
from estimator.inference.foot_contact import FootContact, foot_contact
from estimator.inference.ground import Ground
from humanoid.kinematics.body import Body
from humanoid.shape.soles import heights_above_soles
from humanoid.subject.landmarks import foot_landmarks, foot_parts
from humanoid.support.per_object import per_object


class FootPoints(NamedTuple):
    """Heels and toes.

    names (P): of the landmarks, the left foot's first. landmark (P,): their numbers among the body's. kind (P,): alike
    for the same part of both feet. above (K,) [m]: of each kind above the sole, where a foot is level.
    """

    names: tuple[str, ...]
    landmark: np.ndarray
    kind: np.ndarray
    above: np.ndarray

    @staticmethod
    @per_object
    def of(body: Body) -> FootPoints | None:
        """None of a body without heels and toes as landmarks."""
        names = foot_landmarks(body.landmark_names)
        if not names:
            return None
        landmark, kind = np.array([body.landmark_names.index(name) for name in names]), foot_parts(names)
        heights, above = heights_above_soles(body, landmark.tolist()), np.zeros(int(kind.max()) + 1)
        for k in np.unique(kind):
            above[k] = heights[kind == k].mean()
        return FootPoints(names, landmark, kind, above)

    def contact(
        self,
        points: np.ndarray,
        time: np.ndarray,
        up: np.ndarray,
        floor: KnownFloor | Ground,
        seen: np.ndarray | None = None,
    ) -> FootContact:
        """`foot_contact` of these points (T, P, 3)."""
        return foot_contact(points, time, self.kind, up, above=self.above, floor=floor, seen=seen)
