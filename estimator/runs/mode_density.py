"""The density around one mode: a Gaussian within the joint limits, and exponentials along limits it leans on."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp, ndtr, ndtri

JITTER = 1e-12  # added to variances, so that factors exist
_OVERDRAW = 4  # samples made for each one kept


def log_around_mode(gap: np.ndarray, covariance: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """Log density (N,) of a mode at the tangents gap (N, nv) from it."""
    held = lean != 0.0
    free = ~held
    factor = np.linalg.cholesky(covariance[np.ix_(free, free)] + JITTER * np.eye(free.sum()))
    z = solve_triangular(factor, gap[:, free].T, lower=True)
    away = gap[:, held] / lean[held]
    logs = -0.5 * np.sum(z * z, axis=0) - np.log(np.diagonal(factor)).sum() - 0.5 * free.sum() * np.log(2.0 * np.pi)
    return np.asarray(logs - np.sum(np.maximum(away, 0.0), axis=1) - np.log(np.abs(lean[held])).sum())


def draw_around_mode(
    rng: np.random.Generator, count: int, covariance: np.ndarray, lean: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Tangents (count, nv) from a mode's Gaussian within low, high (nv,), and from its exponentials along limits.

    Coordinate by coordinate along the Cholesky factor, each from its truncated normal, then chosen by the
    probability that the truncations left out (Geweke 1991; Hajivassiliou and McFadden 1998).
    """
    factor = np.linalg.cholesky(covariance + JITTER * np.eye(len(lean)))
    steps, z = np.zeros((_OVERDRAW * count, len(lean))), np.zeros((_OVERDRAW * count, len(lean)))
    log_weight = np.zeros(len(steps))
    for i, scale in enumerate(np.diagonal(factor)):
        centre = z[:, :i] @ factor[i, :i]
        a, b = ndtr((low[i] - centre) / scale), ndtr((high[i] - centre) / scale)
        inside = np.maximum(b - a, 1e-12)
        z[:, i] = ndtri(np.clip(a + rng.random(len(z)) * inside, 1e-12, 1.0 - 1e-12))
        log_weight += np.log(inside)
        steps[:, i] = np.clip(centre + scale * z[:, i], low[i], high[i])
    chance = np.exp(log_weight - logsumexp(log_weight))
    chosen = steps[rng.choice(len(steps), size=count, p=chance)]
    along = rng.exponential(size=chosen.shape) * lean
    return np.where(lean == 0.0, chosen, np.clip(along, low, high))


def points_density(points: np.ndarray, weight: np.ndarray, means: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Density (N, L) of points (N, L, 3) under mixtures with means (K, L, 3) and Cholesky factors (K, L, 3, 3)."""
    inverse = np.linalg.inv(factors)
    scale = weight[:, None] * np.abs(np.linalg.det(inverse))
    total = np.zeros(points.shape[:2])
    for mean, whiten, peak in zip(means, inverse, scale, strict=True):
        z = (whiten @ (points - mean)[..., None])[..., 0]
        total += peak * np.exp(-0.5 * np.sum(z * z, axis=-1))
    return total
