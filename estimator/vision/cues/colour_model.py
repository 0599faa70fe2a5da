"""Colours of limbs and of what lies behind them: histograms learned where a pose shows them, and whether two differ.

Colours are compared by the logarithms of their channels' ratios, which light and shade leave alone, and only coarsely
by brightness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property

import cv2
import numpy as np

from estimator.vision.prediction import Prediction
from humanoid.support.errors import InputError

RATIOS, BRIGHTNESSES = 8, 5
BINS = RATIOS * RATIOS * BRIGHTNESSES
_RATIO_SPAN = 0.6  # of log R/G and log B/G either way: beyond are the most saturated of colours
_DARKEST, _BRIGHTEST = 16.0, 255.0
_DARK = 8.0  # grey values added to every channel, so that noise turns no dark pixel into a saturated colour
_LEVELS = 32  # of a channel, by which the bins of all colours are tabulated
_STRAY = 0.1  # share of a part's pixels that may have any colour
# squared Hellinger distance of halves of one limb, of n and m pixels: 2 % have more than _ALIKE + _FEW (1/n + 1/m)
_ALIKE, _FEW = 0.2, 3.0
_RAMP = 0.1  # of the distance beyond that, from which colours count in full
LIMBS, BEHIND = 0, 1
"""Rows of learned histograms: of the parts, and of what lies beside them."""


@dataclass(frozen=True, eq=False)
class ColourReading:
    """The colours of one picture, and those that were learned in the frames before.

    bins (H, W) uint16: of each pixel. learned (2, P, BINS) float16, exact enough and half as large in run files: pixels
    of each bin, see `LIMBS` and `BEHIND`, that each part P was seen with; None before the first pose.
    """

    bins: np.ndarray
    learned: np.ndarray | None = None

    def with_learned(self, learned: np.ndarray) -> ColourReading:
        """The same picture with what was learned; raises InputError for an array of another shape."""
        if learned.ndim != 3 or learned.shape[::2] != (2, BINS):
            raise InputError("learned colours", f"have the shape {learned.shape}, not (2, parts, {BINS})")
        return replace(self, learned=learned)

    @cached_property
    def colours(self) -> LimbColours | None:
        """What was learned, as it is compared with the picture."""
        return None if self.learned is None else LimbColours.of(self.learned)


def colour_bins(picture: np.ndarray) -> np.ndarray:
    """Bin of every pixel, (H, W) uint16, of a picture (H, W, 3) uint8 BGR."""
    levels = (picture >> 3).astype(np.uint16)
    return np.asarray(_table()[(levels[..., 0] << 10) | (levels[..., 1] << 5) | levels[..., 2]])


@cache
def _table() -> np.ndarray:
    """The bin (32768,) uint16 of every colour whose channels have five bits each, blue first."""
    values = (np.arange(_LEVELS) + 0.5) * (256.0 / _LEVELS)
    blue, green, red = (np.log(c + _DARK).ravel() for c in np.meshgrid(values, values, values, indexing="ij"))
    mean = sum(c.ravel() for c in np.meshgrid(values, values, values, indexing="ij")) / 3.0
    span = math.log(_BRIGHTEST / _DARKEST)
    bright = _cells(np.log(np.maximum(mean, 1.0) / _DARKEST) / span, BRIGHTNESSES)
    ratios = [_cells(0.5 + 0.5 * (c - green) / _RATIO_SPAN, RATIOS) for c in (red, blue)]
    return np.asarray(((ratios[0] * RATIOS + ratios[1]) * BRIGHTNESSES + bright).astype(np.uint16))


def _cells(share: np.ndarray, count: int) -> np.ndarray:
    return np.clip((share * count).astype(np.int64), 0, count - 1)


@dataclass(frozen=True, eq=False)
class LimbColours:
    """Learned colours as they are compared with pictures.

    log_density (2P, BINS) float64: of the parts, then of what lies beside each. apart (P, P + 1): how surely a part's
    colours differ from those of each other part, and last from those beside it, 0 to 1. It is 0 where histograms of one
    colour would differ as much by chance.
    """

    log_density: np.ndarray
    apart: np.ndarray

    @staticmethod
    def of(learned: np.ndarray) -> LimbColours:
        """From pixels (2, P, BINS) of each bin."""
        flat = learned.reshape(-1, BINS).astype(float)
        parts = len(learned[LIMBS])
        apart = differing(flat[:parts], flat)
        beside = apart[np.arange(parts), parts + np.arange(parts)]
        log_density = np.log((1.0 - _STRAY) * densities(flat) + _STRAY / BINS)
        return LimbColours(log_density, np.column_stack([apart[:, :parts], beside]))


def densities(counts: np.ndarray) -> np.ndarray:
    """Densities (N, BINS) of pixels (N, BINS), zero where there are none."""
    smoothed = _smoothed(counts)
    return np.asarray(smoothed / np.maximum(smoothed.sum(axis=1, keepdims=True), 1e-9))


def _smoothed(counts: np.ndarray) -> np.ndarray:
    """Histograms (N, BINS), each pixel also counted in the neighbouring bins: a colour near a border is in both."""
    grid = counts.reshape(-1, RATIOS, RATIOS, BRIGHTNESSES)
    for axis in (1, 2, 3):
        there = np.pad(grid, [(1, 1) if a == axis else (0, 0) for a in range(4)], mode="edge")
        size = grid.shape[axis]
        before, after = (np.take(there, range(k, k + size), axis) for k in (0, 2))
        grid = 0.5 * grid + 0.25 * (before + after)
    return np.asarray(grid.reshape(counts.shape))


def differing(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """How surely pixels (N, BINS) and (M, BINS) are of different colours, (N, M), 0 to 1.

    Their densities' squared Hellinger distance, less that of equal colours. Its part by the number of pixels n and m
    falls as 1/n + 1/m, as that of samples does (Freeman and Tukey 1950). Another part stays, as light and shade vary
    over a limb. Both are those of halves of limbs (`python -m benchmarks limb_colours`).
    """
    n, m = (np.maximum(h.sum(axis=1), 1e-9) for h in (first, second))
    chance = _ALIKE + _FEW * (1.0 / n[:, None] + 1.0 / m)
    return np.asarray(np.clip((distances(first, second) - chance) / _RAMP, 0.0, 1.0))


def distances(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Squared Hellinger distances (N, M), 0 to 1, of the densities of pixels (N, BINS) and (M, BINS)."""
    roots = [np.sqrt(densities(h)) for h in (first, second)]
    return np.asarray(1.0 - roots[0] @ roots[1].T)


def seen_colours(bins: np.ndarray, prediction: Prediction, parts: int, band: float) -> np.ndarray:
    """Pixels (2, P, BINS) of each bin that a predicted view shows of each part, and beside it within `band` [px].

    bins (H, W): of the picture. Cells of the depth buffer next to another part's or to none are of neither: there the
    prediction is not exact enough. What lies beside the body belongs to the part that is nearest.
    """
    left, top, size = prediction.frame
    around = math.ceil(band / size) + 1
    owner = np.pad(prediction.owner, around, constant_values=-1)
    left, top = left - around * size, top - around * size
    part = np.where(_alike(owner), owner, -1)
    distance, nearest = cv2.distanceTransformWithLabels(
        (owner < 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    inside = owner >= 0
    of_label = np.full(int(nearest.max()) + 1, -1)
    of_label[nearest[inside]] = owner[inside]
    beside = np.where((distance > 1.5) & (distance * size <= band), of_label[nearest], -1)
    row, column = _cells_of_pixels(bins.shape, left, top, size, owner.shape)
    here = bins[row[1], column[1]].astype(np.int64)
    counts = np.zeros((2, parts, BINS), np.float32)
    for k, of_cells in enumerate((part, beside)):
        of = of_cells[row[0], column[0]]
        known = of >= 0
        index = of[known] * BINS + here[known]
        counts[k] = np.bincount(index, minlength=parts * BINS).reshape(parts, BINS)
    return counts


def _alike(owner: np.ndarray) -> np.ndarray:
    """Which cells (rows, columns) have the owner of all their neighbours."""
    cells = owner.astype(np.float32)
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray((cv2.erode(cells, kernel) == cells) & (cv2.dilate(cells, kernel) == cells))


def _cells_of_pixels(
    shape: tuple[int, int], left: float, top: float, size: float, cells: tuple[int, int]
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Pixels of a picture that a buffer covers, as open grids: rows of cells and of pixels, and columns of both."""
    grids = []
    for length, start, count in ((shape[0], top, cells[0]), (shape[1], left, cells[1])):
        pixel = np.arange(length)
        cell = np.floor((pixel - start) / size + 0.5).astype(np.int64)
        known = (cell >= 0) & (cell < count)
        grids.append((cell[known], pixel[known]))
    (row, y), (column, x) = grids
    return (row[:, None], y[:, None]), (column[None], x[None])


def updated(before: np.ndarray | None, seen: np.ndarray, limbs: float, behind: float) -> np.ndarray:
    """Learned colours (2, P, BINS) float16 after one more frame, in which `seen` (2, P, BINS) was counted.

    limbs, behind: shares, 0 to 1, by which they move to those of the frame. A part that is hidden there, or looks more
    like what was beside it than like itself, keeps what it had.
    """
    if before is None:
        return np.asarray(seen.astype(np.float16))
    log_density = LimbColours.of(before).log_density
    parts = len(seen[LIMBS])
    likely = ((log_density[:parts] - log_density[parts:]) * seen[LIMBS]).sum(axis=1)
    known = before[LIMBS].any(axis=1)
    share = np.zeros((2, parts, 1), np.float32)
    share[LIMBS, :, 0] = limbs * (seen[LIMBS].any(axis=1) & (~known | (likely >= 0.0)))
    share[BEHIND, :, 0] = behind * seen[BEHIND].any(axis=1)
    return np.asarray((before + share * (seen - before.astype(np.float32))).astype(np.float16))
