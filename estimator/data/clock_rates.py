"""Clocks of several cameras: the misfit at each lag of each pair, in pieces of the clip, the lags that suit all pairs
best, and the rates of clocks that run differently.

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
from estimator.data.lag_lines import LagLine, fitted_line
from estimator.data.moving_rays import PairCourse, pair_courses

_PIECES, _SHORTEST, _LONGEST = 16, 1.0, 4.0  # pieces of a clip as a rule, and how long they are [s]
_FEWEST, _MOST = 5, 32
_INSTANTS = 960  # that are compared in all


@dataclass(frozen=True)
class ClipPieces:
    """Pieces of a clip: the middle of each (K,) and how long they are [s]."""

    middles: np.ndarray
    length: float

    @staticmethod
    def of(times: np.ndarray) -> ClipPieces | None:
        """The pieces of a camera's times (N,) [s], None for a clip that is too short."""
        span = float(times[-1] - times[0])
        length = float(np.clip(span / _PIECES, _SHORTEST, _LONGEST))
        count = min(_MOST, int(span / length + 1e-6))
        if count < _FEWEST:
            return None
        return ClipPieces(times[0] + (np.arange(count) + 0.5) * span / count, min(length, span / count))

    @property
    def centre(self) -> float:
        """The middle of all pieces [s]."""
        return float(self.middles.mean())

    @property
    def offsets(self) -> np.ndarray:
        """The middles beside that of all pieces (K,) [s]."""
        return np.asarray(self.middles - self.centre)

    def instants(self, start: float, step: float, count: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Instants of a grid of `count` from `start`: some that lie in pieces (I,), whose piece each is (I,), and the
        time that each represents [s]."""
        stride = max(1, int(self.length / step * len(self.middles) / _INSTANTS))
        i = np.arange(0, count, stride)
        at = start + i * step
        piece = np.abs(at[:, None] - self.middles).argmin(axis=1)
        inside = np.abs(at - self.middles[piece]) <= 0.5 * self.length
        return i[inside], piece[inside], stride * step


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


@dataclass(frozen=True)
class Lags:
    """Misfit at each lag of P pairs of cameras a, b (P,): table (P, 2 most + 1), by the lag of b after a in instants,
    from -most to most."""

    a: np.ndarray
    b: np.ndarray
    table: np.ndarray
    most: int

    def of(self, lags: np.ndarray) -> float:
        """Mean of the table for cameras delayed by lags (C,) in instants."""
        apart = np.clip(lags[self.b] - lags[self.a], -self.most, self.most)
        return float(self.table[np.arange(len(self.a)), apart + self.most].mean())

    def best(self, count: int, still: Sequence[int] = ()) -> np.ndarray:
        """Lags (C,) of `count` cameras with the least mean: downhill, one camera after the other, from no lags and from
        the best lags that each camera alone has of the others. Cameras in `still` keep a lag of 0."""
        starts = [np.zeros(count, dtype=np.int64)]
        for c in still or range(count):
            own = self.table.argmin(axis=1) - self.most
            lags = np.zeros(count, dtype=np.int64)
            lags[self.b[self.a == c]] = own[self.a == c]
            lags[self.a[self.b == c]] = -own[self.b == c]
            lags[list(still)] = 0
            starts.append(lags)
        return min((self._downhill(lags, still) for lags in starts), key=self.of)

    def _downhill(self, lags: np.ndarray, still: Sequence[int]) -> np.ndarray:
        tried = np.arange(-self.most, self.most + 1)
        before = np.inf
        while self.of(lags) < before:
            before = self.of(lags)
            for c in range(len(lags)):
                if c in still:
                    continue
                options = np.repeat(lags[None], len(tried), axis=0)
                options[:, c] = tried
                lags = min((lags, *options), key=self.of)
        return lags


MOST_SLOWER = 0.01  # largest difference of clocks: 29.7 for 30
_WITHIN = 0.95  # of that: a larger rate may be larger still
_STEP = 1.0 / 30.0  # instants are not closer than this while lines are searched [s]
_PARTS = 4  # a step between instants is divided so finely at the end
_NEAR = 3  # steps around the line in which the lags of pieces are searched for
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
