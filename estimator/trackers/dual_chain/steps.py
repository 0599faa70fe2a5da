"""Random steps inside a box, most of them short, some long, with their exact density."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from humanoid.support.compiled import jit

_EDGE = 1e-12  # of a probability: so near to 0 or 1 the inverse of the normal distribution is infinite
_COUNTS = 20.0  # nats: kernels lower than the highest by more than this add nothing


@dataclass(frozen=True)
class TruncatedSteps:
    """Independent normal steps of each dimension (D), cut off at the walls of a box.

    The dimensions are in groups, and each group by itself now and then takes a step that is `wide` times as long, in
    all its dimensions: one arm may be elsewhere without the rest of the body.

    std (D,): of a short step, above 0. lower, upper (D,): of the box, infinite where it has no wall. groups: of all
    dimensions, each in one. share: of long steps. wide: their length factor.
    """

    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    groups: tuple[np.ndarray, ...]
    share: float
    wide: float

    def moved(self, rng: np.random.Generator, centres: np.ndarray) -> np.ndarray:
        """One step from each of the centres (N, D), which may be outside of the box: (N, D) inside of it."""
        moved = np.empty_like(centres)
        for group in self.groups:
            moved[:, group] = self.moved_group(rng, centres, group)
        return moved

    def moved_group(self, rng: np.random.Generator, centres: np.ndarray, group: np.ndarray) -> np.ndarray:
        """The dimensions of a group alone, (N, G)."""
        far = rng.random((len(centres), 1)) < self.share
        std = self.std[group] * np.where(far, self.wide, 1.0)
        at = np.clip(centres[:, group], self.lower[group], self.upper[group])
        low, high = ndtr((self.lower[group] - at) / std), ndtr((self.upper[group] - at) / std)
        level = low + rng.random(low.shape) * (high - low)
        step = std * ndtri(np.clip(level, _EDGE, 1.0 - _EDGE))
        return np.clip(at + step, self.lower[group], self.upper[group])

    def reach(self, centres: np.ndarray, weights: np.ndarray) -> Reach:
        """The distribution after one step from one of the centres (N, D), chosen by weights (N,) that sum to one."""
        return Reach(self, np.clip(centres, self.lower, self.upper), weights)

    def log_norms(self, at: np.ndarray, group: np.ndarray) -> np.ndarray:
        """Logarithms (N, 2) of how high short and long steps from at (N, G), inside of the box, are at their peaks, in
        the dimensions of a group."""
        out = np.empty((len(at), 2))
        for far, factor in enumerate((1.0, self.wide)):
            std = self.std[group] * factor
            each = self._log_inside(at, std, group) + np.log(std) + 0.5 * math.log(2.0 * math.pi)
            out[:, far] = math.log(max(self.share if far else 1.0 - self.share, 1e-300)) - each.sum(axis=1)
        return out

    def _log_inside(self, at: np.ndarray, std: np.ndarray, dims: np.ndarray) -> np.ndarray:
        """Logarithms (N, G) of the probability that a normal step from inside of the box stays there."""
        low, high = (self.lower[dims] - at) / std, (self.upper[dims] - at) / std
        # from a wall outwards half is lost: one of both sides holds at least that much, so nothing cancels badly
        return np.asarray(log_ndtr(high) + np.log1p(-np.minimum(np.exp(log_ndtr(low) - log_ndtr(high)), 1.0 - 1e-12)))


@dataclass(frozen=True, eq=False)
class Reach:
    """The density after a step from one of the centres (N, D), inside of the box, chosen by weights (N,)."""

    steps: TruncatedSteps
    centres: np.ndarray
    weights: np.ndarray

    @cached_property
    def _of_groups(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """For each group the centres (G, N) in standard deviations, and `TruncatedSteps.log_norms` (2, N)."""
        steps = self.steps
        return tuple(
            (
                np.ascontiguousarray((self.centres[:, group] / steps.std[group]).T),
                np.ascontiguousarray(steps.log_norms(self.centres[:, group], group).T),
            )
            for group in steps.groups
        )

    def log_density_each(self, points: np.ndarray, kernel: np.ndarray, group: int) -> np.ndarray:
        """Logarithms (M,) of the density, in the dimensions of a group, at points (M, D) inside of the box, of a step
        from the centre (M,) of each."""
        dims, (centres, log_norms) = self.steps.groups[group], self._of_groups[group]
        square = np.square(points[:, dims] / self.steps.std[dims] - centres.T[kernel]).sum(axis=1)
        short, far = log_norms[:, kernel]
        return np.asarray(np.logaddexp(short - 0.5 * square, far - 0.5 * square / self.steps.wide**2))

    def log_density(self, points: np.ndarray, group: int) -> np.ndarray:
        """Logarithms (M,) of the density, in the dimensions of a group, at points (M, D) inside of the box."""
        dims, (centres, log_norms) = self.steps.groups[group], self._of_groups[group]
        with np.errstate(divide="ignore"):
            log_heights = np.log(self.weights) + log_norms
        out = np.empty(len(points))
        _mixture(points[:, dims] / self.steps.std[dims], centres, log_heights, 1.0 / self.steps.wide**2, out)
        return out


@jit
def _mixture(points, centres, log_heights, narrow, out):  # type: ignore[no-untyped-def]
    """Fill out (M,) with the logarithms of a mixture at points (M, G), of kernels at centres (G, N).

    Both in standard deviations. log_heights (2, N): of each kernel's short and long steps at its peak. narrow: inverse
    square of how much longer a long step is.
    """
    count = centres.shape[1]
    value = np.empty((2, count))
    for m in range(points.shape[0]):
        value[0] = 0.0
        for d in range(points.shape[1]):
            point = points[m, d]
            for n in range(count):
                value[0, n] += (point - centres[d, n]) ** 2
        highest = -np.inf
        for n in range(count):
            square = 0.5 * value[0, n]
            value[0, n], value[1, n] = log_heights[0, n] - square, log_heights[1, n] - narrow * square
            highest = max(highest, value[0, n], value[1, n])
        total = 0.0
        for k in range(2):
            for n in range(count):
                if value[k, n] > highest - _COUNTS:
                    total += math.exp(value[k, n] - highest)
        out[m] = highest + math.log(total) if total > 0.0 else -np.inf
