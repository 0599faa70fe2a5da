"""Points of the soles that may press on the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.inference.contacts import FootPoints
from humanoid.kinematics.body import Body
from humanoid.support.per_object import per_object

SIDES = ("left", "right")
_HEEL = 0.5  # width of a heel over that of the ball


class SolePoints(NamedTuple):
    """Points of both soles: joint (P,) that each is fixed to, local (P, 3) [m] in its frame, foot (P,): 0 of the left
    one, 1 of the right one, point (P,): which of `FootPoints` decides whether it stands."""

    joint: np.ndarray
    local: np.ndarray
    foot: np.ndarray
    point: np.ndarray

    @staticmethod
    @per_object
    def of(body: Body) -> SolePoints | None:
        """Both sides of each heel, and the toes; None for a body without heels and toes as landmarks on either side."""
        feet = FootPoints.of(body)
        if feet is None or not all(any(name.startswith(side) for name in feet.names) for side in SIDES):
            return None
        posed = body.at(pin.neutral(body.model))
        places = {name: body.landmarks(posed)[k] for name, k in zip(feet.names, feet.landmark, strict=True)}
        rows = []
        for k, name in enumerate(feet.names):
            foot, joint = SIDES.index(name.split("_")[0]), int(body.landmark_joint[feet.landmark[k]])
            for place in _beside(name, places):
                low = place - [0.0, 0.0, feet.above[feet.kind[k]]]
                rows.append((joint, posed.placements[joint], low, foot, k))
        local = [placed[:9].reshape(3, 3) @ (low - placed[9:]) for _, placed, low, _, _ in rows]
        joints, feet_of, points = (np.array([row[i] for row in rows]) for i in (0, 3, 4))
        return SolePoints(joints, np.array(local), feet_of, points)


def _beside(name: str, places: dict[str, np.ndarray]) -> list[np.ndarray]:
    """A toe itself; of a heel both its sides."""
    side = name.split("_")[0]
    inner, outer = places.get(f"{side}_big_toe"), places.get(f"{side}_small_toe")
    if not name.endswith("heel") or inner is None or outer is None:
        return [places[name]]
    along = 0.5 * (inner + outer) - places[name]
    across = outer - inner - ((outer - inner) @ along) / (along @ along) * along
    return [places[name] + share * _HEEL * across for share in (-0.5, 0.5)]
