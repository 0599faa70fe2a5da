"""Patches of several views around places in the world, as large in metres wherever the place is; and places along the
rays of one view's foreground that are foreground in every view.
"""

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


_PERSON = 0.5  # share of a pixel


def ray_places(views: Sequence[PatchView], box: np.ndarray, spacing: float, leading: int | None = None) -> np.ndarray:
    """Places (N, 3) [m] about `spacing` [m] apart along the rays of the foreground pixels of one view, inside box
    (2, 3), that project to a foreground pixel in every view (Sigal et al., CVPR 2004, section 5).

    leading: the view whose rays they are, by default that with the fewest foreground pixels. A row or column of its
    pixels is left out where its neighbours' rays are nearer to each other than `spacing` at the middle of the box.
    """
    if leading is None:
        leading = int(np.argmin([view.foreground.sum() for view in views]))
    view = views[leading]
    depth = float(view.camera.R_camera_world[2] @ box.mean(axis=0) + view.camera.t_camera_world[2])
    step = max(1, int(spacing * view.camera.K[0, 0] / max(depth, spacing)))
    grid = view.foreground[step // 2 :: step, step // 2 :: step]
    rows, columns = np.nonzero(grid > _PERSON)
    pixels = step * np.stack([columns, rows], axis=1) + step // 2
    ways = view.camera.directions(pixels.astype(float)) @ view.camera.R_camera_world
    ways = ways[np.isfinite(ways).all(axis=1)]
    places = _along(view.camera.centre_world, ways / np.linalg.norm(ways, axis=1, keepdims=True), box, spacing)
    return places[seen_by_all(views, places)]


def seen_by_all(views: Sequence[PatchView], places: np.ndarray) -> np.ndarray:
    """Which places (N, 3) [m] project to a foreground pixel in every view, (N,) bool."""
    is_seen = np.ones(len(places), bool)
    for view in views:
        _seen(np.ascontiguousarray(places, dtype=float), view.camera.arrays, view.levels[0], is_seen)
    return is_seen


def _along(centre: np.ndarray, ways: np.ndarray, box: np.ndarray, spacing: float) -> np.ndarray:
    """Places every `spacing` [m] from centre (3,) along unit vectors ways (R, 3) within box (2, 3)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (box[:, None] - centre) / ways  # (2, R, 3)
    first = np.nanmax(np.minimum(*ends), axis=1, initial=0.0)
    last = np.nanmin(np.maximum(*ends), axis=1, initial=np.inf)
    first = np.ceil(first / spacing) * spacing
    count = np.maximum(np.floor((last - first) / spacing) + 1.0, 0.0).astype(int)
    ray = np.repeat(np.arange(len(ways)), count)
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.asarray(centre + (first[ray] + spacing * nth)[:, None] * ways[ray])


@jit
def _seen(places, camera, level, is_seen):  # type: ignore[no-untyped-def]
    """Clear is_seen (N,) of places (N, 3) that are not foreground in level (H, W, 2); camera: `Camera.arrays`."""
    intrinsics, lens, R, t = camera
    height, width = level.shape[0], level.shape[1]
    for n in range(places.shape[0]):
        if not is_seen[n]:
            continue
        u, v, ahead = project_point(places[n], intrinsics, lens, R, t)
        x, y = math.floor(u + 0.5), math.floor(v + 0.5)
        inside = ahead and x >= 0 and y >= 0 and x < width and y < height
        is_seen[n] = inside and level[y, x, 0] > 0.5
