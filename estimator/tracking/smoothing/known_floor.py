"""Whether a body is about where its floor is said to be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.floor import OFF, KnownFloor
from estimator.energy.gravity_prior import world_up
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body, batches

SUNK = 0.005
"""[m] Standard deviation of a part below the floor."""
_FARTHEST = 0.5  # m: of the lowest part from the floor, in the middle of the frames


def floor_of(body: Body, cameras: Sequence[Camera], known: KnownFloor) -> FloorDistances | None:
    """Distances to a floor of known height; None where there is none."""
    return None if known is None or known == OFF else FloorDistances(body, world_up(cameras), known)


def height_above(floor: FloorDistances, body: Body, q: np.ndarray) -> float:
    """How high the lowest part of a body is above a floor [m], the median of poses q (T, nq) without those that are
    NaN; NaN where none is left, or the body has no flesh."""
    posed = q[np.isfinite(q).all(axis=1)]
    lowest = np.concatenate([floor.lowest(body.placed(some)) for some in batches(posed)])
    return float(np.median(lowest)) if len(lowest) and np.isfinite(lowest).all() else np.nan


def is_believed(height: float) -> bool:
    """Whether the floor may be where it is said to be, by `height_above`: a body that is far from it has another."""
    return not abs(height) > _FARTHEST


def believed_floor(body: Body, cameras: Sequence[Camera], known: KnownFloor, q: np.ndarray) -> KnownFloor:
    """What is known of the floor, None where poses q (T, nq) are far from it."""
    floor = floor_of(body, cameras, known)
    return known if floor is None or is_believed(height_above(floor, body, q)) else None
