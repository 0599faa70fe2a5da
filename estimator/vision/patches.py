"""Patches of several views around places in the world, concatenated: as large in metres wherever the place is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.projection import project_point
from humanoid.support.compiled import jit

CHANNELS = 2
"""Number of channels of a patch: the person's mask, and the person's grey values."""

_LEVELS = 6  # of a pyramid, each half the size of the one before
_EVEN = 4.0  # grey values of contrast that count half: noise of an even cloth is not made into a pattern


@dataclass(frozen=True, eq=False)
class PatchView:
    """One camera's picture at one instant, at several sizes.

    camera: at the first size. levels: arrays (H, W, 2) float32, each half the size of the one before: the share of the
    person in each pixel, and the grey value times that share.
    """

    camera: Camera
    levels: tuple[np.ndarray, ...]

    @property
    def foreground(self) -> np.ndarray:
        """Where the person is, (H, W) float32."""
        return np.asarray(self.levels[0][..., 0])


def patch_view(camera: Camera, picture: np.ndarray, foreground: np.ndarray) -> PatchView:
    """The view of a picture (H, W, 3) uint8 BGR or (H, W) grey, and where the person is (H, W) bool.

    Raises InputError: a parallel camera, in which nothing is smaller the farther away.
    """
    camera.needs_centre()
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    share = foreground.astype(np.float32)
    level = np.stack([share, share * grey.astype(np.float32)], axis=-1)
    levels = [level]
    for _ in range(_LEVELS - 1):
        size = max(level.shape[1] // 2, 1), max(level.shape[0] // 2, 1)
        level = np.ascontiguousarray(cv2.resize(level, size, interpolation=cv2.INTER_AREA))
        levels.append(level)
    return PatchView(camera, tuple(levels))


def patches_at(views: Sequence[PatchView], places: np.ndarray, metres: float, side: int, contrast: float) -> np.ndarray:
    """Patches (N, D) float32 of all views around places (N, 3) [m], D = views x 2 x side x side.

    A patch is a square of `metres` in the plane of the picture at the place's depth, upright as the picture is, of side
    x side samples of about their own size: first the share of the person, then the grey values times that share, less
    their mean over the person, over their deviation there, times `contrast`. What is beyond the picture, and a place
    behind a camera, counts as without a person.
    """
    values = np.zeros((len(places), len(views), CHANNELS, side, side), np.float32)
    places = np.ascontiguousarray(places, dtype=float)
    for k, view in enumerate(views):
        _sample(values, k, places, view.camera.arrays, view.levels, metres, contrast)
    return values.reshape(len(places), len(views) * CHANNELS * side**2)


@jit
def _sample(values, k, places, camera, levels, metres, contrast):  # type: ignore[no-untyped-def]
    """Fill number k of the views of values (N, V, 2, S, S) from places (N, 3); camera: `Camera.arrays`; levels, each
    (H, W, 2): see `PatchView`."""
    intrinsics, lens, R, t = camera
    side = values.shape[3]
    for n in range(places.shape[0]):
        u, v, ahead = project_point(places[n], intrinsics, lens, R, t)
        if not ahead:
            continue
        depth = R[2, 0] * places[n, 0] + R[2, 1] * places[n, 1] + R[2, 2] * places[n, 2] + t[2]
        sx, sy = intrinsics[0] * metres / (depth * side), intrinsics[1] * metres / (depth * side)
        level = 0
        while level + 1 < len(levels) and math.sqrt(sx * sy) >= 1.5 * 2.0**level:
            level += 1
        picture = levels[level]
        height, width = picture.shape[0], picture.shape[1]
        fx, fy = width / levels[0].shape[1], height / levels[0].shape[0]
        total, share = 0.0, 0.0
        for i in range(side):
            y = (v + (i + 0.5 - 0.5 * side) * sy + 0.5) * fy - 0.5
            for j in range(side):
                x = (u + (j + 0.5 - 0.5 * side) * sx + 0.5) * fx - 0.5
                if not (x > -0.5 and y > -0.5 and x < width - 0.5 and y < height - 0.5):
                    continue
                x0, y0 = max(math.floor(x), 0), max(math.floor(y), 0)
                x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
                a, b = min(max(x - x0, 0.0), 1.0), min(max(y - y0, 0.0), 1.0)
                for c in range(2):
                    values[n, k, c, i, j] = (1.0 - b) * (
                        (1.0 - a) * picture[y0, x0, c] + a * picture[y0, x1, c]
                    ) + b * ((1.0 - a) * picture[y1, x0, c] + a * picture[y1, x1, c])
                share += values[n, k, 0, i, j]
                total += values[n, k, 1, i, j]
        _normalise(values[n, k], total, share, contrast)


@jit
def _normalise(patch, total, share, contrast):  # type: ignore[no-untyped-def]
    """Make the grey values of patch (2, S, S), which sum to total over a share of samples, independent of light."""
    side = patch.shape[1]
    if share < 1e-3:
        patch[1] = 0.0
        return
    mean, square = total / share, 0.0
    for i in range(side):
        for j in range(side):
            patch[1, i, j] -= mean * patch[0, i, j]
            square += patch[1, i, j] ** 2
    patch[1] *= contrast / math.sqrt(square / share + _EVEN**2)
