"""Edge direction histograms: what a picture of a person is looked up by in an index of examples."""

from __future__ import annotations

import cv2
import numpy as np

SIDE = 200  # px of the square picture that they are made of
DIRECTIONS = 4
WINDOWS = (8, 16, 32)  # px, each at steps of half its size
_FINE = 3.0  # px, standard deviation of the smoothing: edges of clothes are finer than those of limbs, and chance
LEAST_CONTRAST = 5.0  # grey values across an edge of the smoothed picture, over a pixel
_FINE_OUTLINE, _LEAST_OUTLINE = 1.0, 40.0  # the same for the picture of where the person is, 0 and 255
_SLOPE_OF_STEP = 4.0  # Sobel's answer to a step of one grey value beside it


def bin_count() -> int:
    """Bins of a histogram: 13,076."""
    return sum((SIDE // (size // 2)) ** 2 for size in WINDOWS) * DIRECTIONS


def edge_histogram(picture: np.ndarray, where: np.ndarray | None = None) -> np.ndarray:
    """Histogram of edge pixels by direction in each window, (bins,) uint16 (Shakhnarovich, Viola, Darrell 2003, section
    4; ELMO section 4).

    A bin is a window and a direction. Windows of 8, 16 and 32 px begin at every multiple of half their size for which
    such a step still fits into the picture, and are cut at its border: (50^2 + 25^2 + 12^2) x 4 bins, ordered by
    size, row, column and direction. Directions are those of the edge's normal to the nearest 45 degrees, light to dark
    and dark to light the same: horizontal, falling, vertical, rising.

    picture (200, 200) uint8, grey. where (200, 200) bool: where the person is; only edges there count, and the outline
    is one however alike person and background are. Without it all edges count.

    Raises
    ------
    ValueError: the picture has another size or kind.
    """
    if picture.shape != (SIDE, SIDE) or picture.dtype != np.uint8:
        raise ValueError(f"the picture is {picture.dtype} {picture.shape}, not uint8 {(SIDE, SIDE)}")
    sums = [cv2.integral(edges) for edges in edges_by_direction(picture, where)]
    return np.concatenate([_counts(sums, size) for size in WINDOWS])


def edges_by_direction(picture: np.ndarray, where: np.ndarray | None) -> list[np.ndarray]:
    """Masks (H, W) uint8 of the edge pixels of each direction: thin, and strong enough to be seen; see
    `edge_histogram`."""
    edges, dx, dy = _edges(picture, _FINE, LEAST_CONTRAST)
    if where is not None:
        outline, *slope = _edges(where.astype(np.uint8) * np.uint8(255), _FINE_OUTLINE, _LEAST_OUTLINE)
        edges = (edges & where) | outline
        dx, dy = (np.where(outline, of_outline, of_all) for of_outline, of_all in zip(slope, (dx, dy), strict=True))
    angle = cv2.phase(dx.astype(np.float32), dy.astype(np.float32))
    direction = np.round(angle * (DIRECTIONS / np.pi)).astype(np.int64) % DIRECTIONS
    return [(edges & (direction == k)).astype(np.uint8) for k in range(DIRECTIONS)]


def _edges(picture: np.ndarray, fine: float, contrast: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where there are edges (H, W) bool, and the slope along columns and rows, of a picture smoothed by `fine` [px]."""
    smooth = cv2.GaussianBlur(picture, (0, 0), fine)
    dx, dy = (cv2.Sobel(smooth, cv2.CV_16S, *order) for order in ((1, 0), (0, 1)))
    strong = _SLOPE_OF_STEP * contrast
    return cv2.Canny(dx, dy, 0.5 * strong, strong, L2gradient=True) > 0, dx, dy


def _counts(sums: list[np.ndarray], size: int) -> np.ndarray:
    """Sums over all windows of a size, from integral images (H + 1, W + 1) of each direction."""
    step = size // 2
    first = step * np.arange(SIDE // step)
    last = np.minimum(first + size, SIDE)
    of_windows = [
        s[np.ix_(last, last)] - s[np.ix_(first, last)] - s[np.ix_(last, first)] + s[np.ix_(first, first)] for s in sums
    ]
    return np.stack(of_windows, axis=-1).ravel().astype(np.uint16)
