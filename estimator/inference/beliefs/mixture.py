"""Mixtures of kernels, and other densities that messages and proposals are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from estimator.inference.annealing import systematic
from estimator.inference.beliefs.shapes import Shapes, shapes_of
from estimator.inference.beliefs.space import TURNS_VOLUME, Space
from estimator.inference.clusters import mean_and_covariance
from estimator.numerics.rotations import difference, half_sine_ratio
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

CUT = 30.0
"""Nats: kernels this far below another are left out of a sum, all of them less than 1e-10 of it."""


class Density(Protocol):
    """A probability density over the points of a space, in the measure of `TURNS_VOLUME`; it integrates to 1."""

    @property
    def space(self) -> Space:
        """The space of its points."""
        ...

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N,) of the density at points (N, size)."""
        ...

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, size)."""
        ...

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (size,) and covariance (dims, dims) of a kernel that replaces it where only kernels are possible."""
        ...


@dataclass(frozen=True)
class UniformBox:
    """Even in a box, turned anyhow. low, high (n,) [m]."""

    space: Space
    low: np.ndarray
    high: np.ndarray

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """See `Density`; minus infinity outside."""
        inside = np.all((points[:, : self.space.n] >= self.low) & (points[:, : self.space.n] <= self.high), axis=1)
        volume = float(np.sum(np.log(self.high - self.low)))
        return np.where(inside, -volume - (math.log(TURNS_VOLUME) if self.space.turns else 0.0), -np.inf)

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """See `Density`."""
        places = rng.uniform(self.low, self.high, (count, self.space.n))
        if not self.space.turns:
            return places
        quaternion = rng.standard_normal((count, 4))  # a rotation like any other (Muller 1959)
        return np.concatenate([places, quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)], axis=1)

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Density`; rotations have a standard deviation of 2 rad."""
        mean = 0.5 * (self.low + self.high)
        variance = np.square(self.high - self.low) / 12.0
        if self.space.turns:
            mean, variance = np.append(mean, [0.0, 0.0, 0.0, 1.0]), np.append(variance, [4.0, 4.0, 4.0])
        return mean, np.diag(variance)


@dataclass(frozen=True)
class KernelMixture:
    """K kernels, each a normal density in the tangent space at its mean, and a background.

    log_weight (K,): of the kernels among themselves; their exponentials sum to 1. mean (K, size). shape (K,) int: of
    `shapes`. share: of the background in the whole, 0 where there is none.
    """

    log_weight: np.ndarray
    mean: np.ndarray
    shape: np.ndarray
    shapes: Shapes
    background: Density | None = None
    share: float = 0.0

    @property
    def space(self) -> Space:
        """The space of its points."""
        return self.shapes.space

    def __len__(self) -> int:
        return len(self.log_weight)

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Logarithms (N,) of the density at points (N, size). See `CUT`."""
        out = np.empty(len(points))
        space, shapes = self.space, self.shapes
        mixture_log_density(
            space.n, space.turns, np.ascontiguousarray(points), self.log_weight, self.mean, self.shape,
            shapes.whitener, shapes.constant, shapes.reach, out,
        )  # fmt: skip
        if self.background is None:
            return out
        return np.logaddexp(
            out + math.log1p(-self.share), self.background.log_density(points) + math.log(max(self.share, 1e-300))
        )

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, size) in no order: of every kernel as many as its weight gives, to within one."""
        if self.background is not None:
            behind = int(rng.binomial(count, self.share))
            points = np.concatenate([self.background.sample(rng, behind), self._of_kernels(rng, count - behind)])
        else:
            points = self._of_kernels(rng, count)
        return points[rng.permutation(count)]

    def _of_kernels(self, rng: np.random.Generator, count: int) -> np.ndarray:
        weight = np.exp(self.log_weight)
        kernel = systematic(rng, weight / weight.sum(), count)
        return self.space.moved(self.mean[kernel], tangents(rng, self.shapes, self.shape[kernel]))

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (size,) and covariance (dims, dims) of the kernels: the mixture as one."""
        weight = np.exp(self.log_weight)
        mean, between = mean_and_covariance(self.space, self.mean, weight)
        return mean, between + np.einsum("k,kij->ij", weight / weight.sum(), self.shapes.covariance[self.shape])

    def of_kernels_alone(self) -> KernelMixture:
        """The mixture with its background as the first kernel, by its moments; itself where there is none."""
        if self.background is None:
            return self
        mean, covariance = self.background.moments()
        log_weight = np.append(math.log(max(self.share, 1e-300)), self.log_weight + math.log1p(-self.share))
        shapes = self.shapes.with_more(shapes_of(self.space, covariance[None]))
        shape = np.append(len(self.shapes), self.shape)
        return KernelMixture(log_weight, np.concatenate([mean[None], self.mean]), shape, shapes)


def mixture_of(
    space: Space, mean: np.ndarray, covariance: np.ndarray, weight: np.ndarray | None = None
) -> KernelMixture:
    """A mixture of kernels of means (K, size) and covariances (K, dims, dims) or variances (K, dims), or (1, ...) of
    all.

    weight (K,): even without. Raises InputError where sizes differ, or weights are negative or all zero.
    """
    mean = np.ascontiguousarray(mean, dtype=float)
    if mean.ndim != 2 or mean.shape[1] != space.size or len(mean) == 0:
        raise InputError("means of kernels", f"are {mean.shape}", remedy=f"(K, {space.size})")
    weight = np.ones(len(mean)) if weight is None else np.asarray(weight, dtype=float)
    shapes = shapes_of(space, covariance)
    if len(shapes) not in (1, len(mean)):
        raise InputError("covariance", f"{len(shapes)} for {len(mean)} kernels")
    shape = np.zeros(len(mean), dtype=np.int64) if len(shapes) == 1 else np.arange(len(mean))
    return KernelMixture(log_shares(weight, len(mean)), mean, shape, shapes)


def log_shares(weight: np.ndarray, count: int) -> np.ndarray:
    """Logarithms (count,) of weights (count,) made to sum to 1; raises InputError where they cannot."""
    weight = np.asarray(weight, dtype=float)
    total = weight.sum()
    if weight.shape != (count,) or not np.all(weight >= 0.0) or not 0.0 < total < np.inf:
        raise InputError("weights", "have another number, or are negative, or are all zero", remedy=f"{count} shares")
    with np.errstate(divide="ignore"):
        logarithm: np.ndarray = np.log(weight / total)
    return logarithm


def tangents(rng: np.random.Generator, shapes: Shapes, shape: np.ndarray) -> np.ndarray:
    """Tangents (N, dims) drawn from shapes (N,), with rotation vectors below pi."""
    space = shapes.space
    drawn = np.empty((len(shape), space.dims))
    missing = np.arange(len(shape))
    while len(missing):
        normal = rng.standard_normal((len(missing), space.dims))
        drawn[missing] = np.einsum("nij,nj->ni", shapes.factor[shape[missing]], normal)
        far = np.linalg.norm(drawn[missing, space.n :], axis=1) >= np.pi
        missing = missing[far & space.turns]
    return drawn


@jit
def mixture_log_density(  # type: ignore[no-untyped-def]
    n, turns, points, log_weight, mean, shape, whitener, constant, reach, out
):
    """Logarithms out (N,) of a mixture's density at points (N, size); size = n + 4 * turns, dims = n + 3 * turns.

    log_weight (K,), mean (K, size), shape (K,) int; whitener (C, dims, dims), constant, reach (C,) as in `Shapes`.
    """
    if turns and n == 3:
        _placements_log_density(points, log_weight, mean, shape, whitener, constant, reach, out)
        return
    e = np.empty(n + 3 * turns)
    for i in range(len(points)):
        highest, total = -math.inf, 0.0
        lowest = -1e300
        for k in range(len(log_weight)):
            c = shape[k]
            top = log_weight[k] + constant[c]
            square = 0.0
            for a in range(n):
                e[a] = points[i, a] - mean[k, a]
                square += e[a] * e[a]
            if not top - 0.5 * square * reach[c] > lowest:
                continue
            if turns:
                top += kernel_exponent(n, turns, mean[k], points[i], whitener[c], e)
            else:
                for a in range(n):
                    t = 0.0
                    for b in range(a + 1):
                        t += whitener[c, a, b] * e[b]
                    top -= 0.5 * t * t
            if top > highest:
                total = total * math.exp(highest - top) + 1.0
                highest = top
                lowest = max(highest - CUT, -1e300)
            elif top > lowest:
                total += math.exp(top - highest)
        out[i] = highest + math.log(total) if total > 0.0 else -math.inf


@jit
def kernel_exponent(n, turns, mean, point, whitener, e):  # type: ignore[no-untyped-def]
    """Logarithm of a kernel's density at a point against that at its mean, both (n + 4 * turns,); whitener (d, d), e
    (d,) is filled with the tangent, d = n + 3 * turns.

    A rotation vector of size r at a mean covers (2 sin(r/2) / r)^2 of the measure, by which its density is divided.
    """
    difference(n, turns, mean, point, e)
    square = 0.0
    for a in range(len(e)):
        t = 0.0
        for b in range(a + 1):
            t += whitener[a, b] * e[b]
        square += t * t
    if turns:
        r = math.sqrt(e[n] ** 2 + e[n + 1] ** 2 + e[n + 2] ** 2)
        if r > 1e-6:
            return 2.0 * math.log(0.5 * r / math.sin(0.5 * r)) - 0.5 * square
    return -0.5 * square


@jit
def placement_exponent(points, i, mean, k, whitener, c, allowed):  # type: ignore[no-untyped-def]
    """Half the squared distance of placement i of points (N, 7) from kernel k of mean (K, 7), by whitener c (C, 6, 6),
    and the factor that the measure gives its density (see `kernel_exponent`); infinity and 0 where the former is more
    than allowed. Whole arrays are given, since a view of each row would take longer than the rest."""
    a0, a1, a2, a3 = mean[k, 3], mean[k, 4], mean[k, 5], mean[k, 6]
    x, y, z = points[i, 0] - mean[k, 0], points[i, 1] - mean[k, 1], points[i, 2] - mean[k, 2]
    u, v, w = 2.0 * (y * a2 - z * a1), 2.0 * (z * a0 - x * a2), 2.0 * (x * a1 - y * a0)
    x, y, z = x + a3 * u + v * a2 - w * a1, y + a3 * v + w * a0 - u * a2, z + a3 * w + u * a1 - v * a0
    e0 = whitener[c, 0, 0] * x
    e1 = whitener[c, 1, 0] * x + whitener[c, 1, 1] * y
    e2 = whitener[c, 2, 0] * x + whitener[c, 2, 1] * y + whitener[c, 2, 2] * z
    half = 0.5 * (e0 * e0 + e1 * e1 + e2 * e2)
    if not half < allowed:
        return math.inf, 0.0
    b0, b1, b2, b3 = points[i, 3], points[i, 4], points[i, 5], points[i, 6]
    u = a3 * b0 - a0 * b3 - a1 * b2 + a2 * b1
    v = a3 * b1 - a1 * b3 - a2 * b0 + a0 * b2
    w = a3 * b2 - a2 * b3 - a0 * b1 + a1 * b0
    ratio = half_sine_ratio(u, v, w, a3 * b3 + a0 * b0 + a1 * b1 + a2 * b2)
    u, v, w = ratio * u, ratio * v, ratio * w
    e0 = whitener[c, 3, 0] * x + whitener[c, 3, 1] * y + whitener[c, 3, 2] * z + whitener[c, 3, 3] * u
    e1 = (
        whitener[c, 4, 0] * x
        + whitener[c, 4, 1] * y
        + whitener[c, 4, 2] * z
        + whitener[c, 4, 3] * u
        + whitener[c, 4, 4] * v
    )
    e2 = whitener[c, 5, 0] * x + whitener[c, 5, 1] * y + whitener[c, 5, 2] * z
    e2 += whitener[c, 5, 3] * u + whitener[c, 5, 4] * v + whitener[c, 5, 5] * w
    return half + 0.5 * (e0 * e0 + e1 * e1 + e2 * e2), 0.25 * ratio * ratio


@jit
def _placements_log_density(points, log_weight, mean, shape, whitener, constant, reach, out):  # type: ignore[no-untyped-def]
    """`mixture_log_density` of placements: points (N, 7), log_weight (K,), mean (K, 7), shape (K,) int, whitener
    (C, 6, 6), constant, reach (C,), out (N,)."""
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        highest, total = -math.inf, 0.0
        lowest = -1e300
        for k in range(len(log_weight)):
            c = shape[k]
            top = log_weight[k] + constant[c]
            x, y, z = px - mean[k, 0], py - mean[k, 1], pz - mean[k, 2]
            if not top - 0.5 * (x * x + y * y + z * z) * reach[c] > lowest:
                continue
            half, factor = placement_exponent(points, i, mean, k, whitener, c, top - lowest)
            top -= half
            if top > highest:
                total = total * math.exp(highest - top) + factor
                highest = top
                lowest = max(highest - CUT, -1e300)
            elif top > lowest:
                total += factor * math.exp(top - highest)
        out[i] = highest + math.log(total) if total > 0.0 else -math.inf
