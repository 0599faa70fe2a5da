"""One degree of freedom at a time: mixtures of Gaussians cut off at the limits, and of modes that lean on a limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

_REACH = 8.0  # standard deviations of a component that the grid spans
_POINTS, _FEWEST_POINTS = 400, 24  # of the grid: for all components, for each at least
_SMALLEST = 1e-9  # rad or m: standard deviation of what is said to be certain


@dataclass(frozen=True)
class Marginals:
    """The distribution of every coordinate of a tangent space on its own, as a mixture of K components.

    weight (K,): of the components, sum 1. mean, std (n, K): of the Gaussians before they are cut off at `low` and
    `high` (n,), infinite where there is no limit. lean (n, K): where it is not zero, the component is instead an
    exponential that begins at its mean, which is a limit, and leads inside with this mean distance, negative below
    an upper limit.
    """

    weight: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    lean: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def cdf(self, x: np.ndarray) -> np.ndarray:
        """Probability below x (n, ...), of the same shape."""
        below = self._below(x)
        start, end = (self._below(edge[:, None])[:, 0] for edge in (self.low, self.high))
        shape = (len(start), *[1] * (x.ndim - 1), -1)
        share = (below - start.reshape(shape)) / np.maximum(end - start, 1e-300).reshape(shape)
        return np.asarray(np.clip(share, 0.0, 1.0) @ self.weight)

    def quantile(self, p: float) -> np.ndarray:
        """The value (n,) below which lies the probability p, 0 to 1; linear between the points of a fine grid."""
        edges = self._grid()
        return _quantile(edges, self.cdf(edges), p)

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,), of the distribution within the limits."""
        return _moments(*self._cells())

    def spread(self, *levels: float) -> tuple[np.ndarray, np.ndarray]:
        """Standard deviation (n,) as of `moments` and a quantile (P, n) for each level, at the cost of either alone."""
        edges = self._grid()
        below = self.cdf(edges)
        std = _moments(edges, _mass(below))[1]
        return std, np.array([_quantile(edges, below, p) for p in levels]).reshape(len(levels), len(std))

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
        gap = x[..., None] - self.mean.reshape(shape)
        below = np.asarray(ndtr(gap / np.maximum(self.std, _SMALLEST).reshape(shape)))
        for i, k in zip(*np.nonzero(self.lean), strict=True):
            tail = np.exp(-np.maximum(gap[i, ..., k] / self.lean[i, k], 0.0))
            below[i, ..., k] = 1.0 - tail if self.lean[i, k] > 0.0 else tail
        return below

    def _grid(self) -> np.ndarray:
        """Points (n, G), rising, dense where any component is narrow."""
        steps = np.linspace(-1.0, 1.0, max(_FEWEST_POINTS, _POINTS // len(self.weight)))
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


def _mass(below: np.ndarray) -> np.ndarray:
    """Probabilities (n, G - 1) of the cells between points with so much (n, G) below them."""
    return np.maximum(np.diff(below, axis=1), 0.0)


def _moments(edges: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (n,) from cells between edges (n, G) with probabilities mass (n, G - 1)."""
    middle = 0.5 * (edges[:, 1:] + edges[:, :-1])
    mean = np.sum(mass * middle, axis=1)
    return mean, np.sqrt(np.sum(mass * np.square(middle - mean[:, None]), axis=1))


def _quantile(edges: np.ndarray, below: np.ndarray, p: float) -> np.ndarray:
    """The value (n,) with probability p below it, from the probabilities (n, G) below edges (n, G)."""
    return np.array([np.interp(p, shares, edge) for shares, edge in zip(below, edges, strict=True)])


def _cells_of(edges: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Index (n,) of the cell of edges (n, G) that each x (n,) is in; never one without width at the ends."""
    cells = [np.searchsorted(e, v, side="left" if v >= e[-1] else "right") - 1 for e, v in zip(edges, x, strict=True)]
    return np.clip(np.array(cells), 0, edges.shape[1] - 2)
