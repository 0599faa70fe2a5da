"""Misfit at each lag between two cameras, in pieces of a clip, and the line of lags that fits all best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.clip_pieces import ClipPieces
from estimator.data.pair_courses import PairCourse, pair_courses

_FULL = 0.5  # of a piece that both cameras have to see


def lag_table(
    cameras: Sequence[Camera],
    pixels: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    pieces: ClipPieces,
    step: float,
    most: int,
) -> np.ndarray | None:
    """Misfit at each lag of the second of two cameras, -most to most steps [s], in each piece of the first one's clip:
    (K, 2 most + 1), NaN where a piece has too little data. None for cameras at the same place."""
    courses = pair_courses(cameras, pixels, times, step)
    if not courses:
        return None
    start = min(float(of[0]) for of in times)
    instants = pieces.instants(start, step, courses[0].count)
    each = [_of_pieces(courses[0], lag, instants, pieces) for lag in range(-most, most + 1)]
    return np.stack(each, axis=1)


def _of_pieces(
    course: PairCourse, lag: int, instants: tuple[np.ndarray, np.ndarray, float], pieces: ClipPieces
) -> np.ndarray:  # fmt: skip
    """Misfit at one lag in each piece (K,)."""
    i, piece, each = instants
    count = len(pieces.middles)
    partnered = (i + lag >= 0) & (i + lag < course.count)
    i, piece = i[partnered], piece[partnered]
    sums, weights = course.rays(lag, i)
    seen = weights > 0.0
    common = each * np.bincount(piece, seen.any(axis=1), count)
    total, weight = (np.bincount(piece, values.sum(axis=1), count) for values in (sums, weights))
    enough = common >= _FULL * pieces.length
    return np.where(
        enough, total / np.where(enough, weight, 1.0) + course.speeds_by(lag, i, seen, piece, count), np.nan
    )


def best_line(
    table: np.ndarray, offsets: np.ndarray, step: float, longest: float, steepest: float
) -> tuple[float, float] | None:
    """Lag [s] and slope of the line of lags that suits all pieces best, each as much as the others; None where no piece
    has a lag.

    table: see `lag_table`. offsets (K,): moments of the pieces [s], about 0. longest [s], steepest: of the lines that
    are tried; they end within a step of each other, and of several that are as good the least steep is taken.
    """
    if not np.isfinite(table).any():
        return None
    most = table.shape[1] // 2
    gain = np.where(np.isfinite(table), np.nanmedian(table) - table, 0.0)
    lags = np.arange(-min(most, round(longest / step)), min(most, round(longest / step)) + 1)
    best, line = -np.inf, (0.0, 0.0)
    for slope in _slopes(float(np.abs(offsets).max()), step, steepest):
        places = lags + most + np.round(slope * offsets[:, None] / step).astype(int)
        inside = (places >= 0) & (places <= 2 * most)
        gains = np.where(inside, np.take_along_axis(gain, np.clip(places, 0, 2 * most), axis=1), 0.0).sum(axis=0)
        if gains.max() > best:
            best, line = float(gains.max()), (float(lags[gains.argmax()]) * step, float(slope))
    return line


def _slopes(reach: float, step: float, steepest: float) -> np.ndarray:
    """Slopes of lines that end within a step of each other, the least steep first."""
    count = int(np.ceil(steepest * reach / step))
    slopes = np.linspace(-steepest, steepest, 2 * count + 1)
    return np.asarray(slopes[np.argsort(np.abs(slopes), kind="stable")])
