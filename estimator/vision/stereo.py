"""Depth pictures, and depth from two calibrated cameras side by side: rectification and semi-global matching."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.threads import one_thread
from humanoid.support.errors import InputError
from humanoid.support.settings import CheckedSettings, setting

LEAST_BASELINE = 1e-3  # m
WIDEST_ANGLE = 40.0  # degrees between the optical axes, beyond which the two hardly see the same
MOST_ALONG = 0.7  # of the baseline along the optical axis; beyond that the pictures are not rectified
_SUBPIXEL = 16.0  # OpenCV's disparities are whole numbers of sixteenths
_BLOCKS = 16  # and their range a multiple of this


@dataclass(frozen=True)
class StereoSettings(CheckedSettings):
    """Settings of the matching of a pair's pictures.

    nearest [m]: nearer points are not found. block [px]: side of the compared windows, odd. uniqueness [%]: margin of
    the best disparity over the second. agreement [px]: largest difference of the disparities from left to right and
    back. speck [px]: smaller regions of one disparity are left out. noise [px]: standard deviation of a disparity.
    enlarged [px]: narrower pictures are enlarged by a whole number to about this width before they are matched, which
    takes time and a third off the noise; all pixels above are those of the enlarged pictures.
    """

    nearest: float = setting(0.8, above=0)
    block: int = setting(5, at_least=1)
    uniqueness: int = setting(10, at_least=0)
    agreement: int = setting(1, at_least=0)
    speck: int = setting(100, at_least=0)
    noise: float = setting(0.25, above=0)
    enlarged: int = setting(640, at_least=0)


class StereoPair:
    """Two cameras at one instant, the second to the right of the first.

    camera: the left one after rectification: turned, without distortion, of the same place and size. baseline [m].

    Parameters
    ----------
    left, right: calibrated in one world.

    Raises
    ------
    InputError: pictures of different sizes, cameras at one place, one behind or above the other, the right one on the
        left, or axes too far apart.
    """

    def __init__(self, left: Camera, right: Camera, settings: StereoSettings | None = None) -> None:
        self.settings = settings or StereoSettings()
        _refuse(left, right)
        R = right.R_camera_world @ left.R_camera_world.T
        t = (right.t_camera_world - R @ left.t_camera_world)[:, None]
        size = left.image_size
        # a fisheye is rectified as the pinhole camera of its K, which shows the middle of its picture
        bent = [np.zeros(5) if c.fisheye else c.distortion for c in (left, right)]
        R_left, R_right, P_left, P_right, *_ = cv2.stereoRectify(
            left.K, bent[0], right.K, bent[1], size, R, t, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0.0
        )
        if abs(P_right[1, 3]) > abs(P_right[0, 3]):
            raise _refused(left, right, "the cameras stand one above the other", "a pair side by side")
        if P_right[0, 3] > 0.0:
            raise _refused(left, right, f"{right.name} stands to the left", f"{right.name}={left.name}")
        self._scale = float(-P_right[0, 3])  # focal length times baseline: depth times disparity [px m]
        self.baseline = self._scale / float(P_right[0, 0])
        self.camera = Camera(
            left.name, size, P_left[:, :3], np.zeros(5), R_left @ left.R_camera_world, R_left @ left.t_camera_world
        )
        self._factor = max(1, round(self.settings.enlarged / size[0]))
        self._maps = [
            undistortion_maps(c, P[:, :3], size, turn)
            for c, turn, P in ((left, R_left, P_left), (right, R_right, P_right))
        ]
        self._matcher = self._made_matcher()

    @one_thread()
    def rectified(self, left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both pictures (H, W, 3) or (H, W) as cameras side by side with parallel axes would see them."""
        first, second = (
            np.asarray(cv2.remap(picture, *maps, cv2.INTER_LINEAR))
            for picture, maps in zip((left, right), self._maps, strict=True)
        )
        return first, second

    @one_thread()
    def depth(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Depth (H, W) float32 along the optical axis of `camera` [m] of two pictures as they were taken, (H, W, 3)
        uint8; NaN where nothing matches, or not from right to left too."""
        grey = [cv2.cvtColor(p, cv2.COLOR_BGR2GRAY) for p in self.rectified(left, right)]
        enlarged = [cv2.resize(g, None, fx=self._factor, fy=self._factor, interpolation=cv2.INTER_CUBIC) for g in grey]
        middle = slice(self._factor // 2, None, self._factor)
        disparity = self._disparities(*enlarged)[middle, middle] / np.float32(self._factor)
        return np.asarray(np.float32(self._scale) / disparity)

    def std(self, depth: np.ndarray) -> np.ndarray:
        """Standard deviations of depths [m], which grow with their square."""
        return np.asarray(np.square(depth) * self.settings.noise / (self._factor * self._scale))

    def _disparities(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Disparities (H, W) float32 of rectified grey pictures [px], NaN where nothing matches. OpenCV leaves out a
        strip at the left as wide as the largest disparity, within which nearly all is seen by both cameras: pictures
        get as wide a border, and only what would match the border itself is left out."""
        border = self._matcher.getNumDisparities()
        widened = [cv2.copyMakeBorder(p, 0, 0, border, 0, cv2.BORDER_REPLICATE) for p in (left, right)]
        disparity = self._matcher.compute(*widened)[:, border:].astype(np.float32) / np.float32(_SUBPIXEL)
        outside = disparity > np.arange(left.shape[1], dtype=np.float32)
        disparity[(disparity <= 0.0) | outside] = np.nan
        return disparity

    def _made_matcher(self) -> cv2.StereoSGBM:
        s, width = self.settings, self._factor * self.camera.image_size[0]
        largest = self._factor * self._scale / s.nearest
        blocks = int(np.clip(np.ceil(largest / _BLOCKS), 1, max(1, width // (2 * _BLOCKS))))
        area = s.block**2
        return cv2.StereoSGBM.create(
            minDisparity=0, numDisparities=_BLOCKS * blocks, blockSize=s.block, P1=8 * area, P2=32 * area,
            disp12MaxDiff=s.agreement, uniquenessRatio=s.uniqueness, speckleWindowSize=s.speck, speckleRange=1,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )  # fmt: skip


def _refuse(left: Camera, right: Camera) -> None:
    """Raise InputError for cameras that cannot see depth together."""
    if left.image_size != right.image_size:
        sizes = " and ".join(f"{w} x {h}" for w, h in (left.image_size, right.image_size))
        raise _refused(left, right, f"their pictures are {sizes} px", "a pair of one size")
    between = right.centre_world - left.centre_world
    baseline = float(np.linalg.norm(between))
    if baseline < LEAST_BASELINE:
        raise _refused(left, right, f"the cameras are {1e3 * baseline:.1f} mm apart", "a pair with a baseline")
    axes = left.R_camera_world[2], right.R_camera_world[2]
    angle = float(np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1.0, 1.0))))
    if angle > WIDEST_ANGLE:
        raise _refused(left, right, f"their axes are {angle:.0f} degrees apart", f"at most {WIDEST_ANGLE:.0f}")
    if abs(between @ axes[0]) > MOST_ALONG * baseline:
        raise _refused(left, right, "one camera stands behind the other", "a pair side by side")


def _refused(left: Camera, right: Camera, problem: str, remedy: str) -> InputError:
    return InputError(f"stereo pair {left.name}={right.name}", problem, remedy=remedy)


def undistortion_maps(
    camera: Camera, K: np.ndarray, size: tuple[int, int], turn: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Maps for `cv2.remap` that show a camera's picture as a pinhole camera with K (3, 3) would see it.

    camera: of the picture that is given. size: width, height of the picture to be shown [px]. turn (3, 3): the shown
    camera's rotation from `camera`, by default none.

    Raises InputError: a parallel camera, whose pictures no pinhole camera sees.
    """
    camera.needs_centre()
    turned = np.eye(3) if turn is None else turn
    of_lens = cv2.fisheye.initUndistortRectifyMap if camera.fisheye else cv2.initUndistortRectifyMap
    first, second = of_lens(camera.K, np.asarray(camera.distortion, dtype=np.float64), turned, K, size, cv2.CV_16SC2)
    return first, second


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
