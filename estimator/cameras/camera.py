"""A calibrated camera: pinhole and lens, or fisheye."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimator.cameras.lens import distorted, lens_array, undistorted
from humanoid.support.errors import InputError
from humanoid.support.summary import Facts, Summarised


@dataclass(frozen=True, repr=False)
class Camera(Summarised):
    """A calibrated camera, OpenCV conventions: x right, y down, z forward; pixel centres at integer coordinates.

    name: how clips and keypoints refer to it.
    image_size: width, height [px].
    K (3, 3): intrinsic matrix [px].
    distortion: OpenCV's coefficients of the lens, (5,) k1, k2, p1, p2, k3 (Brown), also (8,), (12,) or (14,); of a
        fisheye (4,). See `estimator.cameras.lens.lens_array`.
    R_camera_world (3, 3), t_camera_world (3,) [m]: x_camera = R_camera_world @ x_world + t_camera_world.
    fisheye: whether the lens is a fisheye (OpenCV's `cv2.fisheye`), seen up to 90 degrees from the optical axis.
    """

    name: str
    image_size: tuple[int, int]
    K: np.ndarray
    distortion: np.ndarray
    R_camera_world: np.ndarray
    t_camera_world: np.ndarray
    fisheye: bool = False

    def _called(self) -> str:
        return self.name

    def _facts(self) -> Facts:
        width, height = self.image_size
        x, y, z = self.centre_world
        facts = [("image", f"{width}x{height} px"), ("focal length", f"{self.K[0, 0]:.1f} {self.K[1, 1]:.1f} px")]
        lens = "fisheye" if self.fisheye else "distorted" if np.any(self.distortion) else "pinhole"
        return [*facts, ("lens", lens), ("centre", f"{x:.2f} {y:.2f} {z:.2f} m")]

    @property
    def centre_world(self) -> np.ndarray:
        """Optical centre in the world [m], (3,)."""
        return -self.R_camera_world.T @ self.t_camera_world

    @cached_property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What the kernels of `estimator.cameras.projection` take: intrinsics (5,) fx, fy, cx, cy, skew [px],
        lens (5,) or (1, 22), R (3, 3) and t (3,) camera from world."""
        K = self.K
        intrinsics = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1]])
        return intrinsics, self.lens, self.R_camera_world, self.t_camera_world

    @cached_property
    def lens(self) -> np.ndarray:
        """The lens as the functions of `estimator.cameras.lens` take it, (5,) or (1, 22).

        Raises InputError: a number of coefficients that no model has.
        """
        try:
            return lens_array(np.asarray(self.distortion), fisheye=self.fisheye)
        except ValueError as error:
            remedy = "a fisheye has 4" if self.fisheye else "4, 5, 8, 12 or 14 are taken, in OpenCV's order"
            raise InputError(f"camera {self.name!r}", f"has {error}", place="distortion", remedy=remedy) from None

    def project(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 3) [m] -> pixels (..., 2); NaN behind the camera.

        For pictures and people. Energies project by `estimator.cameras.projection`, one point at a time: the same to
        rounding, but without an image for what is nearer than `MIN_DEPTH`.
        """
        x = points @ self.R_camera_world.T + self.t_camera_world
        depth = np.where(x[..., 2] > 1e-6, x[..., 2], np.nan)
        u, v = x[..., 0] / depth, x[..., 1] / depth
        ud, vd = distorted(u, v, self.lens)
        return np.stack(
            [self.K[0, 0] * ud + self.K[0, 1] * vd + self.K[0, 2], self.K[1, 1] * vd + self.K[1, 2]], axis=-1
        )

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) -> directions of their rays in the camera (..., 3), undistorted, with z = 1; NaN stays NaN.

        The inverse of `project` up to depth. Where no direction leads to a pixel, as outside a fisheye's circle, NaN;
        with Brown's five coefficients OpenCV's five iterations are taken as they are.
        """
        flat = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1) @ np.linalg.inv(self.K).T
        seen = np.isfinite(flat).all(axis=-1)
        if seen.any() and (self.fisheye or np.any(self.distortion)):
            flat[seen, :2] = undistorted(flat[seen, :2], self.lens)
            seen &= np.isfinite(flat).all(axis=-1)
        flat[~seen] = np.nan
        return np.asarray(flat)


def guessed_camera(name: str, image_size: tuple[int, int]) -> Camera:
    """A camera without a calibration: focal length 1.2 times the longer side (a 45 degree lens), level, at the origin.

    The world is then x forward (along the optical axis), y left, z up.
    """
    width, height = image_size
    focal = 1.2 * max(width, height)
    K = np.array([[focal, 0.0, (width - 1) / 2.0], [0.0, focal, (height - 1) / 2.0], [0.0, 0.0, 1.0]])
    R_camera_world = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    return Camera(name, image_size, K, np.zeros(5), R_camera_world, np.zeros(3))
