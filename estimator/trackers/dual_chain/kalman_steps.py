"""Steps of a pose towards seen features: Kalman's update of each step, one for every way to see them and every
length of a step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.inference.chains.feature_density import FeatureDensity
from estimator.numerics.linear import solve_definite
from humanoid.support.compiled import jit

_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class KalmanSteps:
    """For each of N poses a mixture of E normal densities of D degrees of freedom: log_weight (N, E), which sum to one,
    mean (N, E, D), root (N, E, D, D), the lower triangular factor of the precision."""

    log_weight: np.ndarray
    mean: np.ndarray
    root: np.ndarray

    def of(self, rows: np.ndarray) -> KalmanSteps:
        """Some of the poses, in a new order."""
        return KalmanSteps(self.log_weight[rows], self.mean[rows], self.root[rows])

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Some of each, (N, count, D)."""
        level = np.cumsum(np.exp(self.log_weight), axis=1)
        picked = rng.random((len(level), count)) * level[:, -1:]
        kernel = np.minimum((level[:, None] < picked[..., None]).sum(axis=2), level.shape[1] - 1)
        points = rng.standard_normal((len(level), count, self.mean.shape[2]))
        _place(self.mean, self.root, kernel, points)
        return points

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N, M) at points (N, M, D) of each."""
        parts = np.empty((len(points), self.log_weight.shape[1], points.shape[1]))
        _log_densities(self.log_weight, self.mean, self.root, np.ascontiguousarray(points), parts)
        return np.asarray(np.logaddexp.reduce(parts, axis=1))


class Length(NamedTuple):
    """Steps of one length: their share, and standard deviation std (D,), above 0."""

    share: float
    std: np.ndarray


def kalman_steps(
    centres: np.ndarray,
    lengths: Sequence[Length],
    received: FeatureDensity,
    predicted: np.ndarray,
    jacobian: np.ndarray,
) -> KalmanSteps:
    """Steps of some lengths from centres (N, D), given the message about the features F that they move.

    predicted (N, F, 2) [px]: features at the centres, NaN where they have no image: nothing moves these. jacobian (N,
    F, 2, D): of the features. Each kernel of `received` is one normal density, exact where features are linear in the
    degrees of freedom; an uninformative one leaves the step as it is.
    """
    whole = np.isfinite(predicted).all(axis=(1, 2)) & np.isfinite(jacobian).all(axis=(1, 2, 3))
    at = np.where(whole[:, None, None], predicted, 0.0).reshape(len(centres), -1)
    H = np.where(whole[:, None, None, None], jacobian, 0.0).reshape(len(centres), -1, centres.shape[1])
    precision, height = received.precisions()
    (count, size), kernels, each = centres.shape, len(height), len(lengths)
    log_weight, mean = np.empty((count, each * kernels)), np.empty((count, each * kernels, size))
    root = np.empty((count, each * kernels, size, size))
    _update(
        centres, at, H, whole, np.array([length.std for length in lengths]),
        np.log([length.share for length in lengths]), received.mean.reshape(kernels, -1), precision,
        received.log_weight + height, log_weight, mean, root,
    )  # fmt: skip
    return KalmanSteps(log_weight - np.logaddexp.reduce(log_weight, axis=1)[:, None], mean, root)


@jit
def _update(  # type: ignore[no-untyped-def]
    centres, at, H, whole, std, log_share, means, precisions, heights, log_weight, mean, root
):
    """Fill log_weight (N, E), mean (N, E, D) and root (N, E, D, D), all lengths of one kernel after the other's.

    centres (N, D), at (N, P) [px] and H (N, P, D): where features are, and their derivatives; whole (N,): whether they
    have an image. std (L, D), log_share (L,): of steps. means (K, P) [px], precisions (K, P, P), heights (K,): of the
    message, the logarithms of kernels in their means.
    """
    count, size = centres.shape
    kernels, pixels = means.shape
    off, weighed, pull, g = np.empty(pixels), np.empty((pixels, size)), np.empty(size), np.empty(size)
    order = np.arange(size)
    for n in range(count):
        for k in range(kernels):
            for p in range(pixels):
                off[p] = means[k, p] - at[n, p] if whole[n] else 0.0
                for d in range(size):
                    weighed[p, d] = 0.0
                    for o in range(pixels):
                        weighed[p, d] += precisions[k, p, o] * H[n, o, d]
            square = 0.0
            for p in range(pixels):
                for o in range(pixels):
                    square += off[p] * precisions[k, p, o] * off[o]
            for a in range(size):
                pull[a] = 0.0
                for p in range(pixels):
                    pull[a] += weighed[p, a] * off[p]
            for length in range(std.shape[0]):
                e = length * kernels + k
                L = root[n, e]
                for a in range(size):
                    for b in range(size):
                        L[a, b] = 1.0 / (std[length, a] * std[length, a]) if a == b else 0.0
                        if b <= a:
                            for p in range(pixels):
                                L[a, b] += H[n, p, a] * weighed[p, b]
                g[:] = pull
                solve_definite(L, order, size, 0.0, L, g)
                rest = square  # what no step explains, and the volume that is left
                for a in range(size):
                    mean[n, e, a] = centres[n, a] + g[a]
                    rest += 2.0 * math.log(std[length, a] * L[a, a]) - pull[a] * g[a]
                log_weight[n, e] = log_share[length] + heights[k] - 0.5 * rest


@jit
def _back(L, x):  # type: ignore[no-untyped-def]
    """Solve L^T y = x in place of x (D,), L lower triangular (D, D)."""
    for a in range(x.shape[0] - 1, -1, -1):
        for b in range(a + 1, x.shape[0]):
            x[a] -= L[b, a] * x[b]
        x[a] /= L[a, a]


@jit
def _place(mean, root, kernel, points):  # type: ignore[no-untyped-def]
    """Turn standard normal points (N, M, D) into those of a kernel (N, M) each; mean (N, E, D), root (N, E, D, D)."""
    for n in range(points.shape[0]):
        for m in range(points.shape[1]):
            k = kernel[n, m]
            _back(root[n, k], points[n, m])
            points[n, m] += mean[n, k]


@jit
def _log_densities(log_weight, mean, root, points, parts):  # type: ignore[no-untyped-def]
    """Fill parts (N, E, M) with logarithms of each kernel's share of the density at points (N, M, D).

    log_weight (N, E), mean (N, E, D), root (N, E, D, D): of `KalmanSteps`.
    """
    count, kernels, size = mean.shape
    for n in range(count):
        for e in range(kernels):
            height = log_weight[n, e] - 0.5 * size * _LOG_2PI
            for a in range(size):
                height += math.log(root[n, e, a, a])
            for m in range(points.shape[1]):
                square = 0.0
                for b in range(size):
                    white = 0.0
                    for a in range(b, size):
                        white += root[n, e, a, b] * (points[n, m, a] - mean[n, e, a])
                    square += white * white
                parts[n, e, m] = height - 0.5 * square
