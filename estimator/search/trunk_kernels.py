"""Where the trunk may be by the features that it moves: Kalman's update of kernels about poses that are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.inference.chains.feature_density import FeatureDensity


@dataclass(frozen=True, eq=False)
class NormalMixture:
    """Equally likely normal densities: mean (K, D), covariance (K, D, D)."""

    mean: np.ndarray
    covariance: np.ndarray

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """(count, D)"""
        kernel = rng.integers(len(self.mean), size=count)
        factors = np.linalg.cholesky(self.covariance)
        normal = rng.standard_normal((count, self.mean.shape[1]))
        return np.asarray(self.mean[kernel] + np.einsum("nij,nj->ni", factors[kernel], normal))

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N,) at points (N, D)."""
        factors = np.linalg.cholesky(self.covariance)
        norm = np.log(np.einsum("kii->ki", factors)).sum(axis=1) + 0.5 * points.shape[1] * np.log(2.0 * np.pi)
        inverse = np.linalg.inv(factors)
        white = np.einsum("kij,nkj->nki", inverse, points[:, None] - self.mean)
        parts = -0.5 * np.square(white).sum(axis=2) - norm
        return np.asarray(np.logaddexp.reduce(parts, axis=1) - np.log(len(self.mean)))


def led_kernels(
    rng: np.random.Generator,
    centres: np.ndarray,
    std: np.ndarray,
    seen: FeatureDensity,
    predicted: np.ndarray,
    jacobian: np.ndarray,
) -> NormalMixture | None:
    """Kernels about centres (K, D) of standard deviation (D,), each led to one of the places where features may be.

    seen: of the features F, from which one kernel is drawn for each centre; it may say nothing of some. predicted
    (K, F, 2) [px]: features at the centres. jacobian (K, F, 2, D): of these. Kalman's update, linear about the centre.
    None where nothing is seen.
    """
    if not seen.known.any():
        return None
    means, covariances = [], []
    prior = np.diag(np.square(std))
    for k, which in enumerate(rng.choice(len(seen.log_weight), size=len(centres), p=seen.weights)):
        dims = seen.dims(int(which))
        if not len(dims):
            means.append(centres[k])
            covariances.append(prior)
            continue
        H = jacobian[k].reshape(-1, len(std))[dims]
        off = seen.mean[which].ravel()[dims] - predicted[k].ravel()[dims]
        S = H @ prior @ H.T + seen.covariance[which][np.ix_(dims, dims)]
        gain = np.linalg.solve(S, H @ prior).T
        means.append(centres[k] + gain @ off)
        C = prior - gain @ H @ prior
        covariances.append(0.5 * (C + C.T) + 1e-12 * np.eye(len(std)))
    return NormalMixture(np.array(means), np.array(covariances))
