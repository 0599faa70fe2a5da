"""Optical flow between successive frames, its outliers, and motion boundaries (CSS 3.1.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from estimator.data.media.threads import length, one_thread
from humanoid.support.settings import CheckedSettings, setting

_BLOCK = 8  # px across of the blocks that are compared to see where two images differ
_NOISE_RATIO, _LEAST_CHANGE = 1.5, 0.5  # a block has changed by more than so many times the usual and [grey values]
_MOVING_CAMERA = 4.0  # usual change of a block [grey values] from which all is taken to move
_MARGIN, _LEAST_BOX = 24, 96  # px around what changed, for the search's patches; and the smallest rectangle used
_SHARPNESS = 8.0  # S_p falls to 1 / e where one part in so many of the window is motion boundary


@dataclass(frozen=True)
class FlowSettings(CheckedSettings):
    """Settings of the computation of flow and its checks.

    finest_scale: where the search ends: 0 at full resolution, 1 at half, 2 at a quarter; each is some 4 times quicker.
        Half is accurate enough to start the refined points (`estimator.vision.cues.flow`); at a quarter
        limbs are lost.
    tolerance: disagreement of the flows there and back that makes a pixel half an outlier [px].
    relative_tolerance: the same as a share of the flow's length; both are added.
    boundary_reach: standard deviation of the smoothing of the motion boundaries [px].
    Raises InputError where a value is outside its range.
    """

    finest_scale: int = setting(1, at_least=0, at_most=2)
    tolerance: float = setting(0.7, above=0, tiny=True)
    relative_tolerance: float = setting(0.1, above=0, tiny=True)
    boundary_reach: float = setting(4.0, above=0)


@dataclass(frozen=True)
class FlowField:
    """Motion from the previous frame to this one.

    flow (H, W, 2) float32 [px]: what was at pixel (x, y) of the previous frame is at (x, y) + flow in this one.
    outlier (H, W) float32: 0 to 1, of the previous frame's pixels: there and back do not lead to the same place.
    boundary (H, W) float32: of this frame's pixels: the potential S_p of CSS 3.1.2, 0 on motion boundaries, 1 far
        from any. An edge's weight is 1 - k S_p.
    before, now (H, W) uint8: the two images (see `estimator.vision.cues.flow`).
    corner: x, y of the maps' first pixel in the image [px]. The maps are those of a rectangle outside of which the two
        images are equal but for noise: there nothing moves, and no motion boundary is near.
    image_size: width and height of the image [px], None for that of the maps.
    """

    flow: np.ndarray
    outlier: np.ndarray
    boundary: np.ndarray
    before: np.ndarray
    now: np.ndarray
    corner: tuple[int, int] = (0, 0)
    image_size: tuple[int, int] | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image [px]."""
        return self.image_size or (self.outlier.shape[1], self.outlier.shape[0])

    def whole_boundary(self) -> np.ndarray:
        """`boundary` of the whole image."""
        (width, height), (x, y) = self.size, self.corner
        if self.boundary.shape == (height, width):
            return self.boundary
        whole = np.ones((height, width), np.float32)
        whole[y : y + self.boundary.shape[0], x : x + self.boundary.shape[1]] = self.boundary
        return whole


def flow_field(previous_bgr: np.ndarray, bgr: np.ndarray, settings: FlowSettings) -> FlowField:
    """Flow between two images (H, W, 3) uint8: dense inverse search (Kroeger et al., ECCV 2016), both ways, where the
    images differ.

    It replaces the robust flow of Black and Anandan (1996) that CSS uses.
    """
    before, now = (cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (previous_bgr, bgr))
    with one_thread():
        x, y, width, height = changed_box(before, now)
        box = slice(y, y + height), slice(x, x + width)
        maps = _flow_maps(np.ascontiguousarray(before[box]), np.ascontiguousarray(now[box]), settings)
    return FlowField(*maps, (x, y), (now.shape[1], now.shape[0]))


def changed_box(before: np.ndarray, now: np.ndarray) -> tuple[int, int, int, int]:
    """Left, top, width and height [px] of a rectangle outside of which two images (H, W) uint8 differ by noise alone.

    With a static camera that is a rectangle about the people who move, a small part of the image. Blocks of pixels are
    compared by their mean difference; where it is large in most of them the camera moves, and the whole image is used.
    """
    height, width = now.shape
    blocks = max(1, width // _BLOCK), max(1, height // _BLOCK)
    difference = cv2.absdiff(before, now).astype(np.float32)
    block = cv2.resize(difference, blocks, interpolation=cv2.INTER_AREA)
    usual = float(np.median(block))
    if usual > _MOVING_CAMERA:
        return 0, 0, width, height
    changed = (block > _NOISE_RATIO * usual + _LEAST_CHANGE).astype(np.uint8)
    column, row, columns, rows = cv2.boundingRect(changed)
    left, right = _around(column, columns, width, blocks[0])
    top, bottom = _around(row, rows, height, blocks[1])
    return left, top, right - left, bottom - top


def _around(first: int, count: int, pixels: int, blocks: int) -> tuple[int, int]:
    """Where a range of so many blocks of a side of the image [px] begins and ends, with a margin [px]."""
    start, stop = first * pixels // blocks - _MARGIN, -(-(first + count) * pixels // blocks) + _MARGIN
    missing = -(-max(0, _LEAST_BOX - (stop - start)) // 2)
    return max(0, start - missing) // 2 * 2, min(pixels, stop + missing)  # even: maps are also checked at half the size


Maps = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _flow_maps(before: np.ndarray, now: np.ndarray, settings: FlowSettings) -> Maps:
    """The maps of a `FlowField`."""
    search: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    search.setFinestScale(settings.finest_scale)
    search.setVariationalRefinementIterations(0)  # it takes as long as the search and evens motion boundaries out
    forward, backward = search.calc(before, now, None), search.calc(now, before, None)
    # the flows are checked at half the resolution, where they were found
    height, width = before.shape
    half = (max(1, width // 2), max(1, height // 2))
    there, back = (cv2.resize(flow, half, interpolation=cv2.INTER_AREA) for flow in (forward, backward))
    outlier, uncovered = _disagreement(there, back, settings)[0], _disagreement(back, there, settings)
    potential = _potential(np.where(uncovered[1], uncovered[0], np.float32(0.0)), back, settings)
    outlier, potential = (cv2.resize(m, (width, height), interpolation=cv2.INTER_LINEAR) for m in (outlier, potential))
    return forward, outlier, potential, before, now


def _disagreement(there: np.ndarray, back: np.ndarray, settings: FlowSettings) -> tuple[np.ndarray, np.ndarray]:
    """Outlier map (h, w) of the flow `there`, and whether it stays in the image, (h, w) bool; at half resolution.

    The map is d^2 / (d^2 + s^2) of the distance d by which `back` misses.
    """
    height, width = there.shape[:2]
    dx, dy = cv2.split(there)
    x = np.float32(0.5) * dx + np.arange(width, dtype=np.float32)
    y = np.float32(0.5) * dy + np.arange(height, dtype=np.float32)[:, None]
    missed = length(*cv2.split(there + cv2.remap(back, x, y, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)))
    scale = np.float32(settings.tolerance) + np.float32(settings.relative_tolerance) * length(dx, dy)
    missed = missed * missed
    stays = (x >= 0.0) & (x <= width - 1) & (y >= 0.0) & (y <= height - 1)
    return missed / (missed + scale * scale), stays


def _potential(uncovered: np.ndarray, backward: np.ndarray, settings: FlowSettings) -> np.ndarray:
    """S_p (h, w) from this frame's outliers and the jumps of its flow, at half resolution."""
    jump = np.zeros_like(uncovered)
    for component in cv2.split(backward):
        for order in ((1, 0), (0, 1)):
            slope = cv2.Sobel(component, cv2.CV_32F, *order, scale=0.0625)  # [px / px of the full image]
            jump += slope * slope
    edge = np.maximum(uncovered, jump / (jump + np.float32(0.25 * settings.tolerance**2)))
    smooth = cv2.GaussianBlur(edge, _window(0.5 * settings.boundary_reach), 0.5 * settings.boundary_reach)
    return np.asarray(cv2.exp(np.float32(-_SHARPNESS) * smooth))


def _window(sigma: float) -> tuple[int, int]:
    """Pixels across of a Gaussian that is cut off at three standard deviations."""
    return (2 * int(np.ceil(3.0 * sigma)) + 1,) * 2
