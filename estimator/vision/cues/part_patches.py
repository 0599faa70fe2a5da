"""Patches of one part of the body, followed from one picture to the next by that part's pixels alone.

A window about a point of a limb shows the background or the trunk, too, and these keep the window back: with all of
its pixels points of a moving arm are found up to several pixels behind it. Pixels of other parts do not count here.
Lucas and Kanade's iteration in the inverse compositional form (Baker and Matthews, IJCV 56, 2004), on pixels of a mask.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.vision.prediction import Prediction
from estimator.vision.visibility import part_at
from humanoid.shape.surface import Surface
from humanoid.support.compiled import jit

REACH = 5  # px from a patch's middle to its sides
SIDE = 2 * REACH + 1
RETURNED = 1.0  # px; what is followed back and misses its start by more has found something else
_ITERATIONS = 10
_STEP = 3.0  # px, the longest step
_ENOUGH = 0.02  # px; a step below ends the iteration
LEAST_TEXTURE = 400.0
"""Least eigenvalue of the structure tensor summed over a mask, (grey values)^2: with a noise of 3 grey values in either
picture a patch is found with a standard deviation of 0.2 px."""


def part_masks(prediction: Prediction, surface: Surface, nodes: np.ndarray) -> np.ndarray:
    """Pixels about each of nodes (N,) of a surface at which a prediction shows the node's own part, away from other
    parts and the background: (N, SIDE, SIDE) bool."""
    masks = np.zeros((len(nodes), SIDE, SIDE), bool)
    _fill_masks(prediction.owner, prediction.frame, surface.part[nodes], prediction.pixels[nodes], masks)
    return masks


def texture_of(grey: np.ndarray, pixels: np.ndarray, masks: np.ndarray) -> np.ndarray:
    """The smaller eigenvalue of the structure tensor of grey (H, W) uint8, summed over the pixels of masks
    (N, SIDE, SIDE) about pixels (N, 2), as (N,)."""
    texture = np.zeros(len(pixels))
    _fill_texture(grey, pixels, masks, texture)
    return texture


def follow_patches(
    before: np.ndarray, now: np.ndarray, points: np.ndarray, guess: np.ndarray, masks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) in one picture of points (N, 2) of the one before, and by how much each misses its start when it is
    followed back, (N,) [px]; infinite where it was lost or the mask has too little texture.

    before, now (H, W) uint8. guess (N, 2): where the search starts. masks: see `part_masks`.
    """
    places, missed = np.array(guess, dtype=float), np.full(len(points), np.inf)
    _follow(before, now, np.asarray(points, dtype=float), masks, places, missed)
    return places, missed


@jit
def _fill_masks(owner, frame, part, pixels, masks):  # type: ignore[no-untyped-def]
    """Fill masks (N, SIDE, SIDE) bool: see `part_masks`. owner (rows, columns), frame (3,): see `Prediction`.
    part (N,), pixels (N, 2)."""
    own = np.empty((SIDE + 2, SIDE + 2), np.bool_)
    for n in range(pixels.shape[0]):
        for j in range(SIDE + 2):
            for i in range(SIDE + 2):
                x, y = pixels[n, 0] + i - REACH - 1, pixels[n, 1] + j - REACH - 1
                own[j, i] = part_at(owner, frame, x, y) == part[n]
        for j in range(1, SIDE + 1):
            for i in range(1, SIDE + 1):
                beside = own[j - 1, i] and own[j + 1, i] and own[j, i - 1] and own[j, i + 1]
                masks[n, j - 1, i - 1] = own[j, i] and beside


@jit
def _sample(grey, x, y):  # type: ignore[no-untyped-def]
    """Bilinear value of grey (H, W) at x, y [px], that of the border outside."""
    height, width = grey.shape
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    i, j = min(int(x), width - 2), min(int(y), height - 2)
    a, b = x - i, y - j
    above = (1.0 - a) * grey[j, i] + a * grey[j, i + 1]
    return (1.0 - b) * above + b * ((1.0 - a) * grey[j + 1, i] + a * grey[j + 1, i + 1])


@jit
def _fill_patch(grey, x, y, patch):  # type: ignore[no-untyped-def]
    """Fill patch (SIDE + 2, SIDE + 2) of grey (H, W) about x, y [px]."""
    for j in range(SIDE + 2):
        for i in range(SIDE + 2):
            patch[j, i] = _sample(grey, x + i - REACH - 1, y + j - REACH - 1)


@jit
def _tensor(patch, mask, slopes):  # type: ignore[no-untyped-def]
    """The structure tensor's xx, xy, yy of patch (SIDE + 2, SIDE + 2) over mask (SIDE, SIDE); fills slopes
    (SIDE, SIDE, 2)."""
    xx = xy = yy = 0.0
    for j in range(SIDE):
        for i in range(SIDE):
            if mask[j, i]:
                dx = 0.5 * (patch[j + 1, i + 2] - patch[j + 1, i])
                dy = 0.5 * (patch[j + 2, i + 1] - patch[j, i + 1])
                slopes[j, i, 0], slopes[j, i, 1] = dx, dy
                xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    return xx, xy, yy


@jit
def _smaller(xx, xy, yy):  # type: ignore[no-untyped-def]
    """The smaller eigenvalue of a symmetric matrix."""
    return 0.5 * (xx + yy) - math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)


@jit
def _fill_texture(grey, pixels, masks, texture):  # type: ignore[no-untyped-def]
    """Fill texture (N,): see `texture_of`. grey (H, W), pixels (N, 2), masks (N, SIDE, SIDE)."""
    patch, slopes = np.empty((SIDE + 2, SIDE + 2)), np.empty((SIDE, SIDE, 2))
    for n in range(pixels.shape[0]):
        _fill_patch(grey, pixels[n, 0], pixels[n, 1], patch)
        xx, xy, yy = _tensor(patch, masks[n], slopes)
        texture[n] = _smaller(xx, xy, yy)


@jit
def _align(before, now, point, mask, place, patch, slopes):  # type: ignore[no-untyped-def]
    """Move place (2,) in `now` (H, W) to what was at point (2,) in `before` (H, W); whether mask (SIDE, SIDE) had
    texture to do so. patch (SIDE + 2, SIDE + 2), slopes (SIDE, SIDE, 2): scratch."""
    _fill_patch(before, point[0], point[1], patch)
    xx, xy, yy = _tensor(patch, mask, slopes)
    if _smaller(xx, xy, yy) < LEAST_TEXTURE:
        return False
    determinant = xx * yy - xy * xy
    for _ in range(_ITERATIONS):
        gx = gy = 0.0
        for j in range(SIDE):
            for i in range(SIDE):
                if mask[j, i]:
                    error = _sample(now, place[0] + i - REACH, place[1] + j - REACH) - patch[j + 1, i + 1]
                    gx, gy = gx + slopes[j, i, 0] * error, gy + slopes[j, i, 1] * error
        x, y = (yy * gx - xy * gy) / determinant, (xx * gy - xy * gx) / determinant
        length = math.sqrt(x * x + y * y)
        short = min(1.0, _STEP / max(length, 1e-12))
        place[0], place[1] = place[0] - short * x, place[1] - short * y
        if length < _ENOUGH:
            break
    return True


@jit
def _follow(before, now, points, masks, places, missed):  # type: ignore[no-untyped-def]
    """See `follow_patches`: places (N, 2) has the guesses and is overwritten, as is missed (N,). before, now (H, W),
    points (N, 2), masks (N, SIDE, SIDE)."""
    patch, slopes, back = np.empty((SIDE + 2, SIDE + 2)), np.empty((SIDE, SIDE, 2)), np.empty(2)
    for n in range(points.shape[0]):
        if not _align(before, now, points[n], masks[n], places[n], patch, slopes):
            continue
        back[0], back[1] = points[n, 0], points[n, 1]
        if _align(now, before, places[n], masks[n], back, patch, slopes):
            missed[n] = math.sqrt((back[0] - points[n, 0]) ** 2 + (back[1] - points[n, 1]) ** 2)
