"""Products of kernels, one of each mixture: which ones go together (labels), and the normal density they make.

In R^n all this is exact. Rotations are treated to first order, at the mean of the product.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.inference.beliefs.mixture import CUT, KernelMixture, kernel_exponent, placement_exponent
from estimator.inference.beliefs.space import Space
from estimator.numerics.linear import solve_definite
from estimator.numerics.rotations import difference, moved, transport
from humanoid.support.compiled import jit

_STEPS = 3  # of Gauss and Newton towards the mean of a product, where there are rotations


@dataclass(frozen=True)
class Stacked:
    """The kernels of D mixtures behind each other: those of mixture i are start[i] to start[i + 1].

    start (D + 1,) int. log_weight (T,), mean (T, size), shape (T,) int. covariance, whitener, precision (C, dims,
    dims), constant, reach (C,).
    """

    space: Space
    start: np.ndarray
    log_weight: np.ndarray
    mean: np.ndarray
    shape: np.ndarray
    covariance: np.ndarray
    whitener: np.ndarray
    precision: np.ndarray
    constant: np.ndarray
    reach: np.ndarray

    @staticmethod
    def of(mixtures: Sequence[KernelMixture]) -> Stacked:
        """The stacked mixtures of one space; backgrounds count as kernels."""
        plain = [m.of_kernels_alone() for m in mixtures]
        first = np.cumsum([0, *(len(m.shapes) for m in plain)])
        whitener = np.concatenate([m.shapes.whitener for m in plain])
        return Stacked(
            plain[0].space,
            np.cumsum([0, *map(len, plain)]),
            np.concatenate([m.log_weight for m in plain]),
            np.concatenate([m.mean for m in plain]),
            np.concatenate([m.shape + f for m, f in zip(plain, first, strict=False)]),
            np.concatenate([m.shapes.covariance for m in plain]),
            whitener,
            whitener.transpose(0, 2, 1) @ whitener,
            np.concatenate([m.shapes.constant for m in plain]),
            np.concatenate([m.shapes.reach for m in plain]),
        )

    def labels_at(self, rng: np.random.Generator, points: np.ndarray) -> np.ndarray:
        """A kernel of each mixture (N, D) int, drawn by its share of the mixture's density at each point (N, size)."""
        labels = np.empty((len(points), len(self.start) - 1), dtype=np.int64)
        uniform = rng.random(labels.shape)
        space = self.space
        _labels_at(
            space.n, space.turns, np.ascontiguousarray(points), self.start, self.log_weight, self.mean, self.shape,
            self.whitener, self.constant, self.reach, uniform, labels,
        )  # fmt: skip
        return labels

    def products(self, labels: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The normal densities that the labelled kernels of some mixtures make together.

        labels (N, D) int; used (N, D) bool: of which mixtures, of at least one each. Returns means (N, size),
        covariances (N, dims, dims) and logarithms (N,) of their weights: those of the kernels and how well these agree.
        """
        count, space = len(labels), self.space
        mean, covariance = np.empty((count, space.size)), np.empty((count, space.dims, space.dims))
        log_weight = np.empty(count)
        _products(
            space.n, space.turns, labels, used, self.log_weight, self.mean, self.shape, self.precision, self.constant,
            mean, covariance, log_weight,
        )  # fmt: skip
        return mean, covariance, log_weight

    def gibbs(self, rng: np.random.Generator, count: int, sweeps: int) -> np.ndarray:
        """Labels (count, D) by Gibbs sampling (Sudderth et al. 2003): each drawn given the others, sweep by sweep.

        The first labels are drawn one after the other, each given those before it.
        """
        labels = np.zeros((count, len(self.start) - 1), dtype=np.int64)
        uniform = rng.random((count, sweeps + 1, labels.shape[1]))
        _gibbs(
            self.space.n, self.space.turns, self.start, self.log_weight, self.mean, self.shape, self.covariance,
            self.precision, uniform, labels,
        )  # fmt: skip
        return labels


@jit
def _labels_at(  # type: ignore[no-untyped-def]
    n, turns, points, start, log_weight, mean, shape, whitener, constant, reach, uniform, labels
):
    """Fill labels (N, D) int at points (N, size): see `Stacked.labels_at`. start (D + 1,) int, log_weight (T,), mean
    (T, size), shape (T,) int, whitener (C, d, d), constant, reach (C,), uniform (N, D)."""
    e = np.empty(n + 3 * turns)
    value = np.empty(len(log_weight))
    for i in range(len(points)):
        for j in range(len(start) - 1):
            highest = -math.inf
            for k in range(start[j], start[j + 1]):
                c = shape[k]
                value[k] = log_weight[k] + constant[c]
                square = 0.0
                for a in range(n):
                    square += (points[i, a] - mean[k, a]) ** 2
                if not value[k] - 0.5 * square * reach[c] > highest - CUT:
                    value[k] = -math.inf
                elif turns and n == 3:
                    half, factor = placement_exponent(points, i, mean, k, whitener, c, value[k] - highest + CUT)
                    value[k] = value[k] - half + math.log(factor) if factor > 0.0 else -math.inf
                else:
                    value[k] += kernel_exponent(n, turns, mean[k], points[i], whitener[c], e)
                highest = max(highest, value[k])
            labels[i, j] = _draw_index(value, start[j], start[j + 1], highest, uniform[i, j])


@jit
def _draw_index(value, first, end, highest, uniform):  # type: ignore[no-untyped-def]
    """An index from first to end, drawn in proportion to exp(value (T,))."""
    total = 0.0
    for k in range(first, end):
        value[k] = math.exp(value[k] - highest) if value[k] > highest - CUT else 0.0
        total += value[k]
    rest = uniform * total
    last = first
    for k in range(first, end):
        if value[k] > 0.0:
            last = k
            rest -= value[k]
            if rest < 0.0:
                break
    return last


@jit
def _normal_product(  # type: ignore[no-untyped-def]
    n, turns, labels, used, mean, shape, precision, x, information, pull, e, A, B, L, rows
):
    """Lead x (size,) to the mean of the product of the kernels labels (D,) int of the mixtures used (D,) bool; fill
    information (d, d) in the tangent there and its factor L (d, d).

    mean (T, size), shape (T,) int, precision (C, d, d). Room: pull, e (d,), A, B (d, d). rows (d,) int: 0 to d - 1.
    """
    d = n + 3 * turns
    has_start = False
    for _ in range(_STEPS if turns else 1):
        information[:] = 0.0
        pull[:] = 0.0
        for j in range(len(labels)):
            if not used[j]:
                continue
            k = labels[j]
            if not has_start:
                x[:] = mean[k]
                has_start = True
            P = precision[shape[k]]
            difference(n, turns, mean[k], x, e)
            if not turns:
                for a in range(d):
                    for b in range(d):
                        information[a, b] += P[a, b]
                        pull[a] -= P[a, b] * e[b]
                continue
            transport(n, turns, e, mean[k], x, A)
            for a in range(d):
                for b in range(d):
                    t = 0.0
                    for c in range(d):
                        t += P[a, c] * A[c, b]
                    B[a, b] = t
            for a in range(d):
                for b in range(d):
                    t = 0.0
                    for c in range(d):
                        t += A[c, a] * B[c, b]
                    information[a, b] += t
                    pull[a] -= B[b, a] * e[b]
        solve_definite(information, rows, d, 1e-300, L, pull)
        moved(n, turns, x.copy(), pull, x)
        largest = 0.0
        for a in range(d):
            largest = max(largest, abs(pull[a]))
        if largest < 1e-6:
            break


@jit
def _inverse_of(L, d, out):  # type: ignore[no-untyped-def]
    """Fill out (d, d) with the inverse of L L', L (d, d) lower triangular."""
    for column in range(d):
        for a in range(d):
            t = 1.0 if a == column else 0.0
            for b in range(a):
                t -= L[a, b] * out[b, column]
            out[a, column] = t / L[a, a]
        for a in range(d - 1, -1, -1):
            t = out[a, column]
            for b in range(a + 1, d):
                t -= L[b, a] * out[b, column]
            out[a, column] = t / L[a, a]


@jit
def _products(  # type: ignore[no-untyped-def]
    n, turns, labels, used, log_weight, mean, shape, precision, constant, x, covariance, out
):
    """See `Stacked.products`: labels (N, D) int, used (N, D) bool, log_weight (T,), mean (T, size), shape (T,) int,
    precision (C, d, d), constant (C,) -> x (N, size), covariance (N, d, d), out (N,)."""
    d = n + 3 * turns
    information, A, B, L = np.empty((d, d)), np.empty((d, d)), np.empty((d, d)), np.empty((d, d))
    pull, e, rows = np.empty(d), np.empty(d), np.arange(d)
    for i in range(len(labels)):
        _normal_product(n, turns, labels[i], used[i], mean, shape, precision, x[i], information, pull, e, A, B, L, rows)
        _inverse_of(L, d, covariance[i])
        out[i] = 0.5 * d * math.log(2.0 * math.pi)
        for a in range(d):
            out[i] -= math.log(L[a, a])
        for j in range(labels.shape[1]):
            if used[i, j]:
                k = labels[i, j]
                difference(n, turns, mean[k], x[i], e)
                out[i] += log_weight[k] + constant[shape[k]]
                for a in range(d):
                    for b in range(d):
                        out[i] -= 0.5 * e[a] * precision[shape[k], a, b] * e[b]


@jit
def _gibbs(n, turns, start, log_weight, mean, shape, covariance, precision, uniform, labels):  # type: ignore[no-untyped-def]
    """Fill labels (N, D) int by Gibbs sampling, see `Stacked.gibbs`. start (D + 1,) int, log_weight (T,), mean (T,
    size), shape (T,) int, covariance, precision (C, d, d), uniform (N, sweeps + 1, D)."""
    d, D = n + 3 * turns, len(start) - 1
    information, A, B, L = np.empty((d, d)), np.empty((d, d)), np.empty((d, d)), np.empty((d, d))
    rest, S = np.empty((d, d)), np.empty((d, d))
    x, pull, e, rows, value = np.empty(mean.shape[1]), np.empty(d), np.empty(d), np.arange(d), np.empty(len(log_weight))
    used = np.empty(D, dtype=np.bool_)
    spread = np.empty(len(covariance))  # at least the largest variance of the translation
    for c in range(len(covariance)):
        spread[c] = 0.0
        for a in range(n):
            spread[c] += covariance[c, a, a]
    for i in range(labels.shape[0]):
        for sweep in range(uniform.shape[1]):
            for j in range(D):
                for m in range(D):
                    used[m] = m != j if sweep > 0 else m < j
                alone = D == 1 or (sweep == 0 and j == 0)
                wide, tight = 0.0, 0.0
                if not alone:
                    _normal_product(
                        n, turns, labels[i], used, mean, shape, precision, x, information, pull, e, A, B, L, rows
                    )
                    _inverse_of(L, d, rest)
                    for a in range(n):
                        wide += rest[a, a]
                    # minus half the logarithm of the determinant of rest
                    for a in range(d):
                        tight += math.log(L[a, a])
                highest = -math.inf
                for k in range(start[j], start[j + 1]):
                    c = shape[k]
                    value[k] = log_weight[k]
                    if not alone:
                        value[k] = _agreement(
                            n, turns, log_weight[k], mean[k], covariance[c], spread[c], x, rest, wide, tight, highest,
                            e, A, B, S, L, rows, pull,
                        )  # fmt: skip
                    highest = max(highest, value[k])
                labels[i, j] = _draw_index(value, start[j], start[j + 1], highest, uniform[i, sweep, j])


@jit
def _agreement(  # type: ignore[no-untyped-def]
    n, turns, log_weight, mean, covariance, spread, x, rest, wide, tight, highest, e, A, B, S, L, rows, pull
):
    """Log weight of a kernel, mean (size,), covariance (d, d), beside the normal density of mean x (size,), covariance
    rest (d, d), but for a constant; minus infinity where it is far below the highest one.

    spread, wide: traces of their translations' covariances. tight: minus half the logarithm of the determinant of rest,
    which is more than that of both. Room: e, pull (d,), A, B, S, L (d, d); rows (d,) int: 0 to
    d - 1.
    """
    d = n + 3 * turns
    square = 0.0
    for a in range(n):
        square += (x[a] - mean[a]) ** 2
    if n and log_weight + tight - 0.5 * square / (spread + wide) < highest - CUT:
        return -math.inf
    difference(n, turns, mean, x, e)
    if turns:
        transport(n, turns, e, mean, x, A)
        for a in range(d):
            for b in range(d):
                t = 0.0
                for c in range(d):
                    t += A[a, c] * rest[c, b]
                B[a, b] = t
        for a in range(d):
            for b in range(a + 1):
                t = covariance[a, b]
                for c in range(d):
                    t += B[a, c] * A[b, c]
                S[a, b] = t
    else:
        for a in range(d):
            for b in range(a + 1):
                S[a, b] = covariance[a, b] + rest[a, b]
    pull[:] = e
    solve_definite(S, rows, d, 1e-300, L, pull)
    value = log_weight
    for a in range(d):
        value -= 0.5 * e[a] * pull[a] + math.log(L[a, a])
    return value
