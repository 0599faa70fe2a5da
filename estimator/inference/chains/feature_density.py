"""Mixtures of normal densities over named points of an image, of which a kernel may say nothing of some."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from humanoid.support.errors import InputError

_LOG_2PI = float(np.log(2.0 * np.pi))
_LEAST = 1e-300  # of a share of a mixture


@dataclass(frozen=True, eq=False)
class FeatureDensity:
    """sum_k w_k N_k(F) over features F, each a point of the image [px].

    names (F,): of the features. log_weight (K,). known (K, F) bool: which features a kernel speaks of; it is 1 over all
    others, as a chain is of features that it does not predict (Taycher et al. 2004, section 3). mean (K, F, 2) [px].
    covariance (K, 2F, 2F) [px^2]: positive definite over what is known, anything over the rest.

    The weights need not sum to one: a product keeps its constant, which says how well its factors agree.
    """

    names: tuple[str, ...]
    log_weight: np.ndarray
    known: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def __post_init__(self) -> None:
        count, size = len(self.log_weight), len(self.names)
        shapes = (count, size), (count, size, 2), (count, 2 * size, 2 * size)
        arrays = self.known, self.mean, self.covariance
        if tuple(a.shape for a in arrays) != shapes or not count or len(set(self.names)) < size:
            raise InputError("feature density", "has arrays whose sizes do not fit each other, or a name twice")
        both = np.repeat(self.known, 2, axis=1)
        inside = np.where(both[:, :, None] & both[:, None, :], self.covariance, np.eye(2 * size))
        if not (_definite_each(inside) and np.isfinite(self.mean[self.known]).all()):
            remedy = "covariances are finite and positive definite"
            raise InputError("feature density", "has a kernel that is none", remedy=remedy)

    def dims(self, kernel: int) -> np.ndarray:
        """The numbers (D,) of the coordinates that a kernel speaks of, two for each feature."""
        return np.flatnonzero(np.repeat(self.known[kernel], 2))

    @property
    def weights(self) -> np.ndarray:
        """Shares (K,) of the kernels, which sum to one."""
        return np.asarray(np.exp(self.log_weight - np.logaddexp.reduce(self.log_weight)))

    @property
    def predicted(self) -> frozenset[str]:
        """The features that some kernel speaks of."""
        return frozenset(self.names[f] for f in np.flatnonzero(self.known.any(axis=0)))

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N,) of the sum at points (N, F, 2) [px]."""
        flat = points.reshape(len(points), -1)
        parts = np.empty((len(points), len(self.log_weight)))
        for k in range(len(self.log_weight)):
            dims = self.dims(k)
            parts[:, k] = self.log_weight[k]
            if len(dims):
                off = flat[:, dims] - self.mean[k].ravel()[dims]
                parts[:, k] += _log_normal(off, self.covariance[k][np.ix_(dims, dims)])
        return np.asarray(np.logaddexp.reduce(parts, axis=1))

    def marginal(self, names: Sequence[str]) -> FeatureDensity:
        """Over some of the features, in the order of `names`, the others integrated out."""
        index = [self.names.index(name) for name in names]
        dims = np.ravel([(2 * i, 2 * i + 1) for i in index]).astype(np.int64)
        covariance = self.covariance[:, dims][:, :, dims]
        return FeatureDensity(tuple(names), self.log_weight, self.known[:, index], self.mean[:, index], covariance)

    def over(self, names: Sequence[str]) -> FeatureDensity:
        """The same over these features, of which it says nothing where it had none."""
        missing = [name for name in names if name not in self.names]
        wide = FeatureDensity(
            (*self.names, *missing),
            self.log_weight,
            np.hstack([self.known, np.zeros((len(self.known), len(missing)), dtype=bool)]),
            np.concatenate([self.mean, np.zeros((len(self.mean), len(missing), 2))], axis=1),
            np.array([_grown(C, 2 * len(missing)) for C in self.covariance]),
        )
        return wide if wide.names == tuple(names) else wide.marginal(names)

    def times(self, other: FeatureDensity) -> FeatureDensity:
        """The product with another, over the features of both."""
        names = (*self.names, *(n for n in other.names if n not in self.names))
        left, right = self.over(names), other.over(names)
        pairs = [(i, j) for i in range(len(left.log_weight)) for j in range(len(right.log_weight))]
        made = [_kernel_product(left, i, right, j) for i, j in pairs]
        log_weight, known, mean, covariance = (np.array(a) for a in zip(*made, strict=True))
        return FeatureDensity(names, log_weight, known, mean, covariance)

    def without(self, names: Sequence[str]) -> FeatureDensity:
        """The same that says nothing of some features."""
        silent = np.array([name in names for name in self.names])
        return replace(self, known=self.known & ~silent)

    def reduced(self, most: int, least: float = 1e-6) -> FeatureDensity:
        """The heaviest kernels, at most so many and none with less than a share `least`; the sum keeps its weight."""
        if len(self.log_weight) == 1:
            return self
        share = self.weights
        kept = np.argsort(-share, kind="stable")[:most]
        kept = np.sort(kept[share[kept] >= min(least, share.max())])
        lost = np.logaddexp.reduce(self.log_weight) - np.logaddexp.reduce(self.log_weight[kept])
        return FeatureDensity(
            self.names, self.log_weight[kept] + lost, self.known[kept], self.mean[kept], self.covariance[kept]
        )

    def collapsed(self) -> FeatureDensity:
        """One kernel with the mean and covariance of the kernels that speak of each feature, and all the weight.

        A feature of which kernels with more than half of the weight say nothing is not spoken of.
        """
        share, size = self.weights, len(self.names)
        told = share @ self.known
        known = told > 0.5
        mean = np.zeros((size, 2))
        for f in np.flatnonzero(known):
            mean[f] = (share * self.known[:, f]) @ self.mean[:, f] / told[f]
        off = (self.mean - mean) * self.known[:, :, None]
        off = off.reshape(len(share), -1)
        both = np.repeat(self.known, 2, axis=1)
        pair = both[:, :, None] & both[:, None, :]
        mass = np.einsum("k,kij->ij", share, pair)
        second = np.einsum("k,kij->ij", share, np.where(pair, self.covariance + off[:, :, None] * off[:, None, :], 0.0))
        covariance = np.where(mass > 0.0, second / np.maximum(mass, _LEAST), 0.0)
        covariance = _definite(covariance, np.repeat(known, 2))
        return FeatureDensity(
            self.names, np.array([np.logaddexp.reduce(self.log_weight)]), known[None], mean[None], covariance[None]
        )

    def sample(self, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (count, F, 2) [px] and their kernels (count,); NaN where a kernel does not speak of a feature."""
        kernel = rng.choice(len(self.log_weight), size=count, p=self.weights)
        normal = rng.standard_normal((count, 2 * len(self.names)))
        points = np.full((count, 2 * len(self.names)), np.nan)
        for k in np.unique(kernel):
            rows, dims = np.flatnonzero(kernel == k), self.dims(int(k))
            factor = np.linalg.cholesky(self.covariance[k][np.ix_(dims, dims)]) if len(dims) else np.zeros((0, 0))
            points[np.ix_(rows, dims)] = self.mean[k].ravel()[dims] + normal[np.ix_(rows, dims)] @ factor.T
        return points.reshape(count, -1, 2), kernel


def gaussian(names: Sequence[str], mean: np.ndarray, covariance: np.ndarray) -> FeatureDensity:
    """One normal density: mean (F, 2) [px], covariance (2F, 2F) [px^2]."""
    return FeatureDensity(
        tuple(names), np.zeros(1), np.ones((1, len(names)), dtype=bool), np.asarray(mean)[None], covariance[None]
    )


def uniform(names: Sequence[str]) -> FeatureDensity:
    """What says nothing of any of the features."""
    size = len(names)
    return FeatureDensity(
        tuple(names), np.zeros(1), np.zeros((1, size), dtype=bool), np.zeros((1, size, 2)), np.eye(2 * size)[None]
    )


def product(densities: Sequence[FeatureDensity], names: Sequence[str], most: int = 50) -> FeatureDensity:
    """Of any number of densities, over `names`, with at most so many kernels after each factor."""
    result = uniform(names)
    for density in densities:
        result = result.times(density.over(names)).reduced(most)
    return result


def _grown(covariance: np.ndarray, more: int) -> np.ndarray:
    size = len(covariance)
    grown = np.eye(size + more)
    grown[:size, :size] = covariance
    return grown


def _log_normal(off: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Logarithms (N,) of a normal density at offsets (N, D) from its mean."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, off.T)
    return np.asarray(-0.5 * (np.square(white).sum(axis=0) + len(factor) * _LOG_2PI) - np.log(np.diag(factor)).sum())


def _kernel_product(
    left: FeatureDensity, i: int, right: FeatureDensity, j: int
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """log weight, known (F,), mean (F, 2) and covariance (2F, 2F) of the product of two kernels over equal features.

    What both speak of is combined by Kalman's update of the one by the other: nothing is inverted but the sum of both
    covariances, so that two kernels that contradict each other lose weight and nothing else.
    """
    m, C = left.mean[i].ravel().copy(), left.covariance[i].copy()
    a, b = left.dims(i), right.dims(j)
    both, new = np.intersect1d(a, b), np.setdiff1d(b, a)
    known = left.known[i] | right.known[j]
    weight = float(left.log_weight[i] + right.log_weight[j])
    other_m, other_C = right.mean[j].ravel(), right.covariance[j]
    # right as N(both) N(new | both): the first updates what left knows, the second adds what it does not
    if len(new):
        gain = np.linalg.solve(other_C[np.ix_(both, both)], other_C[np.ix_(both, new)]).T
        rest = other_C[np.ix_(new, new)] - gain @ other_C[np.ix_(both, new)]
    if len(both):
        S = C[np.ix_(both, both)] + other_C[np.ix_(both, both)]
        off = other_m[both] - m[both]
        weight += float(_log_normal(off[None], S)[0])
        K = np.linalg.solve(S, C[np.ix_(both, a)]).T
        m[a] = m[a] + K @ off
        C[np.ix_(a, a)] = C[np.ix_(a, a)] - K @ C[np.ix_(both, a)]
    if len(new):
        m[new] = other_m[new] + gain @ (m[both] - other_m[both])
        cross = C[np.ix_(a, both)] @ gain.T
        C[np.ix_(a, new)], C[np.ix_(new, a)] = cross, cross.T
        C[np.ix_(new, new)] = rest + gain @ C[np.ix_(both, both)] @ gain.T
    C = _definite(C, np.repeat(known, 2))
    return weight, known, m.reshape(-1, 2), C


def _definite(covariance: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Symmetric, and positive definite over what is known (D,) bool; the identity elsewhere."""
    dims = np.flatnonzero(known)
    result = np.eye(len(known))
    part = 0.5 * (covariance + covariance.T)[np.ix_(dims, dims)]
    if len(dims) and not _definite_each(part[None]):
        values, vectors = np.linalg.eigh(part)
        part = (vectors * np.maximum(values, max(float(values[-1]), 1e-12) * 1e-12)) @ vectors.T
        part = 0.5 * (part + part.T)
    result[np.ix_(dims, dims)] = part
    return result


def _definite_each(matrices: np.ndarray) -> bool:
    """Whether all of (K, D, D) are finite and positive definite."""
    if not np.isfinite(matrices).all():
        return False
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return False
    return True
