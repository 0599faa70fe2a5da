"""A line through the lags of a clip's pieces: the drift between two clocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.numerics.huber import huber_weights

_FEWEST = 5  # pieces
_ROUNDS = 10
_SIDE = 2  # pieces before a jump, and after it, at least
_MUCH_BETTER, _CLEAR = 0.5, 6.0  # share of a line's squares that a jump leaves; of its standard error
_FINEST = 0.1  # of a step between lags: no lag is better than this
_FLAT = 0.01  # rise of the misfit of lags beside the best, below which a piece does not determine a clock


@dataclass(frozen=True)
class LagLine:
    """lag [s] at moment 0, slope [s/s] with its standard deviation.

    scatter [s]: standard deviation of a piece about the line. pieces: how many there are. reach [s]: from the first
    one's middle to the last one's. jump [s]: by which pieces after some moment have other lags than those before, where
    that suits them much better than a line, else 0.
    """

    lag: float
    slope: float
    slope_std: float
    scatter: float
    pieces: int
    reach: float
    jump: float = 0.0


def fitted_line(table: np.ndarray, offsets: np.ndarray, step: float, near: int) -> LagLine | None:
    """The line through the best lags of pieces, None where too few have one.

    The deviation of its slope is the larger of two: by the residuals, and without each piece in turn (the jackknife,
    Efron 1982).

    table (K, 2 most + 1): misfit at each lag of a piece, NaN where it has too little data. offsets (K,): moments of the
    pieces [s]. step [s]: between lags. near: steps from the best lag at which a piece's rise is its weight.
    """
    lags, rises = best_lags(table, near)
    kept = np.isfinite(lags)
    if np.count_nonzero(kept) < _FEWEST:
        return None
    at, lags, prior = offsets[kept], step * lags[kept], rises[kept] / np.median(rises[kept])
    line, scatter, std = _robust(at, lags, prior, step)
    every = np.arange(len(at))
    without = np.array([_robust(at[every != k], lags[every != k], prior[every != k], step)[0][1] for k in every])
    spread = float(np.sqrt((len(at) - 1) * np.mean(np.square(without - without.mean()))))
    return LagLine(
        float(line[0]), float(line[1]), max(std, spread), scatter, len(at), float(np.ptp(at)), _jump(at, lags, prior)
    )


def _robust(at: np.ndarray, lags: np.ndarray, prior: np.ndarray, step: float) -> tuple[np.ndarray, float, float]:
    """Lag and slope (2,) of the line through lags (K,) at moments (K,) [s] with Huber's weights beside given ones (K,),
    the scatter about it [s], and the deviation of the slope."""
    design = np.stack([np.ones_like(at), at], axis=1)
    weights = prior
    for _ in range(_ROUNDS):
        line, normal = _weighted(design, lags, weights), design.T @ (weights[:, None] * design)
        off = np.sqrt(prior) * np.abs(lags - design @ line)
        scatter = max(1.4826 * float(np.median(off)), _FINEST * step)
        weights = prior * huber_weights(off / scatter)
    variance = float((weights * np.square(lags - design @ line)).sum()) / (len(at) - 2)
    variance = max(variance, (_FINEST * step) ** 2)
    return line, scatter, float(np.sqrt(variance * np.linalg.inv(normal)[1, 1]))


def _jump(at: np.ndarray, lags: np.ndarray, prior: np.ndarray) -> float:
    """Between which two lags pieces (K,) change once, see `LagLine.jump`."""
    design = np.stack([np.ones_like(at), at], axis=1)
    left = float((prior * np.square(lags - design @ _weighted(design, lags, prior))).sum())
    jump = 0.0
    for k in range(_SIDE, len(at) - _SIDE + 1):
        later = (np.arange(len(at)) >= k).astype(float)
        both = np.stack([1.0 - later, later], axis=1)
        levels = _weighted(both, lags, prior)
        off = float((prior * np.square(lags - both @ levels)).sum())
        error = np.sqrt(off / (len(at) - 3) * (1.0 / (both.T @ prior)).sum())
        if off < _MUCH_BETTER * left and abs(levels[1] - levels[0]) > _CLEAR * error:
            left, jump = off / _MUCH_BETTER, float(levels[1] - levels[0])
    return jump


def _weighted(design: np.ndarray, values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Coefficients (P,) of a design (K, P) with the least weighted squares to values (K,)."""
    return np.asarray(np.linalg.solve(design.T @ (weights[:, None] * design), design.T @ (weights * values)))


def best_lags(table: np.ndarray, near: int) -> tuple[np.ndarray, np.ndarray]:
    """Best lag of each piece (K,) in steps, interpolated, NaN where none is better than those around it, and how much
    worse others `near` steps away are."""
    most = table.shape[1] // 2
    lags, rises = np.full(len(table), np.nan), np.zeros(len(table))
    for k, values in enumerate(table):
        if not np.isfinite(values).all():
            continue
        at = int(values.argmin())
        if not near <= at <= 2 * most - near:
            continue
        left, middle, right = values[at - near], values[at], values[at + near]
        rises[k] = 0.5 * (left + right) - middle
        if rises[k] > _FLAT:
            lags[k] = at - most + 0.25 * near * (left - right) / rises[k]
    return lags, rises
