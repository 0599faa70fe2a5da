"""Random steps inside a box, most of them short, some long, with their exact density."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

from humanoid.support.compiled import jit

_EDGE = 1e-12  # of a probability: so near to 0 or 1 the inverse of the normal distribution is infinite


@dataclass(frozen=True)
class Steps:
    """Independent normal steps of each dimension (D), cut off at the walls of a box.

    The dimensions are in groups, and each group by itself now and then takes a step that is `wide` times as long, in
    all its dimensions: one arm may be elsewhere without the rest of the body.

    std (D,): of a short step, above 0. lower, upper (D,): of the box, infinite where it has no wall. groups: of all
    dimensions, each in one. share: of long steps. wide: by how much they are longer.
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

    def log_density(
        self, points: np.ndarray, centres: np.ndarray, weights: np.ndarray, groups: Sequence[int] | None = None
    ) -> np.ndarray:
        """Logarithms (M,) of the density at points (M, D), inside of the box, after a step from one of the centres
        (N, D), chosen by weights (N,) that sum to one.

        groups: numbers of those whose dimensions count, all unless given; the density is that of these dimensions.
        """
        chosen = [self.groups[k] for k in (range(len(self.groups)) if groups is None else groups)]
        dims = np.concatenate(chosen)
        member = np.repeat(np.arange(len(chosen)), [len(group) for group in chosen])
        at = np.clip(centres, self.lower, self.upper)
        scale = self.std[dims]
        log_norm = np.empty((len(centres), len(chosen), 2))
        for far, factor in enumerate((1.0, self.wide)):
            inside = self._log_inside(at[:, dims], scale * factor, dims)
            each = inside + np.log(scale * factor) + 0.5 * math.log(2.0 * math.pi)
            log_share = math.log(max(self.share if far else 1.0 - self.share, 1e-300))
            for k in range(len(chosen)):
                log_norm[:, k, far] = log_share - each[:, member == k].sum(axis=1)
        with np.errstate(divide="ignore"):
            log_weights = np.log(weights)
        out = np.empty(len(points))
        _mixture(np.ascontiguousarray(points[:, dims]) / scale, np.ascontiguousarray(at[:, dims]) / scale,
                 log_weights, log_norm, member, 1.0 / self.wide**2, out)  # fmt: skip
        return out

    def log_density_each(self, points: np.ndarray, centres: np.ndarray, group: np.ndarray) -> np.ndarray:
        """Logarithms (N,) of the density at points (N, G), inside of the box, of a step from a centre (N, G) each, in
        the dimensions of a group."""
        at = np.clip(centres, self.lower[group], self.upper[group])
        parts = np.empty((2, len(points)))
        for far, factor in enumerate((1.0, self.wide)):
            std = self.std[group] * factor
            each = -0.5 * np.square((points - at) / std) - self._log_inside(at, std, group)
            norm = np.log(std).sum() + 0.5 * len(group) * math.log(2.0 * math.pi)
            parts[far] = each.sum(axis=1) - norm + math.log(max(self.share if far else 1.0 - self.share, 1e-300))
        return np.asarray(np.logaddexp(parts[0], parts[1]))

    def _log_inside(self, at: np.ndarray, std: np.ndarray, dims: np.ndarray) -> np.ndarray:
        """Logarithms (N, G) of the probability that a normal step from inside of the box stays there."""
        low, high = (self.lower[dims] - at) / std, (self.upper[dims] - at) / std
        # from a wall outwards half is lost: one of both sides holds at least that much, so nothing cancels badly
        return np.asarray(log_ndtr(high) + np.log1p(-np.minimum(np.exp(log_ndtr(low) - log_ndtr(high)), 1.0 - 1e-12)))


@jit
def _mixture(points, centres, log_weights, log_norm, member, narrow, out):  # type: ignore[no-untyped-def]
    """Fill out (M,) with the logarithms of a mixture at points (M, G), of kernels at centres (N, G).

    Both in standard deviations. log_weights (N,). log_norm (N, K, 2): of each kernel's groups, short and long. member
    (G,): the group of each dimension. narrow: inverse square of how much longer a long step is.
    """
    count = log_norm.shape[1]
    square = np.empty(count)
    for m in range(points.shape[0]):
        highest, total = -np.inf, 0.0
        for n in range(centres.shape[0]):
            if log_weights[n] == -np.inf:
                continue
            square[:] = 0.0
            for d in range(points.shape[1]):
                off = points[m, d] - centres[n, d]
                square[member[d]] += off * off
            if count == 1:  # a sum of both, with the exponential only of what counts
                for long in range(2):
                    value = log_weights[n] + log_norm[n, 0, long] - 0.5 * square[0] * (narrow if long else 1.0)
                    if value > highest:
                        total = total * math.exp(highest - value) + 1.0
                        highest = value
                    elif value > highest - 40.0:
                        total += math.exp(value - highest)
                continue
            value = log_weights[n]
            for k in range(count):
                short, far = log_norm[n, k, 0] - 0.5 * square[k], log_norm[n, k, 1] - 0.5 * narrow * square[k]
                top = max(short, far)
                value += top + math.log1p(math.exp(min(short, far) - top))
            if value > highest:
                total = total * math.exp(highest - value) + 1.0
                highest = value
            elif value > highest - 40.0:
                total += math.exp(value - highest)
        out[m] = highest + math.log(total) if total > 0.0 else -np.inf
