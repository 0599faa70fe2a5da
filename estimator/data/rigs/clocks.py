"""Clocks of cameras whose places are not known, from how fast joints move: what is fast in one is fast in others.

Afterwards, with places, `estimator.data.synchronisation` tells them by rays that meet as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from estimator.data.lags import Lags
from estimator.data.moving_rays import MovingRays, speed_disagreement
from estimator.data.rigs.views import JointView
from estimator.data.synchronisation import LONGEST, PEAK

_STEP = 1.0 / 30.0  # s: of the instants, at least
_TRUSTED = 1.0  # s in common at which half of what a lag says is believed
_SHORTEST = 0.3  # s in common
_OTHERS = 3


def clock_lags(views: Sequence[JointView]) -> list[np.ndarray]:
    """How much later each clock is read (C,) [s], the first one's 0, for the speeds of all to agree: the best, then
    others in which one clock has another lag that is better than its neighbours, as walking looks alike a stride later.
    None where nobody moves, or no two cameras have a time in common."""
    step = max(_STEP, *(float(np.median(np.diff(view.times))) for view in views))
    begin, end = min(view.times[0] for view in views), max(view.times[-1] for view in views)
    grid = np.arange(begin, end + 1.5 * step, step)
    logs = [MovingRays.of(v.camera, v.pixels, v.times, grid).log_speed for v in views]
    most = min(round(LONGEST / step), len(grid) - 1)
    pairs = list(combinations(range(len(views)), 2))
    table = np.array([_table(logs[a], logs[b], most, step) for a, b in pairs])
    if np.ptp(table) == 0.0:
        return []
    a, b = (np.array([pair[k] for pair in pairs]) for k in range(2))
    lags = Lags(a, b, table, most)
    best = lags.best(len(views), [0])
    return [step * each.astype(float) for each in (best, *_others(lags, best, step))]


def _others(lags: Lags, best: np.ndarray, step: float) -> list[np.ndarray]:
    """The next best, in which one clock is read otherwise."""
    others: list[tuple[float, np.ndarray]] = []
    for c in range(1, len(best)):
        options = np.repeat(best[None], 2 * lags.most + 1, axis=0)
        options[:, c] = np.arange(-lags.most, lags.most + 1)
        costs = np.array([lags.of(option) for option in options])
        inner = np.flatnonzero((costs[1:-1] < costs[:-2]) & (costs[1:-1] < costs[2:])) + 1
        inner = inner[np.abs(options[inner, c] - best[c]) * step > PEAK]
        others += [(costs[i], options[i]) for i in inner[np.argsort(costs[inner])][:_OTHERS]]
    return [option for _, option in sorted(others, key=lambda pair: pair[0])[:_OTHERS]]


def _table(first: np.ndarray, second: np.ndarray, most: int, step: float) -> np.ndarray:
    """What speaks against each lag (2 most + 1,) of the second camera, from logarithms of speeds (T, J): half the
    logarithm of what the one's leave of the variance of the other's, drawn to the usual where little is in common."""
    values = np.zeros(2 * most + 1)
    for lag in range(-most, most + 1):
        i = np.arange(max(0, -lag), len(first) - max(0, lag))
        a, b = first[i], second[i + lag]
        seen = np.isfinite(a) & np.isfinite(b)
        common = step * float(np.count_nonzero(seen.any(axis=1)))
        if common < _SHORTEST:
            continue
        values[lag + most] = speed_disagreement(a, b, seen) * common / (common + _TRUSTED)
    return values
