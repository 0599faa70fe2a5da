"""The compiled part of `feature_density`."""

from __future__ import annotations

import math

from humanoid.support.compiled import jit

_NOTHING = 40.0  # so far below the highest a kernel adds nothing


@jit
def log_mixture(points, means, inverse, height, out):  # type: ignore[no-untyped-def]
    """Fill out (N,) with the logarithms of a mixture of normal densities at points (N, D).

    means (K, D). inverse (K, D, D): the lower triangular inverses of the covariances' factors, zero in dimensions that
    a kernel does not speak of. height (K,): logarithms of the kernels in their means.
    """
    size = points.shape[1]
    for n in range(points.shape[0]):
        highest, total = -math.inf, 0.0
        for k in range(means.shape[0]):
            square = 0.0
            for i in range(size):
                if inverse[k, i, i] == 0.0:
                    continue
                white = 0.0
                for j in range(i + 1):
                    if inverse[k, i, j] != 0.0:
                        white += inverse[k, i, j] * (points[n, j] - means[k, j])
                square += white * white
                if height[k] - 0.5 * square < highest - _NOTHING:
                    break
            value = height[k] - 0.5 * square
            if value > highest:
                total = total * math.exp(highest - value) + 1.0 if total > 0.0 else 1.0
                highest = value
            elif value > highest - _NOTHING:
                total += math.exp(value - highest)
        out[n] = highest + math.log(total) if total > 0.0 else -math.inf
