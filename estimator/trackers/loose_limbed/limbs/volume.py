"""The volume in which limbs can be: what all cameras see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from humanoid.support.errors import InputError

_NEAREST = 0.3  # m from a camera
_RAYS = 24  # along each side of the first camera's picture
_DEPTHS = 96


def common_box(cameras: Sequence[Camera], farthest: float, margin: float) -> np.ndarray:
    """Lowest and highest corner (2, 3) [m] of the box around all places that every camera sees, nearer than `farthest`
    [m] to each, and `margin` [m] on every side.

    Raises
    ------
    InputError: there is no such place.
    """
    first = cameras[0]
    x, y = (np.linspace(0.0, side - 1.0, _RAYS) for side in first.image_size)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    ways = first.directions(pixels)
    ways = ways[np.isfinite(ways).all(axis=1)]
    depths = np.linspace(_NEAREST, farthest, _DEPTHS)
    points = (depths[:, None, None] * ways).reshape(-1, 3)
    points = (points - first.t_camera_world) @ first.R_camera_world
    for camera in cameras:
        seen = np.linalg.norm(points - camera.centre_world, axis=1) < farthest
        if camera is not first:
            at, size = camera.project(points), np.array(camera.image_size)
            seen &= ((at > -0.5) & (at < size - 0.5)).all(axis=1)  # NaN is not
        points = points[seen]
    if not len(points):
        named = ", ".join(camera.name for camera in cameras)
        remedy = "leave out those that look elsewhere, or check their calibration"
        raise InputError("cameras", f"{named} see no place in common", remedy=remedy)
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])
