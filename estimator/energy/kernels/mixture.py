"""Compiled kernels of the learned mixture of poses."""

from __future__ import annotations

import math

import numpy as np

from estimator.energy.kernels.priors import STABILISER_NU as NU
from estimator.energy.kernels.records import MIXTURE, Record, record_of
from humanoid.support.compiled import jit

_NEGLIGIBLE = 1e-12  # a component's share of a pose below which it neither pulls nor bends


@jit
def mixture_energy(  # type: ignore[no-untyped-def]
    q, q_index, v_index, log_share, whiten, white_mean, precision, pull, log_background, rest, rest_precision,
    weight, exact, gradient, hessian,
):  # fmt: skip
    """-weight log(sum of the densities); adds its gradient (nv,) and hessian (nv, nv).

    q (nq,). q_index, v_index (D,): places of the D angles in q and in the tangent.
    log_share (K,): log of each Gaussian's height. whiten (T * K,): lower triangles of the inverse Cholesky factors of
    all of them, column by column, and white_mean (D * K,): what these make of the means; always the K numbers of one
    entry side by side, so that the loops run along many numbers. precision (K, T): lower triangles of T numbers, row by
    row, pull (K, D): precisions times means.
    log_background; rest (D,), rest_precision (D, 2), below and above it: of the background.
    """
    K, D = pull.shape
    log_density, white, angles = np.empty(K + 1), np.empty(D * K), q[q_index]
    _log_densities(angles, log_share, whiten, white_mean, log_background, rest, rest_precision, white, log_density)
    highest = log_density.max()
    share = np.exp(log_density - highest)
    total = share.sum()
    share /= total
    force, own, bend = np.zeros(D), np.empty(D), np.zeros(precision.shape[1])
    for k in range(K):
        if share[k] >= _NEGLIGIBLE:
            _add_to(bend, share[k], precision[k])
            _add_to(force, -share[k], pull[k])
    _add_product(bend, angles, force)
    _background(angles, share[K], rest, rest_precision, exact, own, bend)
    _add_to(force, share[K], own)
    if exact:
        _subtract_square(bend, share[K], own)
        own_pulls = _unwhitened(whiten, white, K, D)
        for k in range(K):
            if share[k] >= _NEGLIGIBLE:
                _subtract_square(bend, share[k], own_pulls[k])
        _subtract_square(bend, -1.0, force)
    n = 0
    for i in range(D):
        gradient[v_index[i]] += weight * force[i]
        for j in range(i):
            hessian[v_index[i], v_index[j]] += weight * bend[n]
            hessian[v_index[j], v_index[i]] += weight * bend[n]
            n += 1
        hessian[v_index[i], v_index[i]] += weight * bend[n]
        n += 1
    return -weight * (highest + math.log(total))


@jit
def mixture_values(  # type: ignore[no-untyped-def]
    q, q_index, log_share, whiten, white_mean, log_background, rest, rest_precision, weight, values
):
    """Fill values (N,) with those of `mixture_energy` at q (N, nq)."""
    log_density, white = np.empty(log_share.shape[0] + 1), np.empty(white_mean.shape[0])
    for n in range(q.shape[0]):
        angles = q[n][q_index]
        _log_densities(angles, log_share, whiten, white_mean, log_background, rest, rest_precision, white, log_density)
        highest = log_density.max()
        values[n] = -weight * (highest + math.log(np.exp(log_density - highest).sum()))


@jit
def _log_densities(  # type: ignore[no-untyped-def]
    angles, log_share, whiten, white_mean, log_background, rest, rest_precision, white, log_density
):
    """Fill log_density (K + 1,) at angles (D,): of the K Gaussians, then of the background; and white (D * K,), the
    angles as standard normal numbers of each Gaussian. The other arrays: see `mixture_energy`."""
    K, D = log_share.shape[0], angles.shape[0]
    log_density[K] = log_background
    for i in range(D):
        e = angles[i] - rest[i]
        log_density[K] -= 0.5 * NU * math.log1p(e * e * rest_precision[i, 1 if e > 0.0 else 0] / NU)
    white[:] = 0.0
    o = 0
    for j in range(D):
        tail = white[j * K :]
        _add_to(tail, angles[j], whiten[o : o + tail.shape[0]])
        o += tail.shape[0]
    _add_to(white, -1.0, white_mean)
    square = np.zeros(K)
    for i in range(D):
        row = white[i * K : i * K + K]
        for k in range(K):
            square[k] += row[k] * row[k]
    for k in range(K):
        log_density[k] = log_share[k] - 0.5 * square[k]


@jit
def _unwhitened(whiten, white, K, D):  # type: ignore[no-untyped-def]
    """The pull (K, D) of each of K Gaussians on D angles, the transpose of its whitening times what that makes of the
    angles: whiten (T * K,), white (D * K,), see `mixture_energy`."""
    pulls, sums, o = np.empty((K, D)), np.empty(K), 0
    for j in range(D):
        sums[:] = 0.0
        for i in range(j, D):
            column, row = whiten[o : o + K], white[i * K : i * K + K]
            for k in range(K):
                sums[k] += row[k] * column[k]
            o += K
        for k in range(K):
            pulls[k, j] = sums[k]
    return pulls


@jit
def _add_to(sums, factor, numbers):  # type: ignore[no-untyped-def]
    """Add factor times numbers (N,) to sums (N,)."""
    for n in range(sums.shape[0]):
        sums[n] += factor * numbers[n]


@jit
def _add_product(triangle, x, out):  # type: ignore[no-untyped-def]
    """Add to out (D,) the product of a symmetric matrix, given by its lower triangle (T,), with x (D,)."""
    n = 0
    for i in range(x.shape[0]):
        for j in range(i):
            out[i] += triangle[n] * x[j]
            out[j] += triangle[n] * x[i]
            n += 1
        out[i] += triangle[n] * x[i]
        n += 1


@jit
def _subtract_square(triangle, factor, x):  # type: ignore[no-untyped-def]
    """Subtract factor x x' of x (D,) from a symmetric matrix, given by its lower triangle (T,)."""
    n = 0
    for i in range(x.shape[0]):
        f = factor * x[i]
        for j in range(i + 1):
            triangle[n + j] -= f * x[j]
        n += i + 1


@jit
def _background(angles, share, rest, rest_precision, exact, own, bend):  # type: ignore[no-untyped-def]
    """Fill own (D,), the gradient of -log density of the background at angles (D,), and add its share of the curvature
    of single angles to the diagonal of the lower triangle bend (T,). The other arrays: see
    `mixture_energy`."""
    n = 0
    for i in range(rest.shape[0]):
        e = angles[i] - rest[i]
        precision = rest_precision[i, 1 if e > 0.0 else 0]
        slope = 1.0 / (1.0 + e * e * precision / NU)
        own[i] = precision * e * slope
        bending = 2.0 * slope * slope * e * e * precision / NU if exact else 0.0
        bend[n + i] += share * precision * (slope - bending)
        n += i + 1


def mixture_record(q_index: np.ndarray, v_index: np.ndarray, *arrays: np.ndarray | float) -> Record:
    """The term: the arguments of `mixture_energy` from q_index to weight."""
    return record_of(MIXTURE, [*np.shape(arrays[4]), q_index, v_index], arrays)


@jit
def recorded_mixture(integers, numbers, q, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """`mixture_energy` of a record's integers (I,) and numbers (F,)."""
    K, D = integers[0], integers[1]
    triangle = (D * (D + 1)) // 2
    size = K * triangle
    log_share, whiten, white_mean = numbers[:K], numbers[K : K + size], numbers[K + size : K + size + K * D]
    o = K + size + K * D
    precision, pull = numbers[o : o + K * triangle].reshape(K, triangle), numbers[o + K * triangle :]
    o += K * triangle + K * D
    rest, rest_precision = numbers[o + 1 : o + 1 + D], numbers[o + 1 + D : o + 1 + 3 * D].reshape(D, 2)
    return mixture_energy(
        q, integers[2 : 2 + D], integers[2 + D : 2 + 2 * D], log_share, whiten, white_mean, precision,
        pull[: K * D].reshape(K, D), numbers[o], rest, rest_precision, numbers[o + 1 + 3 * D], exact, gradient, hessian,
    )  # fmt: skip
