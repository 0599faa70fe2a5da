"""Pictures freed of their lens."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera


def undistortion_maps(
    camera: Camera, K: np.ndarray, size: tuple[int, int], turn: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Maps for `cv2.remap` that show a camera's picture as a pinhole camera with K (3, 3) would see it.

    camera: of the picture that is given. size: width, height of the picture to be shown [px]. turn (3, 3): the shown
    camera's rotation from `camera`, none unless given.

    Raises InputError: a parallel camera, whose pictures no pinhole camera sees.
    """
    camera.needs_centre()
    turned = np.eye(3) if turn is None else turn
    of_lens = cv2.fisheye.initUndistortRectifyMap if camera.fisheye else cv2.initUndistortRectifyMap
    first, second = of_lens(camera.K, np.asarray(camera.distortion, dtype=np.float64), turned, K, size, cv2.CV_16SC2)
    return first, second
