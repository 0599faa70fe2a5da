"""The world of a rig that was found from a person: z up, in metres, the floor at 0 under the person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.people.up_direction import up_direction
from estimator.data.rigs.bundle import RigState
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body

_LOW = 10.0  # percentile of the ankles' heights that is that of feet on the floor
_LEVEL = np.radians(60.0)  # between the person's up and the cameras', at most
_SEEN = 50  # ankles


@dataclass(frozen=True)
class RigWorld:
    """R_world_rig (3, 3), t_world_rig (3,) [m]: x_world = R size x_rig + t, of the world from the first camera's frame.
    size: metres in a unit of that frame. up_from: who says which way is up, "person" or "cameras"; up_sure: whether the
    person's balance and the floor tell it to about two degrees."""

    R_world_rig: np.ndarray
    t_world_rig: np.ndarray
    size: float
    up_from: str
    up_sure: bool = False

    def camera(self, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_camera_world and t_camera_world of a camera R, t in the rig's frame."""
        R_camera_world = R @ self.R_world_rig.T
        return R_camera_world, self.size * t - R_camera_world @ self.t_world_rig

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the rig's frame in the world."""
        return self.size * points @ self.R_world_rig.T + self.t_world_rig


def rig_world(
    body: Body, names: Sequence[str], state: RigState, instants: np.ndarray, size: float
) -> RigWorld:  # fmt: skip
    """The world in which the person stands: up by balance and floor, or as the cameras are held; x is level along the
    first camera's axis; the origin is on the floor under the middle of the person's places."""
    level = -state.R[:, 1].mean(axis=0)
    level /= np.linalg.norm(level)
    told = up_direction(names, size * state.points, instants)
    by_person = told is not None and float(told.direction @ level) > np.cos(_LEVEL)
    up = told.direction if told is not None and by_person else level
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 0.1 else np.cross([1.0, 0.0, 0.0], up)
    R = np.stack([ahead, np.cross(up, ahead), up])
    places = size * state.points @ R.T
    middle = np.nanmedian(places.reshape(-1, 3), axis=0)
    middle[2] = _floor(body, names, places, size)
    sure = by_person and told is not None and told.sure
    return RigWorld(R, -middle, size, "person" if by_person else "cameras", sure)


def _floor(body: Body, names: Sequence[str], places: np.ndarray, size: float) -> float:
    """Height of the floor under places (T, J, 3) [m]: that of low ankles less an ankle's own; of the lowest place where
    there are none."""
    ankles = [i for i, name in enumerate(names) if name.endswith("_ankle")]
    heights = places[:, ankles, 2]
    heights = heights[np.isfinite(heights)]
    if len(heights) < _SEEN:
        return float(np.nanmin(places[..., 2]))
    lowest = FloorDistances(body, np.array([0.0, 0.0, 1.0]), 0.0).lowest(body.placed(body.neutral[None]))[0]
    own = body.landmarks(body.at(body.neutral))[[body.landmark_names.index(names[i]) for i in ankles], 2].mean()
    above = float(own - lowest) if np.isfinite(lowest) else 0.0
    return float(np.percentile(heights, _LOW)) - size * above
