"""Mixtures of normal densities over named points of an image, in which a kernel may leave some points out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

_LOG_2PI = float(np.log(2.0 * np.pi))
_LEAST = 1e-300  # of a share of a mixture
_DOUBT = 30.0  # factor on the likely distance within which detections are considered
_ALIKE = 0.3  # standard deviations apart, and difference of their logarithms, of kernels that count as equal
_NOTHING = 40.0  # this far below the highest a kernel adds nothing


@dataclass(frozen=True, eq=False)
class FeatureDensity:
    """sum_k w_k N_k(F) over features F, each a point of the image [px].

    names (F,): of the features. log_weight (K,). known (K, F) bool: which features a kernel has; it is 1 over all
    others, like a chain over features that it does not predict (Taycher et al. 2004, section 3). mean (K, F, 2) [px].
    covariance (K, 2F, 2F) [px^2]: positive definite over what is known, anything over the rest. sharers (K, F) int:
    number of features that share the detection in which a kernel has a feature, itself included, 0 where in none; None
    for none.

    The weights need not sum to one: a product keeps its constant, which measures how well its factors agree.
    """

    names: tuple[str, ...]
    log_weight: np.ndarray
    known: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    sharers: np.ndarray | None = None

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
            raise InputError("feature density", "has an invalid kernel", remedy=remedy)

    def dims(self, kernel: int) -> np.ndarray:
        """The numbers (D,) of a kernel's coordinates, two for each feature."""
        return np.flatnonzero(np.repeat(self.known[kernel], 2))

    @property
    def weights(self) -> np.ndarray:
        """Shares (K,) of the kernels, which sum to one."""
        return np.asarray(np.exp(self.log_weight - np.logaddexp.reduce(self.log_weight)))

    @property
    def predicted(self) -> frozenset[str]:
        """The features that some kernel has."""
        return frozenset(self.names[f] for f in np.flatnonzero(self.known.any(axis=0)))

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N,) of the sum at points (N, F, 2) [px]."""
        out = np.empty(len(points))
        flat = np.ascontiguousarray(points.reshape(len(points), -1), dtype=np.float64)
        log_mixture(flat, self.mean.reshape(len(self.mean), -1), *self._whitening, out)
        return out

    @cached_property
    def _whitening(self) -> tuple[np.ndarray, np.ndarray]:
        """For each kernel the matrix (K, 2F, 2F), lower triangular, that makes offsets from its mean independent and
        normal, zero where it is uninformative, and the logarithm (K,) of its height."""
        inverse, height = np.zeros_like(self.covariance), self.log_weight.astype(np.float64)
        for rows, dims in kinds(self.known):
            block = np.ix_(rows, dims, dims)
            factor = np.linalg.cholesky(self.covariance[block])
            inverse[block] = np.linalg.inv(factor)
            height[rows] -= 0.5 * len(dims) * _LOG_2PI + np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        return inverse, height

    def precisions(self) -> tuple[np.ndarray, np.ndarray]:
        """The precision (K, 2F, 2F) [1/px^2] of each kernel, zero where it is uninformative, and the logarithm (K,) of
        its height at its mean with a weight of 1."""
        white, height = self._whitening
        return np.swapaxes(white, 1, 2) @ white, height - self.log_weight

    def marginal(self, names: Sequence[str]) -> FeatureDensity:
        """Over some of the features, in the order of `names`, the others integrated out."""
        index = [self.names.index(name) for name in names]
        dims = np.ravel([(2 * i, 2 * i + 1) for i in index]).astype(np.int64)
        covariance = self.covariance[:, dims][:, :, dims]
        sharers = None if self.sharers is None else self.sharers[:, index]
        return FeatureDensity(
            tuple(names), self.log_weight, self.known[:, index], self.mean[:, index], covariance, sharers
        )

    def over(self, names: Sequence[str]) -> FeatureDensity:
        """The same over these features, uninformative about those that it did not have."""
        if self.names == tuple(names):
            return self
        missing = [name for name in names if name not in self.names]
        wide = FeatureDensity(
            (*self.names, *missing),
            self.log_weight,
            np.hstack([self.known, np.zeros((len(self.known), len(missing)), dtype=bool)]),
            np.concatenate([self.mean, np.zeros((len(self.mean), len(missing), 2))], axis=1),
            _grown(self.covariance, 2 * len(missing)),
            None if self.sharers is None else np.pad(self.sharers, ((0, 0), (0, len(missing)))),
        )
        return wide if wide.names == tuple(names) else wide.marginal(names)

    def times(self, other: FeatureDensity) -> FeatureDensity:
        """The product with another, over the features of both."""
        names = (*self.names, *(n for n in other.names if n not in self.names))
        left, right = self.over(names), other.over(names)
        i, j = (n.ravel() for n in np.indices((len(left.log_weight), len(right.log_weight))))
        known = left.known[i] | right.known[j]
        log_weight, mean = left.log_weight[i] + right.log_weight[j], np.empty((len(i), len(names), 2))
        covariance = np.empty((len(i), 2 * len(names), 2 * len(names)))
        # kernels of the same features are multiplied at once
        for rows in alike(np.hstack([left.known[i], right.known[j]])):
            weight, mean[rows], covariance[rows] = _kernel_products(left, i[rows], right, j[rows])
            log_weight[rows] += weight
        some = [d.sharers[rows] for d, rows in ((left, i), (right, j)) if d.sharers is not None]
        sharers = np.maximum.reduce(some) if some else None
        return FeatureDensity(names, log_weight, known, mean, covariance, sharers)

    def if_hidden(self, hidden: np.ndarray, seen: float, missed: float) -> FeatureDensity:
        """The same for states that hide features (F,) bool: the log-weight of a kernel grows by `seen` for each of
        these with a detection of its own, and by `missed` for each without any, also where it is predicted."""
        alone = np.zeros_like(self.known) if self.sharers is None else self.sharers == 1
        without = ~self.known if self.sharers is None else self.sharers == 0
        more = seen * (alone & hidden).sum(axis=1) + missed * (without & hidden).sum(axis=1)
        return replace(self, log_weight=self.log_weight + more)

    def reduced(self, most: int, least: float = 1e-6, expected: FeatureDensity | None = None) -> FeatureDensity:
        """The heaviest kernels, at most a number and none with less than a share `least`; the sum keeps its weight.

        expected: over the same features, where kernels have different ones, so that their weights have different units:
        what counts is then their mass under it (`likeliest`).
        """
        if len(self.log_weight) == 1:
            return self
        heavy = heaviest(self.log_weight, most, least) if expected is None else self.likeliest(expected, most, least)
        log_mass = self.log_weight if expected is None else self.log_mass(expected)
        lost = np.logaddexp.reduce(log_mass) - np.logaddexp.reduce(log_mass[heavy])
        return self.of(heavy, self.log_weight[heavy] + lost)

    def likeliest(self, expected: FeatureDensity, most: int, least: float = 1e-6) -> np.ndarray:
        """The kernels (R,) with the largest masses under the prediction of the same features, then those with the
        largest under the same prediction with larger deviations; none with less than a share `least`."""
        heavy = heaviest(self.log_mass(expected), most, least)
        doubted = self.log_mass(expected.doubted())
        others = np.setdiff1d(heaviest(doubted, most, least), heavy)
        others = others[np.argsort(-doubted[others], kind="stable")]
        return np.sort([*heavy, *others][:most])

    def of(self, rows: np.ndarray, log_weight: np.ndarray | None = None) -> FeatureDensity:
        """Some of the kernels, with their own or other weights."""
        log_weight = self.log_weight[rows] if log_weight is None else log_weight
        sharers = None if self.sharers is None else self.sharers[rows]
        return FeatureDensity(self.names, log_weight, self.known[rows], self.mean[rows], self.covariance[rows], sharers)

    def log_mass(self, expected: FeatureDensity) -> np.ndarray:
        """Log-masses (K,) of the kernels under the prediction of the same features, as one kernel."""
        prior = expected.collapsed()
        both = np.repeat(self.known & prior.known[0], 2, axis=1)
        # all at once: a feature that one of them leaves out gets the expected distance, with a variance that adds
        # nothing
        off = np.where(both, (self.mean - prior.mean).reshape(both.shape), 0.0)
        pair = both[:, :, None] & both[:, None, :]
        covariance = np.where(pair, prior.covariance + self.covariance, np.eye(both.shape[1]))
        silent = both.shape[1] - both.sum(axis=1)
        return np.asarray(self.log_weight + (_log_normals(off, covariance) + 0.5 * _LOG_2PI * silent))

    def doubted(self) -> FeatureDensity:
        """The same with larger deviations, by which further detections are chosen: a chain with a wrong prediction must
        not ignore the evidence against it."""
        return self._doubted

    @cached_property
    def _doubted(self) -> FeatureDensity:
        return replace(self, covariance=_DOUBT**2 * self.covariance)

    def merged(self) -> FeatureDensity:
        """The heaviest of each group of nearly equal kernels, with the weight of the group. Such groups remain after
        features were integrated out."""
        distinct: list[int] = []
        weight = np.full(len(self.log_weight), -np.inf)
        for k in np.argsort(-self.log_weight, kind="stable"):
            same = next((other for other in distinct if self._alike(other, int(k))), None)
            if same is None:
                distinct.append(int(k))
            target = int(k) if same is None else same
            weight[target] = np.logaddexp(weight[target], self.log_weight[k])
        rows = np.sort(distinct)
        return self.of(rows, weight[rows])

    def _alike(self, a: int, b: int) -> bool:
        """Whether two kernels have the same features at about the same place with about the same spread."""
        if (self.known[a] != self.known[b]).any():
            return False
        dims = self.dims(a)
        off = (self.mean[a] - self.mean[b]).ravel()[dims]
        spread = [np.sqrt(np.diag(self.covariance[k])[dims]) for k in (a, b)]
        near = (np.abs(off) <= _ALIKE * np.minimum(*spread)).all()
        return bool(near and (np.abs(np.log(spread[0] / spread[1])) <= _ALIKE).all())

    def collapsed(self) -> FeatureDensity:
        """One kernel with the mean and covariance of the kernels that have each feature, and all the weight.

        A feature that kernels with more than half of the weight leave out is left out.
        """
        return self._collapsed

    @cached_property
    def _collapsed(self) -> FeatureDensity:
        share, size = self.weights, len(self.names)
        known_share = share @ self.known
        known = known_share > 0.5
        mean = np.zeros((size, 2))
        for f in np.flatnonzero(known):
            mean[f] = (share * self.known[:, f]) @ self.mean[:, f] / known_share[f]
        off = (self.mean - mean) * self.known[:, :, None]
        off = off.reshape(len(share), -1)
        both = np.repeat(self.known, 2, axis=1)
        pair = both[:, :, None] & both[:, None, :]
        mass = np.einsum("k,kij->ij", share, pair)
        second = np.einsum("k,kij->ij", share, np.where(pair, self.covariance + off[:, :, None] * off[:, None, :], 0.0))
        covariance = np.where(mass > 0.0, second / np.maximum(mass, _LEAST), 0.0)
        covariance = _definite(covariance[None], np.repeat(known, 2))
        return FeatureDensity(
            self.names, np.array([np.logaddexp.reduce(self.log_weight)]), known[None], mean[None], covariance
        )

    def sample(self, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (count, F, 2) [px] and their kernels (count,); NaN where a kernel does not have a feature."""
        kernel = rng.choice(len(self.log_weight), size=count, p=self.weights)
        normal = rng.standard_normal((count, 2 * len(self.names)))
        points = np.full((count, 2 * len(self.names)), np.nan)
        for k in np.unique(kernel):
            rows, dims = np.flatnonzero(kernel == k), self.dims(int(k))
            factor = np.linalg.cholesky(self.covariance[k][np.ix_(dims, dims)]) if len(dims) else np.zeros((0, 0))
            points[np.ix_(rows, dims)] = self.mean[k].ravel()[dims] + normal[np.ix_(rows, dims)] @ factor.T
        return points.reshape(count, len(self.names), 2), kernel


def gaussian(names: Sequence[str], mean: np.ndarray, covariance: np.ndarray) -> FeatureDensity:
    """One normal density: mean (F, 2) [px], covariance (2F, 2F) [px^2]."""
    return FeatureDensity(
        tuple(names), np.zeros(1), np.ones((1, len(names)), dtype=bool), np.asarray(mean)[None], covariance[None]
    )


def uniform(names: Sequence[str]) -> FeatureDensity:
    """A density that is uninformative about all features."""
    size = len(names)
    return FeatureDensity(
        tuple(names), np.zeros(1), np.zeros((1, size), dtype=bool), np.zeros((1, size, 2)), np.eye(2 * size)[None]
    )


def product(densities: Sequence[FeatureDensity], names: Sequence[str], most: int = 50) -> FeatureDensity:
    """Product of any number of densities, over `names`, with at most a number of kernels after each factor."""
    result = uniform(names)
    for density in densities:
        result = result.times(density.over(names)).reduced(most)
    return result


def _grown(covariance: np.ndarray, more: int) -> np.ndarray:
    """Covariances (K, D, D) extended by a number of dimensions of variance 1."""
    count, size = covariance.shape[:2]
    grown = np.tile(np.eye(size + more), (count, 1, 1))
    grown[:, :size, :size] = covariance
    return grown


def _kernel_products(
    left: FeatureDensity, i: np.ndarray, right: FeatureDensity, j: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """log weight (P,) beside those of the kernels, mean (P, F, 2) and covariance (P, 2F, 2F) of the products of kernels
    i and j (P,), all of which have the same features as the others on their side.

    What both have is combined by Kalman's update of the one by the other: nothing is inverted but the sum of both
    covariances, so that two kernels that contradict each other lose weight and nothing else.
    """
    count = len(i)
    m, C = left.mean[i].reshape(count, -1), left.covariance[i]
    ours, theirs = left.known[i[0]], right.known[j[0]]
    a, both, new = (np.flatnonzero(np.repeat(known, 2)) for known in (ours, ours & theirs, theirs & ~ours))
    weight = np.zeros(count)
    other_m, other_C = right.mean[j].reshape(count, -1), right.covariance[j]
    # right as N(both) N(new | both): the first updates the features of left, the second adds the others
    if len(new):
        cross = _block(other_C, both, new)
        gain = np.swapaxes(np.linalg.solve(_block(other_C, both, both), cross), 1, 2)
        rest = _block(other_C, new, new) - gain @ cross
    if len(both):
        S = _block(C, both, both) + _block(other_C, both, both)
        off = (other_m - m)[:, both, None]
        weight = _log_normals(off[..., 0], S)
        K = np.swapaxes(np.linalg.solve(S, _block(C, both, a)), 1, 2)
        m[:, a] += (K @ off)[..., 0]
        C[:, a[:, None], a] -= K @ _block(C, both, a)
    if len(new):
        m[:, new] = other_m[:, new] + (gain @ (m - other_m)[:, both, None])[..., 0]
        cross = _block(C, a, both) @ np.swapaxes(gain, 1, 2)
        C[:, a[:, None], new], C[:, new[:, None], a] = cross, np.swapaxes(cross, 1, 2)
        C[:, new[:, None], new] = rest + gain @ _block(C, both, both) @ np.swapaxes(gain, 1, 2)
    return weight, m.reshape(count, -1, 2), _definite(C, np.repeat(ours | theirs, 2))


def heaviest(log_mass: np.ndarray, most: int, least: float = 0.0) -> np.ndarray:
    """The kernels (R,) with the largest masses, in order of their numbers: at most a number of them, and none with less
    than a share `least` of all, unless all have."""
    share = np.exp(log_mass - np.logaddexp.reduce(log_mass))
    heavy = np.argsort(-share, kind="stable")[:most]
    return np.sort(heavy[share[heavy] >= min(least, share.max())])


def kinds(known: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Groups of kernels (R,) with the same features, known (K, F) bool, and the coordinates (D,) of these, to be
    computed at once. Kernels without features are left out."""
    for rows in alike(known):
        if known[rows[0]].any():
            yield rows, np.flatnonzero(np.repeat(known[rows[0]], 2))


def alike(known: np.ndarray) -> list[np.ndarray]:
    """The numbers of rows (N, F) bool that are equal, together."""
    rows: dict[bytes, list[int]] = {}
    for k, row in enumerate(known):
        rows.setdefault(row.tobytes(), []).append(k)
    return [np.array(numbers) for numbers in rows.values()]


def _block(matrices: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    return np.asarray(matrices[:, rows][:, :, columns])


def _log_normals(off: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Logarithms (P,) of normal densities, each at one offset (P, D) from its mean, with its covariance (P, D, D)."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, off[..., None])[..., 0]
    log_volume = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(-0.5 * (np.square(white).sum(axis=1) + off.shape[1] * _LOG_2PI) - log_volume)


def _definite(covariance: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Symmetric (P, D, D), and positive definite over what is known (D,) bool; the identity elsewhere."""
    dims = np.flatnonzero(known)
    result = np.tile(np.eye(len(known)), (len(covariance), 1, 1))
    part = _block(0.5 * (covariance + np.swapaxes(covariance, 1, 2)), dims, dims)
    if len(dims) and not _definite_each(part):
        values, vectors = np.linalg.eigh(part)
        least = np.maximum(values[:, -1:], 1e-12) * 1e-12
        part = (vectors * np.maximum(values, least)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        part = 0.5 * (part + np.swapaxes(part, 1, 2))
    result[:, dims[:, None], dims] = part
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


@jit
def log_mixture(points, means, inverse, height, out):  # type: ignore[no-untyped-def]
    """Fill out (N,) with the logarithms of a mixture of normal densities at points (N, D).

    means (K, D). inverse (K, D, D): the lower triangular inverses of the covariances' factors, zero in dimensions that
    a kernel does not have. height (K,): logarithms of the kernels in their means.
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
