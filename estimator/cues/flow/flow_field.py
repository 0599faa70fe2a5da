"""Optical flow between successive frames, its outliers, and motion boundaries (CSS 3.1.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from estimator.media.threads import length, one_thread
from humanoid.support.settings import check, setting

_SHARPNESS = 8.0  # S_p falls to 1 / e where one part in so many of the window is motion boundary


@dataclass(frozen=True)
class FlowSettings:
    """How flow is found and judged.

    finest_scale: where the search ends: 0 at full resolution, 1 at half, 2 at a quarter; each is some 4 times quicker.
        Half leads the points that are refined (`estimator.cues.flow.point_flow`) well; at a quarter limbs are lost.
    tolerance: disagreement of the flows there and back that makes a pixel half an outlier [px].
    relative_tolerance: the same as a share of the flow's length; both are added.
    boundary_reach: standard deviation of the smoothing of the motion boundaries [px].
    Raises InputError where a value cannot be.
    """

    finest_scale: int = setting(1, at_least=0, at_most=2)
    tolerance: float = setting(0.7, above=0, tiny=True)
    relative_tolerance: float = setting(0.1, above=0, tiny=True)
    boundary_reach: float = setting(4.0, above=0)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class FlowField:
    """Motion from the previous frame to this one.

    flow (H, W, 2) float32 [px]: what was at pixel (x, y) of the previous frame is at (x, y) + flow in this one.
    outlier (H, W) float32: 0 to 1, of the previous frame's pixels: there and back do not lead to the same place.
    boundary (H, W) float32: of this frame's pixels: the potential S_p of CSS 3.1.2, 0 on motion boundaries, 1 far
        from any. An edge's weight is 1 - k S_p.
    before, now (H, W) uint8: the two images (see `estimator.cues.flow.point_flow`).
    """

    flow: np.ndarray
    outlier: np.ndarray
    boundary: np.ndarray
    before: np.ndarray
    now: np.ndarray


def flow_field(previous_bgr: np.ndarray, bgr: np.ndarray, settings: FlowSettings) -> FlowField:
    """Flow between two images (H, W, 3) uint8: dense inverse search (Kroeger et al., ECCV 2016), both ways.

    It stands in for the robust flow of Black and Anandan (1996) that CSS uses.
    """
    before, now = (cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (previous_bgr, bgr))
    with one_thread():
        return _flow_field(before, now, settings)


def _flow_field(before: np.ndarray, now: np.ndarray, settings: FlowSettings) -> FlowField:
    search: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    search.setFinestScale(settings.finest_scale)
    search.setVariationalRefinementIterations(0)  # it takes as long as the search and evens motion boundaries out
    forward, backward = search.calc(before, now, None), search.calc(now, before, None)
    # the flows are judged at half the resolution, where they were found
    height, width = before.shape
    half = (max(1, width // 2), max(1, height // 2))
    there, back = (cv2.resize(flow, half, interpolation=cv2.INTER_AREA) for flow in (forward, backward))
    outlier, uncovered = _disagreement(there, back, settings)[0], _disagreement(back, there, settings)
    potential = _potential(np.where(uncovered[1], uncovered[0], np.float32(0.0)), back, settings)
    outlier, potential = (cv2.resize(m, (width, height), interpolation=cv2.INTER_LINEAR) for m in (outlier, potential))
    return FlowField(forward, outlier, potential, before, now)


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
