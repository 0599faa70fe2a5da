"""Consistency of two cameras' detections: rays of the same points have to meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.cameras.camera import Camera

FEWEST_SHARED = 4  # landmarks that two detections need in common to be compared
_FEW = 6  # landmarks of a first look
_MOST_PAIRS = 50_000  # compared at once
MISSED = 0.02  # of the picture's longer side: a point this far from its detection is an outlier


@dataclass(frozen=True)
class Rays:
    """Detections in one camera as rays.

    directions (N, L, 3): of each landmark in the camera, z = 1, NaN where missing. size (N,): diagonal of their
    bounding box in the plane z = 1.
    """

    directions: np.ndarray
    size: np.ndarray

    @staticmethod
    def of(camera: Camera, pixels: np.ndarray) -> Rays:
        """Rays of pixels (N, L, 2), NaN where missing."""
        directions = camera.directions(pixels)
        seen = np.isfinite(directions[..., :1])
        count = seen.sum(axis=1)
        low = np.where(seen, directions, np.inf).min(axis=1, initial=np.inf)[:, :2]
        high = np.where(seen, directions, -np.inf).max(axis=1, initial=-np.inf)[:, :2]
        return Rays(directions, np.hypot(*np.where(count > 0, high - low, 0.0).T))


def essential_matrix(a: Camera, b: Camera) -> np.ndarray:
    """E (3, 3) with y' E x = 0 for directions x in camera a and y in camera b of one point (Longuet-Higgins 1981).

    Raises InputError: a parallel camera.
    """
    for camera in (a, b):
        camera.needs_centre()
    R_b_a = b.R_camera_world @ a.R_camera_world.T
    return essential_of(R_b_a, b.t_camera_world - R_b_a @ a.t_camera_world)


def essential_of(R_b_a: np.ndarray, t_b_a: np.ndarray) -> np.ndarray:
    """The essential matrix (3, 3) of camera b from camera a: x_b = R_b_a x_a + t_b_a."""
    x, y, z = t_b_a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ R_b_a


def sampson(E: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Sampson's distances (...) in the plane z = 1 of directions x in one camera and y in the other (..., 3): to first
    order, to the nearest pair whose rays meet (Hartley and Zisserman, Multiple View Geometry, 2nd edition, 11.4.3)."""
    line, back = x @ E.T, y @ E
    slope = np.sqrt((line[..., :2] ** 2).sum(axis=-1) + (back[..., :2] ** 2).sum(axis=-1))
    return np.asarray(np.abs((y * line).sum(axis=-1)) / np.maximum(slope, 1e-12))


def meeting_points(cameras: Sequence[Camera], directions: np.ndarray) -> np.ndarray:
    """World points (L, 3) [m] nearest to the rays (C, L, 3) of each landmark; NaN where fewer than two saw it."""
    world = np.stack([d @ camera.R_camera_world for camera, d in zip(cameras, directions, strict=True)])
    return nearest_points(np.stack([camera.centre_world for camera in cameras]), world)


def nearest_points(centres: np.ndarray, ways: np.ndarray, parallel: float = 1e-9) -> np.ndarray:
    """Points (L, 3) nearest to the rays from centres (C, 3) along ways (C, L, 3), NaN where missing; NaN where there
    are fewer than two, or they are parallel: the determinant of the equations is below `parallel`."""
    ways = ways / np.linalg.norm(ways, axis=-1, keepdims=True)
    seen = np.isfinite(ways).all(axis=-1)
    across = np.where(seen[..., None, None], np.eye(3) - ways[..., :, None] * ways[..., None, :], 0.0)
    target = np.einsum("clij,cj->li", across, centres)
    matrix = across.sum(axis=0)
    usable = (seen.sum(axis=0) > 1) & (np.linalg.det(matrix) > parallel)
    points = np.full(target.shape, np.nan)
    points[usable] = np.linalg.solve(matrix[usable], target[usable][..., None])[..., 0]
    return points


def seen_points(cameras: Sequence[Camera], pixels: np.ndarray) -> np.ndarray:
    """World points (L, 3) [m] of pixels (C, L, 2), NaN where missing: where the rays meet, NaN where they do not."""
    points = meeting_points(cameras, np.stack([c.directions(p) for c, p in zip(cameras, pixels, strict=True)]))
    for camera, seen in zip(cameras, pixels, strict=True):
        with np.errstate(invalid="ignore"):
            missed = np.linalg.norm(camera.project(points) - seen, axis=-1) > MISSED * max(camera.image_size)
        points[missed] = np.nan
    return points


class RayPairs:
    """Distances between detections of two cameras by their rays, in body sizes.

    The median over the landmarks both have of Sampson's distance (Hartley and Zisserman, Multiple View Geometry, 11.4):
    to first order the distance in the two images to the nearest pair of points whose rays meet, each image's error in
    units of the body's size there. The smaller of two readings: as detected, and with left and right exchanged in one
    of them, since detectors mistake them. NaN where fewer than 4 landmarks are shared.
    """

    def __init__(self, cameras: tuple[Camera, Camera], rays: tuple[Rays, Rays], mirror: np.ndarray) -> None:
        a, b = rays
        E = essential_matrix(*cameras)
        lines_b, lines_a = a.directions @ E.T, b.directions @ E
        self._line = lines_b[..., 0], lines_b[..., 1], lines_b[..., 2], np.square(lines_b[..., :2]).sum(axis=-1)
        there = b.directions[..., 0], b.directions[..., 1], np.square(lines_a[..., :2]).sum(axis=-1)
        self._readings = there, tuple(values[:, mirror] for values in there)
        self._size = np.square(a.size), np.square(b.size)

    def distances(self, i: np.ndarray, j: np.ndarray, enough: float) -> np.ndarray:
        """Distances of detections i (P,) of the first camera and j (P,) of the second; infinite where the distance of a
        few landmarks is already above `enough`."""
        parts = [slice(at, at + _MOST_PAIRS) for at in range(0, len(i), _MOST_PAIRS)]
        return np.concatenate([np.zeros(0), *(self._screened_distances(i[part], j[part], enough) for part in parts)])

    def _screened_distances(self, i: np.ndarray, j: np.ndarray, enough: float) -> np.ndarray:
        count = self._line[0].shape[1]
        few = np.unique(np.linspace(0, count - 1, _FEW).round().astype(int)) if count > _FEW else slice(None)
        near = ~(self._smaller(i, j, few, 1) > enough)
        distance = np.full(len(i), np.inf)
        distance[near] = self._smaller(i[near], j[near], slice(None), FEWEST_SHARED)
        return distance

    def _smaller(self, i: np.ndarray, j: np.ndarray, columns: np.ndarray | slice, fewest: int) -> np.ndarray:
        x, y, z, slope_b = (values[:, columns][i] for values in self._line)
        slope_b *= self._size[1][j, None]
        distances = []
        for reading in self._readings:
            u, v, slope_a = (values[:, columns][j] for values in reading)
            slope = slope_b + slope_a * self._size[0][i, None]
            distances.append(_median(np.abs(x * u + y * v + z) / np.sqrt(np.maximum(slope, 1e-30)), fewest))
        return np.fmin(*distances)


def _median(values: np.ndarray, fewest: int) -> np.ndarray:
    """Lower median of each row (P, L) without NaN; NaN where fewer are left."""
    count = np.isfinite(values).sum(axis=1)
    ordered = np.sort(values, axis=1)  # NaN goes to the end
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[:, None] // 2, axis=1)[:, 0]
    return np.where(count >= fewest, middle, np.nan)
