"""Steps of a pose that are led to seen features: Kalman's update of each step, one for every way to see them and every
length of a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from estimator.inference.chains.feature_density import FeatureDensity

_LOG_2PI = float(np.log(2.0 * np.pi))
_LEAST = 1e-12  # rad^2 or m^2


@dataclass(frozen=True, eq=False)
class LedSteps:
    """For each of N poses a mixture of E normal densities of D degrees of freedom: log_weight (N, E), which sum to one,
    mean (N, E, D), factor (N, E, D, D), lower triangular, of the covariance."""

    log_weight: np.ndarray
    mean: np.ndarray
    factor: np.ndarray

    def of(self, rows: np.ndarray) -> LedSteps:
        """Some of the poses, in a new order."""
        return LedSteps(self.log_weight[rows], self.mean[rows], self.factor[rows])

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Some of each, (N, count, D)."""
        level = np.cumsum(np.exp(self.log_weight), axis=1)
        picked = rng.random((len(level), count)) * level[:, -1:]
        kernel = np.minimum((level[:, None] < picked[..., None]).sum(axis=2), level.shape[1] - 1)
        rows = np.arange(len(level))[:, None]
        normal = rng.standard_normal((len(level), count, self.mean.shape[2]))
        return np.asarray(self.mean[rows, kernel] + np.einsum("nmij,nmj->nmi", self.factor[rows, kernel], normal))

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N, M) at points (N, M, D) of each."""
        inverse = np.linalg.inv(self.factor)
        norm = np.log(np.einsum("neii->nei", self.factor)).sum(axis=2) + 0.5 * points.shape[2] * _LOG_2PI
        white = np.einsum("neij,nemj->nemi", inverse, points[:, None] - self.mean[:, :, None])
        parts = (self.log_weight - norm)[..., None] - 0.5 * np.square(white).sum(axis=3)
        return np.asarray(np.logaddexp.reduce(parts, axis=1))


class Length(NamedTuple):
    """Steps of one length: their share, and standard deviation std (D,)."""

    share: float
    std: np.ndarray


def led_steps(
    centres: np.ndarray,
    lengths: Sequence[Length],
    told: FeatureDensity,
    predicted: np.ndarray,
    jacobian: np.ndarray,
) -> LedSteps:
    """Steps of some lengths from centres (N, D), given what is told of the features F that they move.

    predicted (N, F, 2) [px]: features at the centres, NaN where they have no image: nothing leads these. jacobian
    (N, F, 2, D): of the features. Each kernel of `told` is one normal density, exact where features are linear in the
    degrees of freedom; one that says nothing is the step as it is.
    """
    whole = np.isfinite(predicted).all(axis=(1, 2)) & np.isfinite(jacobian).all(axis=(1, 2, 3))
    at = np.where(whole[:, None, None], predicted, 0.0).reshape(len(centres), -1)
    H_all = np.where(whole[:, None, None, None], jacobian, 0.0).reshape(len(centres), -1, centres.shape[1])
    log_weight, means, covariances = [], [], []
    for length, k in product(lengths, range(len(told.log_weight))):
        dims, prior = told.dims(k), np.diag(np.square(length.std))
        H = H_all[:, dims]
        off = np.where(whole[:, None], told.mean[k].ravel()[dims] - at[:, dims], 0.0)
        S = H @ prior @ H.transpose(0, 2, 1) + told.covariance[k][np.ix_(dims, dims)]
        gain = np.linalg.solve(S, H @ prior).transpose(0, 2, 1)
        square = np.einsum("nd,nd->n", off, np.linalg.solve(S, off[..., None])[..., 0])
        share = told.log_weight[k] + np.log(length.share)
        log_weight.append(share - 0.5 * (square + np.linalg.slogdet(2.0 * np.pi * S)[1]))
        means.append(centres + np.einsum("nij,nj->ni", gain, off))
        C = prior - gain @ H @ prior
        covariances.append(0.5 * (C + C.transpose(0, 2, 1)) + _LEAST * np.eye(len(prior)))
    weights = np.stack(log_weight, axis=1)
    factor = np.linalg.cholesky(np.stack(covariances, axis=1))
    return LedSteps(weights - np.logaddexp.reduce(weights, axis=1)[:, None], np.stack(means, axis=1), factor)
