"""Static parts of a clip: the camera, and places of the picture."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from estimator.data.media.threads import length

SIZE = 320  # longest side of the pictures motion is looked for in [px]
_REACH = 6.0  # standard deviation of the window over which evenly coloured places take their outlines' motion [px]
_GRAIN = 0.6  # squared slope of the sensor's noise [grey values per pixel, squared]
_EVEN = 0.02  # texture; where there is less, nothing is seen to move
_NOISE = 5.0  # grey values; less contrast may be noise
_CELLS = 8  # the picture is cut into this many rows and columns to see whether the camera moves


def small_size(shape: tuple[int, ...]) -> tuple[int, int]:
    """Width and height of a picture (H, W, ...) reduced to `SIZE`."""
    scale = min(1.0, SIZE / max(shape[:2]))
    return max(1, round(shape[1] * scale)), max(1, round(shape[0] * scale))


def camera_moves(pictures: list[np.ndarray]) -> bool:
    """Whether most textured places, over the whole picture, do not stay where they are."""
    grey = [cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in pictures]
    reference = grey[len(grey) // 2]
    corners: Any = cv2.goodFeaturesToTrack(reference, 600, 0.01, max(reference.shape) / 60)
    if corners is None:
        return False
    corners = _textured(reference, corners)
    height, width = reference.shape
    cell = (corners[:, 0] * (_CELLS / width, _CELLS / height)).astype(int) @ (1, _CELLS)
    occupied, count = np.unique(cell, return_counts=True)
    # a few textured places may all lie on the person; then nothing can be found out, nor need it be
    if len(occupied) < _CELLS**2 / 4:
        return False
    shares = []
    for picture in grey:
        there, status, _ = cv2.calcOpticalFlowPyrLK(reference, picture, corners, np.zeros_like(corners))
        stays = (status[:, 0] > 0) & (np.linalg.norm(there - corners, axis=-1)[:, 0] < 0.7)
        shares.append(np.mean(np.bincount(cell, stays, _CELLS**2)[occupied] >= 0.5 * count))
    return bool(np.quantile(shares, 0.2) < 0.5)


def _textured(grey: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The corners (N, 1, 2) that stand out of the sensor's noise: dark, even places have corners of noise."""
    values = grey.astype(np.float32)
    mean, square = (cv2.boxFilter(v, -1, (9, 9)) for v in (values, values * values))
    x, y = corners[:, 0].astype(int).T
    return np.asarray(corners[(square - mean * mean)[y, x] > _NOISE**2])


def motion(pictures: list[np.ndarray], limit: float) -> list[np.ndarray]:
    """For each picture, the confidence that its places move to the one before or after: 0 to 1, of `small_size`.

    Motion shows only where there is texture; evenly coloured places take the motion of the texture around them.
    """
    size = small_size(pictures[0].shape)
    small = [cv2.cvtColor(cv2.resize(p, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY) for p in pictures]
    fastest = [np.zeros(small[0].shape, np.float32) for _ in small]
    search: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    for i in range(len(small) - 1):
        for here, other in ((i, i + 1), (i + 1, i)):
            flow = search.calc(small[here], small[other], None)
            np.maximum(fastest[here], length(flow[..., 0], flow[..., 1]), out=fastest[here])
    return [_spread_out(speed > limit, picture) for speed, picture in zip(fastest, small, strict=True)]


def _spread_out(moves: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """Mean of `moves` in a Gaussian window, weighted by texture."""
    dx, dy = (cv2.Sobel(grey, cv2.CV_32F, *order, scale=0.125) for order in ((1, 0), (0, 1)))
    energy = np.maximum(dx * dx + dy * dy - np.float32(_GRAIN), np.float32(0.0))
    texture = energy / (energy + np.float32(4.0))  # half for a slope of 2 grey values a pixel
    moving, all_texture = (cv2.GaussianBlur(v, (0, 0), _REACH) for v in (texture * moves, texture))
    return np.asarray(moving / (all_texture + np.float32(_EVEN)))
