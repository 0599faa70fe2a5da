"""A depth picture with the camera that it is of: places in space, and how well they are known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera


class DepthMap(NamedTuple):
    """depth (H, W) along the optical axis of `camera` [m], NaN where it is not known. noise: standard deviation of a
    depth of 1 m; it grows with the square of the depth."""

    camera: Camera
    depth: np.ndarray
    noise: float

    def points(self, rows: np.ndarray, columns: np.ndarray, directions: np.ndarray) -> DepthPoints:
        """The places that some pixels (P,) show, whose rays have these directions (P, 3), see `Camera.directions`."""
        depth = self.depth[rows, columns].astype(float)
        to_world = self.camera.R_camera_world
        length = np.linalg.norm(directions, axis=1)
        places = self.camera.centre_world + (directions * depth[:, None]) @ to_world
        rays = (directions / length[:, None]) @ to_world
        return DepthPoints(places, rays, self.noise * np.square(depth) * length, depth / self.camera.K[0, 0])


class DepthPoints(NamedTuple):
    """Points in the world (P, 3) [m] that a camera sees along unit rays (P, 3), with standard deviations along the ray
    and across it (P,) [m]."""

    places: np.ndarray
    rays: np.ndarray
    along: np.ndarray
    across: np.ndarray

    def __len__(self) -> int:
        return len(self.places)

    def some(self, chosen: np.ndarray) -> DepthPoints:
        """The points of an index or a mask."""
        return DepthPoints(*(array[chosen] for array in self))
