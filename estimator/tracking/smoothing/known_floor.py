"""Whether a body is where its floor is given or found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.floor import OFF, KnownFloor
from estimator.energy.gravity_prior import world_up
from estimator.inference.belt import Belt
from estimator.inference.foot_points import FootPoints
from estimator.inference.ground import Ground
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body, batches

SUNK = 0.005
"""[m] Standard deviation of a part below the floor."""
_FARTHEST = 0.5  # m: of the lowest part from the floor, in the middle of the frames
_BURIED, _RARELY = 0.04, 0.1
"""[m] How deep a body may be below a floor that was found from its feet, and in what share of the frames deeper. Of 20
captured and made motions on level floors, by markers, three cameras and one, a tenth of the frames is at most 2.4 cm
deep; of people whose feet rest on a stool, a wall or in the air, 4.8 cm to 1.7 m (`python -m benchmarks floors`)."""


def floor_of(body: Body, cameras: Sequence[Camera], known: KnownFloor) -> FloorDistances | None:
    """Distances to a floor of known height; None where there is none."""
    return None if known is None or known == OFF else FloorDistances(body, world_up(cameras), known)


def height_above(floor: FloorDistances, body: Body, q: np.ndarray) -> float:
    """Height of the lowest part of a body above a floor [m], the median of poses q (T, nq) without those that are NaN;
    NaN where none is left, or the body has no flesh."""
    posed = q[np.isfinite(q).all(axis=1)]
    lowest = np.concatenate([floor.lowest(body.placed(some)) for some in batches(posed)])
    return float(np.median(lowest)) if len(lowest) and np.isfinite(lowest).all() else np.nan


def is_believed(height: float) -> bool:
    """Whether the floor may be where it was given, by `height_above`: a body that is far from it has another."""
    return not abs(height) > _FARTHEST


def believed_floor(body: Body, cameras: Sequence[Camera], known: KnownFloor, q: np.ndarray) -> KnownFloor:
    """The known floor, None where poses q (T, nq) are far from it."""
    floor = floor_of(body, cameras, known)
    return known if floor is None or is_believed(height_above(floor, body, q)) else None


class FeetOnFloor(NamedTuple):
    """standing (T, P): probability that each point of the feet stands. floor: what they stand on, None without one.
    raised: what they rest on while the body lies deep below it, which is not a floor; None where they do not. belt: of
    a treadmill, None without one."""

    standing: np.ndarray
    floor: Ground | None
    raised: Ground | None = None
    belt: Belt | None = None


def feet_on_floor(
    body: Body,
    feet: FootPoints,
    q: np.ndarray,
    points: np.ndarray,
    times: np.ndarray,
    up: np.ndarray,
    known: KnownFloor | Ground,
    seen: np.ndarray | None,
) -> FeetOnFloor:
    """Contact of a body's feet, as `FootPoints.contact` finds it; a floor that is found has to be below the body.

    q (T, nq): poses that were found without it; points (T, P, 3) [m]: of the feet there.
    """
    standing, floor, belt = feet.contact(points, times, up, known, seen)
    if known is not None or floor is None:
        return FeetOnFloor(standing, floor, belt=belt)
    lower = _supporting(body, floor, q)
    if lower is not None:
        return FeetOnFloor(standing, lower, belt=belt)
    return FeetOnFloor(feet.contact(points, times, up, OFF, seen).standing, None, floor, belt)


def _supporting(body: Body, ground: Ground, q: np.ndarray) -> Ground | None:
    """The floor, or None where the body lies deep below it in poses q (T, nq); lowered to where the body lies in the
    middle of the frames, where that is a little below: soles are less well known than the places of heels and toes."""
    floor = FloorDistances(body, ground.normal, ground.height)
    lowest = np.concatenate([floor.lowest(body.placed(some)) for some in batches(q)])
    lowest = lowest[np.isfinite(lowest)]
    if not len(lowest):
        return ground
    if np.quantile(lowest, _RARELY) < -_BURIED:
        return None
    sunk = max(0.0, -float(np.median(lowest)))
    return replace(ground, height=ground.height - sunk, above=ground.above + sunk)
