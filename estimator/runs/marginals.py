"""One degree of freedom at a time: mixtures of Gaussians cut off at the limits, and of modes that lean on a limit.

Moments and quantiles of a component are closed forms (N. L. Johnson, S. Kotz and N. Balakrishnan, Continuous Univariate
Distributions 1, 2nd ed. 1994, 13.10.1 for the Gaussian; the exponential forgets where it began). Quantiles of a mixture
lie between those of its components, where all coordinates are searched at once.

The uncertainty of every degree of freedom in a run, by frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, misplaced

_REACH = 8.0  # standard deviations of a component that the grid spans
_POINTS, _FEWEST_POINTS = 400, 24  # of the grid: for all components, for each at least
_SMALLEST = 1e-9  # rad or m: standard deviation of what is given as certain
_FAR = 40.0  # standard deviations beyond which a Gaussian has no probability in double precision
_EVEN = 1e-3  # standard deviations of room on which a Gaussian is as good as even
_LONG, _SHORT = 700.0, 1e-2  # mean distances beyond which an exponential has nothing; below which a series is as exact


@dataclass(frozen=True)
class Marginals:
    """The distribution of every coordinate of a tangent space on its own, as a mixture of K components.

    weight (K,): of the components, sum 1; (n, K) where every coordinate has its own. mean, std (n, K): of the Gaussians
    before they are cut off at `low` and `high` (n,), infinite where there is no limit. lean (n, K): where it is not
    zero, the component is instead an exponential that begins at its mean, which is a limit, and leads inside with this
    mean distance, negative below an upper limit.
    """

    weight: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    lean: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @staticmethod
    def stacked(parts: Sequence[Marginals]) -> Marginals:
        """The coordinates of all, one below another; components that a part has not get no weight there."""
        most = max(part.weight.shape[-1] for part in parts)

        def rows(of_part: Sequence[np.ndarray]) -> np.ndarray:
            return np.concatenate([np.pad(a, ((0, 0), (0, most - a.shape[1])), mode="edge") for a in of_part])

        weights = [np.broadcast_to(p.weight, p.mean.shape) for p in parts]
        weight = np.concatenate([np.pad(w, ((0, 0), (0, most - w.shape[1]))) for w in weights])
        mean, std, lean = (rows([getattr(p, name) for p in parts]) for name in ("mean", "std", "lean"))
        low, high = (np.concatenate([getattr(p, name) for p in parts]) for name in ("low", "high"))
        return Marginals(weight, mean, std, lean, low, high)

    def cdf(self, x: np.ndarray) -> np.ndarray:
        """Probability below x (n, ...), of the same shape."""
        shape = (len(self.mean), *[1] * (x.ndim - 1), -1)
        start, share = (part.reshape(shape) for part in self._within())
        weight = np.broadcast_to(self.weight, self.mean.shape).reshape(shape)
        return np.asarray(np.sum(weight * np.clip((self._below(x) - start) / share, 0.0, 1.0), axis=-1))

    def quantile(self, p: float) -> np.ndarray:
        """The value (n,) below which lies the probability p, 0 to 1."""
        return self.quantiles(p)[0]

    def quantiles(self, *levels: float) -> np.ndarray:
        """The values (P, n) below which lie the probabilities, each 0 to 1."""
        from scipy.optimize.elementwise import find_root  # not at the top: slow to load

        start, share = self._within()
        scaled = self.weight / share
        before = np.sum(scaled * start, axis=1)

        def over(x: np.ndarray, i: np.ndarray, p: np.ndarray) -> np.ndarray:
            below = _below(x[:, None] - self.mean[i], self.std[i], self.lean[i])
            return np.asarray(np.sum(scaled[i] * below, axis=1) - before[i] - p)

        own = np.array([self._component_quantiles(p) for p in levels])
        i, p = np.tile(np.arange(len(self.mean)), len(levels)), np.repeat(levels, len(self.mean))
        ends = tuple(edge.ravel() for edge in (own.min(axis=2), own.max(axis=2)))
        with np.errstate(invalid="ignore"):  # ends of p = 0 or 1 without limits
            root = find_root(over, ends, args=(i, p))
        # where all components agree, rounding can leave both ends on one side
        nearest = np.where(root.f_bracket[0] >= 0.0, root.bracket[0], root.bracket[1])
        return np.where(root.success, root.x, nearest).reshape(own.shape[:2])

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,), of the distribution within the limits."""
        means, variances = self._component_moments()
        mean = np.sum(self.weight * means, axis=1)
        return mean, np.sqrt(np.sum(self.weight * (variances + np.square(means - mean[:, None])), axis=1))

    def credible_level(self, x: np.ndarray) -> np.ndarray:
        """Credible levels (n,) of x (n,): probability of the smallest region that contains it, 0 at the highest
        density, 1 far out.

        Where the distribution is right, levels are spread evenly over 0 to 1 (Hyndman 1996).
        """
        edges, mass = self._cells()
        density = mass / np.maximum(np.diff(edges, axis=1), 1e-300)
        inside = (x >= edges[:, 0]) & (x <= edges[:, -1])
        row, own = np.arange(len(edges)), _cells_of(edges, x)
        here = density[row, own][:, None]
        same = np.isclose(density, here, rtol=1e-6, atol=0.0)  # half of the cell x is in, and of its equals
        above = np.sum(mass * np.where(same, 0.5, density > here), axis=1)
        return np.where(inside, np.minimum(above, 1.0), 1.0)

    def credible_regions(self, level: float) -> list[list[tuple[float, float]]]:
        """The smallest region of credible level `level`, for every coordinate: its intervals, rising."""
        intervals = []
        for edges, mass in zip(*self._cells(), strict=True):
            density = mass / np.maximum(np.diff(edges), 1e-300)
            order = np.argsort(-density, kind="stable")
            count = int(np.searchsorted(np.cumsum(mass[order]), level)) + 1
            chosen = np.zeros(len(mass) + 2, dtype=np.int8)
            chosen[1:-1][order[:count]] = 1
            change = np.diff(chosen)
            starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
            intervals.append([(float(edges[a]), float(edges[b])) for a, b in zip(starts, ends, strict=True)])
        return intervals

    def _below(self, x: np.ndarray) -> np.ndarray:
        """Probability of each component below x (n, ...), not cut off: (n, ..., K)."""
        shape = (len(self.mean), *[1] * (x.ndim - 1), -1)
        mean, std, lean = (part.reshape(shape) for part in (self.mean, self.std, self.lean))
        return _below(x[..., None] - mean, std, lean)

    def _within(self) -> tuple[np.ndarray, np.ndarray]:
        """Probability (n, K) of each component below `low`, and that between the limits, never zero."""
        start, end = (self._below(edge[:, None])[:, 0] for edge in (self.low, self.high))
        return start, np.maximum(end - start, 1e-300)

    def _component_moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and variance (n, K) of each component within the limits."""
        std = np.maximum(self.std, _SMALLEST)
        off, square = _cut_gaussian(*((edge[:, None] - self.mean) / std for edge in (self.low, self.high)))
        mean, variance = self.mean + std * off, np.square(std) * square
        i, k = leaning = np.nonzero(self.lean)
        begin, room = self._exponentials(i, k)
        away, variance[leaning] = _cut_exponential(np.abs(self.lean[leaning]), room)
        mean[leaning] = begin + np.sign(self.lean[leaning]) * away
        return mean, variance

    def _component_quantiles(self, p: float) -> np.ndarray:
        """The value (n, K) below which lies the probability p of each component within the limits."""
        start, share = self._within()
        x = self.mean + np.maximum(self.std, _SMALLEST) * ndtri(np.minimum(start + p * share, 1.0))
        i, k = leaning = np.nonzero(self.lean)
        begin, room = self._exponentials(i, k)
        lean = self.lean[leaning]
        inside = np.where(lean > 0.0, p, 1.0 - p)
        with np.errstate(divide="ignore"):  # p = 1 without a limit on the other side
            x[leaning] = begin - lean * np.log1p(inside * np.expm1(-room / np.abs(lean)))
        return np.asarray(np.clip(x, self.low[:, None], self.high[:, None]))

    def _exponentials(self, i: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts within the limits of the exponentials (E,) that are components k of coordinates i, and the distances
        of the other limit."""
        begin = np.clip(self.mean[i, k], self.low[i], self.high[i])
        return begin, np.where(self.lean[i, k] > 0.0, self.high[i] - begin, begin - self.low[i])

    def _grid(self) -> np.ndarray:
        """Points (n, G), rising, dense where any component is narrow."""
        steps = np.linspace(-1.0, 1.0, max(_FEWEST_POINTS, _POINTS // self.weight.shape[-1]))
        steps = _REACH * steps * np.abs(steps)
        spread = np.where(self.lean == 0.0, np.maximum(self.std, _SMALLEST), np.abs(self.lean))
        points = (self.mean[..., None] + spread[..., None] * steps).reshape(len(self.mean), -1)
        # exponentials have longer tails than Gaussians
        far = np.concatenate([self.mean - 3.0 * _REACH * spread, self.mean + 3.0 * _REACH * spread], axis=1)
        points = np.concatenate([points, far, self.mean], axis=1)
        return np.asarray(np.sort(np.clip(points, self.low[:, None], self.high[:, None]), axis=1))

    def _cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Edges (n, G) and the probabilities of the cells between them (n, G - 1)."""
        edges = self._grid()
        return edges, _mass(self.cdf(edges))


def _below(gap: np.ndarray, std: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """Probability of components, not cut off, below values at a distance (..., K) above their means; std, lean: as in
    `Marginals`, of matching shapes."""
    below = np.asarray(ndtr(gap / np.maximum(std, _SMALLEST)))
    leaning = np.broadcast_to(lean != 0.0, below.shape)
    if leaning.any():
        own = np.broadcast_to(lean, below.shape)[leaning]
        tail = np.exp(-np.maximum(gap[leaning] / own, 0.0))
        below[leaning] = np.where(own > 0.0, 1.0 - tail, tail)
    return below


def _cut_gaussian(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of a standard normal cut off at both ends, all of one shape."""
    low, high = np.clip(low, -_FAR, _FAR), np.clip(high, -_FAR, _FAR)
    side = np.where(low > 0.0, -1.0, 1.0)  # tails are exact below the mean only
    low, high = np.where(side > 0.0, low, -high), np.where(side > 0.0, high, -low)
    at_low, at_high = (np.exp(-0.5 * np.square(z)) / np.sqrt(2.0 * np.pi) for z in (low, high))
    share = np.maximum(ndtr(high) - ndtr(low), 1e-300)
    mean = np.clip((at_low - at_high) / share, low, high)
    variance = np.maximum(1.0 + (low * at_low - high * at_high) / share - np.square(mean), 0.0)
    even = high - low < _EVEN  # rounding is all that the closed forms leave there
    return side * np.where(even, 0.5 * (low + high), mean), np.where(even, np.square(high - low) / 12.0, variance)


def _cut_exponential(size: np.ndarray, room: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance (E,) of exponentials with mean distances `size`, cut off at `room`, maybe infinite."""
    width = np.clip(room / size, 1e-300, _LONG)
    short = width < _SHORT
    mean = np.where(short, room * (0.5 - width / 12.0), size * (1.0 - width / np.expm1(width)))
    even = np.square(room) * (1.0 / 12.0 - np.square(width) / 240.0)
    full = np.square(size) * (1.0 - np.square(0.5 * width / np.sinh(0.5 * width)))
    return mean, np.where(short, even, full)


def _mass(below: np.ndarray) -> np.ndarray:
    """Probabilities (n, G - 1) of the cells between points with so much (n, G) below them."""
    return np.maximum(np.diff(below, axis=1), 0.0)


def _cells_of(edges: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Index (n,) of the cell of edges (n, G) that each x (n,) is in; never one without width at the ends."""
    cells = [np.searchsorted(e, v, side="left" if v >= e[-1] else "right") - 1 for e, v in zip(edges, x, strict=True)]
    return np.clip(np.array(cells), 0, edges.shape[1] - 2)


LEVEL = 0.9
"""The level of the intervals that plots, pages and tables show."""
_AT_ONCE = 400  # components of frames that are searched together: fewer cost more calls, more leave the cache


class Spread(NamedTuple):
    """The calibrated posterior of T frames, for each degree of freedom; NaN in frames without hypotheses, and for a
    retargeted motion, which was not measured.

    std (T, nv): standard deviations over all hypotheses [rad, m]. best (T, nq): the configuration that `ends` is
    relative to. ends (T, 2, nv): ends of the central interval of a level, in the tangent space at `best`, within the
    joint limits: quantiles of the mixture, which with several hypotheses is not Gaussian. Unobserved joints may be
    anywhere within their limits.
    """

    std: np.ndarray
    best: np.ndarray
    ends: np.ndarray


def checked_level(level: Any, joint: str) -> float:
    """A probability; raises InputError for any other number, and for anything else, such as the name of a joint. joint:
    for the example in the message."""
    if isinstance(level, bool) or not isinstance(level, (int, float, np.integer, np.floating)):
        taken = f"a probability, as run.interval({LEVEL}); of one joint: run[{joint!r}].low and .high"
        raise misplaced("level", level, taken)
    if not 0.0 <= level <= 1.0:
        raise InputError("level", f"{level:g} is not a probability", remedy="0 to 1, as 0.9")
    return float(level)


def spread_of(
    body: Body,
    count: int,
    known: Sequence[int],
    posterior: Callable[[int], tuple[np.ndarray, Marginals]],
    unseen: Sequence[str],
    level: float,
) -> Spread:
    """The spread of `count` frames, with the central intervals of this probability, 0 to 1.

    known: the frames with hypotheses, of which `posterior` gives the best configuration and its marginals. unseen: the
    joints that are unobserved.
    """
    std, best = np.full((count, body.nv), np.nan), np.full((count, body.nq), np.nan)
    ends = np.full((count, 2, body.nv), np.nan)
    rows: list[int] = []
    parts: list[Marginals] = []
    for t in known:
        best[t], marginals_of_frame = posterior(t)
        rows.append(t)
        parts.append(marginals_of_frame)
        if t == known[-1] or sum(part.weight.shape[-1] for part in parts) >= _AT_ONCE:
            marginals = Marginals.stacked(parts)
            std[rows] = marginals.moments()[1].reshape(-1, body.nv)
            quantiles = marginals.quantiles(0.5 - 0.5 * level, 0.5 + 0.5 * level)
            ends[rows] = quantiles.reshape(2, -1, body.nv).transpose(1, 0, 2)
            rows, parts = [], []
    for joint in unseen:
        v, i = body.v_names.index(joint), body.q_names.index(joint)
        std[known, v], ends[known, :, v] = _anywhere(body.lower[i], body.upper[i], best[known, i], level)
    return Spread(std, best, ends)


def _anywhere(lower: float, upper: float, best: np.ndarray, level: float) -> tuple[float, np.ndarray]:
    """Standard deviation, and ends (T, 2) of the central interval of a level beside the best (T,), of a joint that may
    be anywhere within its limits alike."""
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return half / np.sqrt(3.0), middle + level * half * np.array([-1.0, 1.0]) - best[:, None]
