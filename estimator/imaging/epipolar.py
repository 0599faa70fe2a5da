"""How well what one camera saw fits what another saw: rays of the same points have to meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.imaging.camera import Camera

FEWEST_SHARED = 4  # landmarks that two detections need in common to be compared
_MOST_PAIRS = 20_000  # compared at once


@dataclass(frozen=True)
class Rays:
    """Detections in one camera as rays.

    directions (N, L, 3): of each landmark in the camera, z = 1, NaN where missing. middle (N, 3): mean of the rays
    there are. size (N,): diagonal of their bounding box in the plane z = 1.
    """

    directions: np.ndarray
    middle: np.ndarray
    size: np.ndarray

    @staticmethod
    def of(camera: Camera, pixels: np.ndarray) -> Rays:
        """From pixels (N, L, 2), NaN where missing."""
        directions = camera.directions(pixels)
        seen = np.isfinite(directions[..., :1])
        count = seen.sum(axis=1)
        low = np.where(seen, directions, np.inf).min(axis=1, initial=np.inf)[:, :2]
        high = np.where(seen, directions, -np.inf).max(axis=1, initial=-np.inf)[:, :2]
        middle = np.where(seen, directions, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan)
        return Rays(directions, middle, np.hypot(*np.where(count > 0, high - low, 0.0).T))


def essential_matrix(a: Camera, b: Camera) -> np.ndarray:
    """E (3, 3) with y' E x = 0 for directions x in camera a and y in camera b of one point (Longuet-Higgins 1981)."""
    R_b_a = b.R_camera_world @ a.R_camera_world.T
    x, y, z = b.t_camera_world - R_b_a @ a.t_camera_world
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ R_b_a


def meeting_points(cameras: Sequence[Camera], directions: np.ndarray) -> np.ndarray:
    """World points (L, 3) [m] nearest to the rays (C, L, 3) of each landmark; NaN where fewer than two saw it."""
    world = np.stack([d @ camera.R_camera_world for camera, d in zip(cameras, directions, strict=True)])
    world /= np.linalg.norm(world, axis=-1, keepdims=True)
    seen = np.isfinite(world).all(axis=-1)
    across = np.where(seen[..., None, None], np.eye(3) - world[..., :, None] * world[..., None, :], 0.0)
    target = np.einsum("clij,cj->li", across, np.stack([camera.centre_world for camera in cameras]))
    matrix = across.sum(axis=0)
    usable = (seen.sum(axis=0) > 1) & (np.linalg.det(matrix) > 1e-9)
    points = np.full(target.shape, np.nan)
    points[usable] = np.linalg.solve(matrix[usable], target[usable][..., None])[..., 0]
    return points


def middle_distance(E: np.ndarray, a: Rays, b: Rays, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Sampson distances (P,) of the middles of detections i of a and j of b, in body sizes: a first, coarse look."""
    forth, back = a.middle @ E.T, b.middle @ E
    return _sampson(np.einsum("pk,pk->p", forth[i], b.middle[j]), forth[i], back[j], a.size[i], b.size[j])


def landmark_distance(E: np.ndarray, a: Rays, b: Rays, i: np.ndarray, j: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """How far detections i (P,) of a and j (P,) of b are from being one person (P,), in body sizes.

    The median over the landmarks both have of Sampson's distance (Hartley and Zisserman, Multiple View Geometry, 11.4):
    to first order the distance in the two images to the nearest pair of points whose rays meet, each image's error in
    units of the body's size there. The smaller of two readings: as detected, and with left and right exchanged in one
    of them, since detectors mistake them. NaN where fewer than 4 landmarks are shared.
    """
    parts = [slice(at, at + _MOST_PAIRS) for at in range(0, len(i), _MOST_PAIRS)]
    return np.concatenate([np.zeros(0), *(_smaller(E, a, b, i[part], j[part], mirror) for part in parts)])


def _smaller(E: np.ndarray, a: Rays, b: Rays, i: np.ndarray, j: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    x, sizes = a.directions[i], (a.size[i, None], b.size[j, None])
    forth = x @ E.T
    readings = []
    for y in (b.directions[j], b.directions[j][:, mirror]):
        error = np.einsum("plk,plk->pl", forth, y)
        readings.append(_median(_sampson(error, forth, y @ E, *sizes)))
    return np.fmin(*readings)


def _sampson(error: np.ndarray, forth: np.ndarray, back: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """|error| over its slope: forth, back (..., 3) are the epipolar lines in b and a, sizes a and b scale errors."""
    slope = np.square(b) * np.square(forth[..., :2]).sum(axis=-1) + np.square(a) * np.square(back[..., :2]).sum(axis=-1)
    return np.asarray(np.abs(error) / np.sqrt(np.maximum(slope, 1e-30)))


def _median(values: np.ndarray) -> np.ndarray:
    """Lower median of each row (P, L) without NaN; NaN where fewer than 4 are left."""
    count = np.isfinite(values).sum(axis=1)
    ordered = np.sort(values, axis=1)  # NaN goes to the end
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[:, None] // 2, axis=1)[:, 0]
    return np.where(count >= FEWEST_SHARED, middle, np.nan)
