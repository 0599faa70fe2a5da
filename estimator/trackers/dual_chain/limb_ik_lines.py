"""Lines of sight in the frame of a limb: where on them its end can be, and how an image is stretched along them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.projection import MIN_DEPTH, project_with_jacobian
from estimator.numerics.linear import eliminate
from estimator.trackers.dual_chain.limb_ik_kernels import log_size
from humanoid.kinematics.body import PlacedBodies
from humanoid.support.compiled import jit

_NEVER = 1e9  # m: a depth that nothing has
_SAME_PLACE = 1e-9  # m
_SAME_PIXEL = 1e-8  # px
_SAME_WAY = 1e-6
_AIMS = 5  # Newton's steps from where OpenCV leaves a pixel's direction


class Spans(NamedTuple):
    """Two pieces of each of N lines, of which the second begins where the first ends or later: their beginnings and
    lengths, (N, 2) [m] each along the line."""

    begin: np.ndarray
    length: np.ndarray

    @property
    def whole(self) -> np.ndarray:
        """Lengths (N,) [m] of both; 0 of lines out of reach."""
        return np.asarray(self.length[:, 0] + self.length[:, 1])

    def at(self, level: np.ndarray) -> np.ndarray:
        """Depths (N,) [m] at shares `level` (N,) of both pieces."""
        on = level * self.whole
        second = on > self.length[:, 0]
        return np.where(second, self.begin[:, 1] + on - self.length[:, 0], self.begin[:, 0] + on)

    def have(self, depth: np.ndarray) -> np.ndarray:
        """Whether depths (N,) [m] are on a piece, (N,) bool."""
        past = depth[:, None] - self.begin
        return np.asarray(((past > -_SAME_PLACE) & (past < self.length + _SAME_PLACE)).any(axis=1))


class RayBundle(NamedTuple):
    """N lines in the frame of a limb's parent: points of them (N, 3) [m], unit directions (N, 3), and the least depth
    (N,) [m] that the camera sees anything at. NaN where there is no line."""

    origins: np.ndarray
    ways: np.ndarray
    least: np.ndarray

    def spans(self, root: np.ndarray, near: float, far: float) -> Spans:
        """The parts of lines between `near` and `far` [m] from the root (3,)."""
        off = root - self.origins
        along = np.einsum("ni,ni->n", off, self.ways)
        square = np.einsum("ni,ni->n", off, off) - along**2
        outer = np.sqrt(np.maximum(far**2 - square, 0.0))
        inner = np.sqrt(np.maximum(near**2 - square, 0.0))
        begin = np.maximum(np.stack([along - outer, along + inner], axis=1), self.least[:, None])
        end = np.maximum(np.stack([along - inner, along + outer], axis=1), self.least[:, None])
        return Spans(begin, np.nan_to_num(end - begin))


def lines_in(camera: Camera, origins: np.ndarray, ways: np.ndarray, joint: int, placed: PlacedBodies) -> RayBundle:
    """Lines of sight in the world, origins and unit directions (N, 3), in the frame of a joint in N configurations."""
    if camera.parallel:
        least = np.full(len(ways), -np.inf)
    else:
        straight = ways @ camera.R_camera_world[2]
        seen = straight > MIN_DEPTH / _NEVER
        least = np.where(seen, (1.0 + 1e-9) * MIN_DEPTH / np.where(seen, straight, 1.0), _NEVER)
    M = placed.placements[:, joint]
    R = M[:, :9].reshape(-1, 3, 3)  # row k is column k of the rotation
    return RayBundle(np.einsum("nki,ni->nk", R, origins - M[:, 9:]), np.einsum("nki,ni->nk", R, ways), least)


def in_world(points: np.ndarray, joint: int, placed: PlacedBodies) -> np.ndarray:
    """Points (N, 3) [m], each in the frame of the joint in its configuration, in the world."""
    M = placed.placements[:, joint]
    return np.asarray(np.einsum("nki,nk->ni", M[:, :9].reshape(-1, 3, 3), points) + M[:, 9:])


def aimed(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`Camera.rays` of pixels (N, 2), which through a lens too lead to the pixel to rounding; NaN where none does."""
    origins, ways = camera.rays(pixels)
    if np.any(camera.distortion):
        _aim_each(origins, ways, np.ascontiguousarray(pixels), *camera.arrays)
    return origins, ways


def aim_back(camera: Camera, pixels: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Whether `aimed` leads from pixels (N, 2) along `ways` (N, 3), (N,) bool: not where a lens folds the image."""
    if not np.any(camera.distortion):
        return np.isfinite(pixels).all(axis=1)
    return np.asarray(np.abs(aimed(camera, pixels)[1] - ways).max(axis=1) < _SAME_WAY)


def log_line_volumes(camera: Camera, points: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Logarithms (N,) of |d(pixel, depth) / d(point)| [px^2 / m^2] at points (N, 3) [m] on lines of sight along ways
    (N, 3), in the world; -inf where the camera does not see."""
    volumes = np.empty(len(points))
    _volume_each(np.ascontiguousarray(points), np.ascontiguousarray(ways), *camera.arrays, volumes)
    return volumes


@jit
def _volume_each(points, ways, intrinsics, lens, R, t, volumes):  # type: ignore[no-untyped-def]
    """Fill volumes (N,) at points (N, 3), their lines' directions ways (N, 3).

    The camera: intrinsics (5,), lens (5,), (1, 22) or (1, 1, 22), R (3, 3), t (3,).
    """
    J, rest = np.empty((3, 3)), np.zeros(3)
    for n in range(points.shape[0]):
        _, _, seen = project_with_jacobian(points[n], intrinsics, lens, R, t, J)
        J[2] = ways[n]
        volumes[n] = log_size(J, rest) if seen else -np.inf


@jit
def _aim_each(origins, ways, pixels, intrinsics, lens, R, t):  # type: ignore[no-untyped-def]
    """Newton's steps of ways (N, 3), in place, until points (N, 3) one metre along them are seen at pixels (N, 2); NaN
    where that does not end.

    origins (N, 3). The camera: intrinsics (5,), lens (5,) or (1, 22), R (3, 3), t (3,).
    """
    J, rest = np.empty((3, 3)), np.empty(3)
    for n in range(ways.shape[0]):
        met = False
        for _ in range(_AIMS):
            u, v, seen = project_with_jacobian(origins[n] + ways[n], intrinsics, lens, R, t, J)
            rest[0], rest[1], rest[2] = pixels[n, 0] - u, pixels[n, 1] - v, 0.0
            met = seen and abs(rest[0]) + abs(rest[1]) < _SAME_PIXEL
            J[2] = ways[n]
            if met or not seen or not eliminate(J, rest):
                break
            ways[n] += rest
            ways[n] /= math.sqrt(ways[n, 0] ** 2 + ways[n, 1] ** 2 + ways[n, 2] ** 2)
        if not met:
            ways[n] = np.nan
