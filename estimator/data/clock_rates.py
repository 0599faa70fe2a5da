"""Clocks that run at different rates: the rate of each relative to the held ones, from pieces of the motion.

Of each pair of cameras the clip is cut into pieces. Every piece has what speaks against each lag; the line of lags that
suits them all best is searched among all lags and rates, as lines are in pictures (Duda and Hart, CACM 1972), so that a
piece in which two moments look alike decides nothing alone. Around it each piece gives its own lag, and a line through
these, with Huber's weights, the rate and its deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import stdtrit

from estimator.data.cameras.camera import Camera
from estimator.data.clip_pieces import ClipPieces
from estimator.data.lag_lines import LagLine, fitted_line
from estimator.data.lag_tables import best_line, lag_table

MOST_SLOWER = 0.01  # largest difference of clocks: 29.7 for 30
_WITHIN = 0.95  # of that: a larger rate may be larger still
_STEP = 1.0 / 30.0  # instants are not closer than this while lines are searched [s]
_PARTS = 4  # a step between instants is divided so finely at the end
_NEAR = 3  # steps around the line in which the lags of pieces are looked for
_SIDE = 4  # divided steps from a piece's best lag at which its sharpness is measured
_ROUNDS = 2  # the lags of pieces are measured again along the line that they gave
_SURE, _LIKELY = 0.999, 0.99  # probabilities, to one side, that clocks do differ
_SMALL = 0.25  # frames that clocks differ by from the first piece to the last: less is negligible
_SCATTER = 0.5  # frames: standard deviation of pieces about a line that is believed
_ALIKE = 1.0  # frames from the middle to an end: what may be so, and is more, leaves offsets in doubt


@dataclass(frozen=True)
class ClockRates:
    """Rates of C clocks relative to the held ones.

    scales (C,): seconds of the common clock for a second of each; 1 where no other is certain. stds (C,): their
    standard deviations, 0 where nothing was measured. doubtful (C,): whether pieces of the clip have different lags,
    but no one rate that is sure. first (C,): when each clock's first frame was by the line of the pieces' lags [s], NaN
    where there is none.
    """

    scales: np.ndarray
    stds: np.ndarray
    doubtful: np.ndarray
    first: np.ndarray

    @property
    def differ(self) -> bool:
        """Whether a clock certainly runs at another rate."""
        return bool((self.scales != 1.0).any())


@dataclass(frozen=True)
class _PairRate:
    """The clock of camera b beside that of a: slower, the logarithm of seconds over seconds; first [s], when its first
    frame was on the clock of a; the line that its pieces' lags make."""

    a: int
    b: int
    slower: float
    first: float
    line: LagLine


def clock_rates(
    cameras: Sequence[Camera],
    pixels: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    held: Sequence[int],
    longest: float,
) -> ClockRates:
    """The rates of clocks that share enough time at offsets up to `longest` [s].

    pixels (C): of each camera (N, L, 2) [px], NaN where missing. times (C): of its frames (N,) [s], rising. held:
    cameras whose clocks are right.
    """
    count = len(cameras)
    result = ClockRates(np.ones(count), np.zeros(count), np.zeros(count, bool), np.full(count, np.nan))
    pairs = _pair_rates(cameras, pixels, times, longest)
    slower, stds = _of_cameras(pairs, count, held)
    frame = max((float(np.median(np.diff(of))) for of in times if len(of) > 1), default=np.inf)
    for c in range(count):
        own = [pair for pair in pairs if c in (pair.a, pair.b)]
        if c in held or not own or not np.isfinite(stds[c]):
            continue
        best = min(own, key=lambda pair: pair.line.slope_std)
        stds[c] = max(stds[c], best.line.slope_std)  # pairs share the errors of a camera's keypoints
        apart = abs(slower[c]) * best.line.reach / frame
        sure, likely = (_differs(slower[c], stds[c], best.line, share) for share in (_SURE, _LIKELY))
        steady = best.line.scatter <= _SCATTER * frame and abs(slower[c]) < _WITHIN * MOST_SLOWER
        if any(abs(pair.line.jump) > _SCATTER * frame for pair in own):
            result.doubtful[c] = True
        elif sure and steady and apart >= _SMALL:
            result.scales[c] = np.exp(slower[c])
        elif likely and 0.5 * apart > _ALIKE:
            result.doubtful[c] = True
        result.stds[c] = stds[c]
        result.first[c] = next((pair.first for pair in own if pair.a in held), np.nan)
    return result


def _differs(slower: float, std: float, line: LagLine, probability: float) -> bool:
    """Whether a rate is not that of the others, by Student's distribution."""
    return abs(slower) > float(stdtrit(line.pieces - 2, probability)) * std


def _of_cameras(pairs: Sequence[_PairRate], count: int, held: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Relative slowness (C,) of each clock to the held ones, from all pairs weighted by their deviations, and standard
    deviations (C,), infinite where no pair leads to a clock that is held."""
    information, towards = np.zeros((count, count)), np.zeros(count)
    for pair in pairs:
        step = np.zeros(count)
        step[pair.a], step[pair.b] = -1.0, 1.0
        information += np.outer(step, step) / pair.line.slope_std**2
        towards += step * pair.slower / pair.line.slope_std**2
    slower, stds = np.zeros(count), np.where(np.isin(np.arange(count), list(held)), 0.0, np.inf)
    free = [c for c in range(count) if c not in held]
    linked = _linked(pairs, held)
    free = [c for c in free if c in linked]
    if free:
        covariance = np.linalg.inv(information[np.ix_(free, free)])
        slower[free], stds[free] = covariance @ towards[free], np.sqrt(np.diag(covariance))
    return slower, stds


def _linked(pairs: Sequence[_PairRate], held: Sequence[int]) -> set[int]:
    """The cameras that pairs lead to from those that are held."""
    linked = set(held)
    for _ in pairs:
        for pair in pairs:
            if pair.a in linked or pair.b in linked:
                linked |= {pair.a, pair.b}
    return linked


def _pair_rates(
    cameras: Sequence[Camera], pixels: Sequence[np.ndarray], times: Sequence[np.ndarray], longest: float
) -> list[_PairRate]:
    """Rates of each pair of cameras whose pieces have lags."""
    if min(len(of) for of in times) < 2:
        return []
    step = max(_STEP, *(float(np.median(np.diff(of))) for of in times))
    rates = []
    for a, b in combinations(range(len(cameras)), 2):
        pieces = ClipPieces.of(times[a])
        if pieces is not None:
            two = _Two((cameras[a], cameras[b]), (pixels[a], pixels[b]), (times[a], times[b]), pieces)
            rate = _pair_rate(two, step, longest)
            rates += [] if rate is None else [_PairRate(a, b, *rate)]
    return rates


@dataclass(frozen=True)
class _Two:
    """Two cameras, what they saw and when, and the pieces of the first one's clip."""

    cameras: tuple[Camera, Camera]
    pixels: tuple[np.ndarray, np.ndarray]
    times: tuple[np.ndarray, np.ndarray]
    pieces: ClipPieces

    def start(self, step: float, longest: float) -> tuple[float, float] | None:
        """Lag and slope of the best of all lines."""
        span = sum(float(of[-1] - of[0]) for of in self.times)
        most = round(min(longest + MOST_SLOWER * span, span) / step)
        table = lag_table(self.cameras, self.pixels, self.times, self.pieces, step, most)
        return None if table is None else best_line(table, self.pieces.offsets, step, longest, MOST_SLOWER)

    def own_times(self, lag: float, slope: float) -> np.ndarray:
        """The second camera's times as the first one's clock has them, if these are lag and slope of the line."""
        return np.asarray(self.pieces.centre + (self.times[1] - self.pieces.centre - lag) / (1.0 + slope))

    def line(self, lag: float, slope: float, step: float) -> LagLine | None:
        """The line of the pieces' lags beside another line."""
        times = (self.times[0], self.own_times(lag, slope))
        table = lag_table(self.cameras, self.pixels, times, self.pieces, step, _NEAR * _PARTS)
        return None if table is None else fitted_line(table, self.pieces.offsets, step, _SIDE)


def _pair_rate(two: _Two, step: float, longest: float) -> tuple[float, float, LagLine] | None:
    """The second clock beside the first, see `_PairRate`."""
    start, line = two.start(step, longest), None
    if start is None:
        return None
    lag, slope = start
    for _ in range(_ROUNDS):
        line = two.line(lag, slope, step / _PARTS)
        if line is None:
            return None
        lag, slope = lag + (1.0 + slope) * line.lag, (1.0 + slope) * (1.0 + line.slope) - 1.0
    return None if line is None else (-float(np.log1p(slope)), float(two.own_times(lag, slope)[0]), line)
