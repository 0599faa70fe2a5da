"""Places along the rays of one view's foreground pixels that are foreground in every view."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.projection import project_point
from estimator.vision.patches import PatchView
from humanoid.support.compiled import jit

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
