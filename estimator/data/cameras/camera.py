"""A calibrated camera: pinhole and lens, fisheye, or parallel projection."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.data.cameras.lens import distorted, lens_array, parallel_lens, undistorted
from humanoid.support.errors import InputError
from humanoid.support.summary import Facts, Summarised

UPS = ("x", "y", "z", "-x", "-y", "-z")
"""The axes of a world that may point up."""


@dataclass(frozen=True, repr=False)
class Camera(Summarised):
    """A calibrated camera, OpenCV conventions: x right, y down, z forward; pixel centres at integer coordinates.

    name: how clips and keypoints refer to it.
    image_size: width, height [px].
    K (3, 3): intrinsic matrix [px].
    distortion: OpenCV's coefficients of the lens, (5,) k1, k2, p1, p2, k3 (Brown), also (8,), (12,) or (14,); of a
        fisheye (4,). See `estimator.data.cameras.lens.lens_array`.
    R_camera_world (3, 3), t_camera_world (3,) [m]: x_camera = R_camera_world @ x_world + t_camera_world.
    fisheye: whether the lens is a fisheye (OpenCV's `cv2.fisheye`), seen up to 90 degrees from the optical axis.
    parallel: whether it is a parallel (orthographic) camera. The pixel is then K[:2, :2] @ (x, y) + K[:2, 2] of the
        place in the camera, K's scale is in px/m, and the depth z only gives the order of occlusion: it may be negative
        too. It has no lens and no centre: all its rays are along its axis, R_camera_world[2].
    focal_std: relative standard deviation of the focal length, zero where it is calibrated.
    deviations (7, K): the camera's errors for K independent standard normal causes, shared by the cameras of a rig: a
        turn [rad] (3) and a shift [m] (3) about its centre, in its own frame, and the logarithm of the focal length.
        None where unknown.
    """

    name: str
    image_size: tuple[int, int]
    K: np.ndarray
    distortion: np.ndarray
    R_camera_world: np.ndarray
    t_camera_world: np.ndarray
    fisheye: bool = False
    parallel: bool = False
    focal_std: float = 0.0
    deviations: np.ndarray | None = None

    def _called(self) -> str:
        return self.name

    def _facts(self) -> Facts:
        width, height = self.image_size
        x, y, z = self.origin_world
        if self.parallel:
            scale = f"{self.K[0, 0]:.1f} {self.K[1, 1]:.1f} px/m"
            return [
                ("image", f"{width}x{height} px"),
                ("parallel", scale),
                ("plane through", f"{x:.2f} {y:.2f} {z:.2f} m"),
            ]
        facts = [("image", f"{width}x{height} px"), ("focal length", f"{self.K[0, 0]:.1f} {self.K[1, 1]:.1f} px")]
        lens = "fisheye" if self.fisheye else "distorted" if np.any(self.distortion) else "pinhole"
        return [*facts, ("lens", lens), ("centre", f"{x:.2f} {y:.2f} {z:.2f} m")]

    @property
    def centre_world(self) -> np.ndarray:
        """Optical centre in the world [m], (3,).

        Raises InputError: a parallel camera, which has none.
        """
        self.needs_centre()
        return self.origin_world

    @property
    def origin_world(self) -> np.ndarray:
        """Origin of the camera's frame in the world [m], (3,): the optical centre, or of a parallel camera where its
        axis meets the plane of depth zero. For pictures of the camera; rays are those of `rays` and `sight_lines`."""
        return -self.R_camera_world.T @ self.t_camera_world

    @property
    def turn_std(self) -> float:
        """Standard deviation of its rotation, about all axes together [rad]; 0 where unknown."""
        return 0.0 if self.deviations is None else float(np.linalg.norm(self.deviations[:3]))

    @property
    def place_std(self) -> float:
        """Standard deviation of its centre, in all directions together [m]; 0 where unknown."""
        return 0.0 if self.deviations is None else float(np.linalg.norm(self.deviations[3:6]))

    def needs_centre(self) -> None:
        """Raise InputError if the camera is parallel, for methods that need rays through one point."""
        if self.parallel:
            remedy = "use a parallel camera alone, and only where no depth by perspective is needed"
            raise InputError(f"camera {self.name!r}", "is parallel: it has no centre of projection", remedy=remedy)

    @cached_property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Arguments of the kernels of `estimator.data.cameras.projection`: intrinsics (5,) fx, fy, cx, cy, skew [px],
        lens (5,), (1, 22) or (1, 1, 22), R (3, 3) and t (3,) camera from world."""
        K = self.K
        intrinsics = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1]])
        return intrinsics, self.lens, self.R_camera_world, self.t_camera_world

    @cached_property
    def lens(self) -> np.ndarray:
        """The lens as the functions of `estimator.data.cameras.lens` take it, (5,), (1, 22) or (1, 1, 22).

        Raises InputError: a number of coefficients that no model has; a parallel camera with distortion or a fisheye.
        """
        if self.parallel:
            if self.fisheye or np.any(self.distortion):
                problem = "is parallel and has a fisheye" if self.fisheye else "is parallel and has a distorting lens"
                remedy = "a parallel camera has neither: undistort its pictures first"
                raise InputError(f"camera {self.name!r}", problem, place="distortion", remedy=remedy)
            return parallel_lens()
        try:
            return lens_array(np.asarray(self.distortion), fisheye=self.fisheye)
        except ValueError as error:
            remedy = "a fisheye has 4" if self.fisheye else "4, 5, 8, 12 or 14 are taken, in OpenCV's order"
            raise InputError(f"camera {self.name!r}", f"has {error}", place="distortion", remedy=remedy) from None

    def project(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 3) [m] -> pixels (..., 2); NaN behind the camera, of which a parallel one sees all.

        For pictures and people. Energies project by `estimator.data.cameras.projection`, one point at a time: the same
        to rounding, but without an image for points nearer than `MIN_DEPTH`.
        """
        x = points @ self.R_camera_world.T + self.t_camera_world
        if self.parallel:
            _ = self.lens  # has none
            return x[..., :2] @ self.K[:2, :2].T + self.K[:2, 2]
        depth = np.where(x[..., 2] > 1e-6, x[..., 2], np.nan)
        u, v = x[..., 0] / depth, x[..., 1] / depth
        ud, vd = distorted(u, v, self.lens)
        return np.stack(
            [self.K[0, 0] * ud + self.K[0, 1] * vd + self.K[0, 2], self.K[1, 1] * vd + self.K[1, 2]], axis=-1
        )

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) -> directions of their rays in the camera (..., 3), undistorted, with z = 1; NaN stays NaN.

        The inverse of `project` up to depth. Where no direction leads to a pixel, as outside a fisheye's circle, NaN;
        with Brown's five coefficients OpenCV's five iterations are used unchanged.

        Raises InputError: a parallel camera, whose rays differ by where they begin; see `rays`.
        """
        self.needs_centre()
        flat = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1) @ np.linalg.inv(self.K).T
        seen = np.isfinite(flat).all(axis=-1)
        if seen.any() and (self.fisheye or np.any(self.distortion)):
            flat[seen, :2] = undistorted(flat[seen, :2], self.lens)
            seen &= np.isfinite(flat).all(axis=-1)
        flat[~seen] = np.nan
        return np.asarray(flat)

    def depths(self, points: np.ndarray) -> np.ndarray:
        """Depths (...) [m] of world points (..., 3): z in the camera. Of a parallel camera only differences count."""
        return points @ self.R_camera_world[2] + self.t_camera_world[2]

    def rays(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) -> the lines in the world that they show: points of them (..., 3) [m], unit directions away
        from the camera (..., 3); NaN where no line is shown.

        The points are the optical centre, or of a parallel camera the lines' points at depth zero.
        """
        if not self.parallel:
            ways = self.directions(pixels) @ self.R_camera_world
            ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
            return np.where(np.isfinite(ways), self.centre_world, np.nan), ways
        flat = np.zeros((*pixels.shape[:-1], 3))
        flat[..., :2] = np.linalg.solve(self.K[:2, :2], (pixels - self.K[:2, 2])[..., None])[..., 0]
        origins = (flat - self.t_camera_world) @ self.R_camera_world
        return origins, np.where(np.isfinite(origins), self.R_camera_world[2], np.nan)

    def sight_lines(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The `rays` through world points (N, 3) [m]: points of them (N, 3) [m] and unit directions (N, 3)."""
        if self.parallel:
            ways = np.repeat(self.R_camera_world[2:], len(points), axis=0)
            return points - self.depths(points)[:, None] * ways, ways
        eyes = np.repeat(self.centre_world[None], len(points), axis=0)
        ways = points - eyes
        return eyes, ways / np.sqrt(np.einsum("ij,ij->i", ways, ways))[:, None]


def guessed_camera(
    name: str, image_size: tuple[int, int], pixel_aspect: float = 1.0, focal: float = 1.2, focal_std: float = 0.0
) -> Camera:
    """A camera without a calibration, level, at the origin.

    pixel_aspect: width of a pixel over its height; the longer displayed side counts. focal: length over the longer
    side; 1.2 is a 45 degree lens. focal_std: see `Camera`.
    The world is then x forward (along the optical axis), y left, z up.
    """
    width, height = image_size
    f = focal * max(pixel_aspect * width, height)
    K = np.array([[f / pixel_aspect, 0.0, (width - 1) / 2.0], [0.0, f, (height - 1) / 2.0], [0.0, 0.0, 1.0]])
    R_camera_world = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    return Camera(name, image_size, K, np.zeros(5), R_camera_world, np.zeros(3), focal_std=focal_std)


def axis_of(up: str) -> np.ndarray:
    """One of `UPS` as a unit vector (3,)."""
    return np.asarray((-1.0 if up.startswith("-") else 1.0) * np.eye(3)["xyz".index(up[-1])])


def nearest_axis(direction: np.ndarray) -> str:
    """The one of `UPS` that is nearest to a direction (3,)."""
    return max(UPS, key=lambda up: float(axis_of(up) @ direction))


def world_with_up(up: np.ndarray) -> np.ndarray:
    """R_upright_world (3, 3): the least turn from a world in which a unit vector up (3,) points up to one whose z does.

    From y up it is the turn that OpenSim's files are read by: x stays, z becomes -y.
    """
    x, y, z = up
    if z < -1.0 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    turn = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])  # of the axis up x z, Rodrigues' formula
    return np.asarray(np.eye(3) + turn + turn @ turn / (1.0 + z))


def in_world(camera: Camera, R_new_world: np.ndarray) -> Camera:
    """The camera where its world is turned."""
    return replace(camera, R_camera_world=camera.R_camera_world @ R_new_world.T)


def camera_before(camera: Camera, points: np.ndarray, pixels: np.ndarray) -> Camera:
    """A pinhole camera moved level before a subject that faces x, with z up, as all built-in ones at rest.

    points (K, 3): in the world [m]. pixels (K, 2): where they are seen. The camera looks against x from so far that the
    points are as large in the image as they are seen, their middle where it is seen; exact where all have one x.
    """
    R_camera_world = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    middle, seen_middle = points.mean(axis=0), pixels.mean(axis=0)
    focal = np.array([camera.K[0, 0], camera.K[1, 1]])
    size = np.linalg.norm((points - middle) @ R_camera_world[:2].T)
    depth = size / np.linalg.norm((pixels - seen_middle) / focal)
    ray = np.append((seen_middle - camera.K[:2, 2]) / focal, 1.0)
    return replace(camera, R_camera_world=R_camera_world, t_camera_world=depth * ray - R_camera_world @ middle)


def parallel_camera(
    name: str,
    image_size: tuple[int, int],
    scale: float,
    middle: np.ndarray,
    *,
    azimuth: float = 0.0,
    away: float = 10.0,
) -> Camera:
    """A level parallel camera facing a subject that faces x, with z up, as all built-in ones at rest.

    scale [px/m]. middle (3,) [m]: the place in the world that the picture's middle shows. azimuth [rad]: where the
    camera stands, seen from above: 0 in front of the subject, positive to the subject's left. away [m]: the depth of
    the middle, which changes no pixel.
    """
    width, height = image_size
    K = np.array([[scale, 0.0, (width - 1) / 2.0], [0.0, scale, (height - 1) / 2.0], [0.0, 0.0, 1.0]])
    c, s = np.cos(azimuth), np.sin(azimuth)
    R_camera_world = np.array([[-s, c, 0.0], [0.0, 0.0, -1.0], [-c, -s, 0.0]])
    t_camera_world = np.array([0.0, 0.0, away]) - R_camera_world @ middle
    return Camera(name, image_size, K, np.zeros(5), R_camera_world, t_camera_world, parallel=True)
