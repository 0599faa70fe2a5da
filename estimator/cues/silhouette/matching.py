"""Which points of two outlines belong together: compiled kernels."""

from __future__ import annotations

import numpy as np

from estimator.prediction.visibility import OUTER
from humanoid.support.compiled import jit


@jit
def nearest_outline(pixels, state, nearest, chosen):  # type: ignore[no-untyped-def]
    """For each OUTER contour point the index of the boundary pixel nearest to it, -1 for others; fills chosen (M,)."""
    height, width = nearest.shape
    for i in range(pixels.shape[0]):
        chosen[i] = -1
        if state[i] == OUTER:
            x, y = int(pixels[i, 0] + 0.5), int(pixels[i, 1] + 0.5)
            chosen[i] = nearest[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]


@jit
def across_outline(points, places, boundary, normal, trust, precision, each, kind, nu):  # type: ignore[no-untyped-def]
    """Assignments of boundary pixels `places` (N,) to contour points `points` (N,), measured across the outline; where
    one of the two is negative there is none.

    boundary, normal (B, 2), trust (B,): of the boundary pixels. precision [1/px^2]; each: weight where trust is 1.
    Returns point (A,), target (A, 2), precision (A, 3), weight, kind and nu (A,) as in `Assignments`.
    """
    count = np.count_nonzero((points >= 0) & (places >= 0))
    point, target, W, weight = np.empty(count, np.int64), np.empty((count, 2)), np.empty((count, 3)), np.empty(count)
    a = 0
    for i in range(points.shape[0]):
        k = places[i]
        if k >= 0 and points[i] >= 0:
            x, y = normal[k, 0], normal[k, 1]
            point[a], target[a, 0], target[a, 1] = points[i], boundary[k, 0], boundary[k, 1]
            W[a, 0], W[a, 1], W[a, 2] = x * x * precision, x * y * precision, y * y * precision
            weight[a] = each * trust[k]
            a += 1
    return point, target, W, weight, np.full(count, kind), np.full(count, nu)


@jit
def nearest_contour(samples, sample_normals, pixels, normals, state, turn, chosen):  # type: ignore[no-untyped-def]
    """For each boundary sample (S, 2) the index of the OUTER contour point nearest in place and direction: `chosen`.

    turn [px]: a normal at a right angle counts like this distance.
    """
    outer = np.flatnonzero(state == OUTER)
    x, y, nx, ny = pixels[outer, 0], pixels[outer, 1], normals[outer, 0], normals[outer, 1]
    near, far = np.empty(len(outer)), np.empty(len(outer))
    for s in range(samples.shape[0]):
        u, v, nu, nv = samples[s, 0], samples[s, 1], sample_normals[s, 0], sample_normals[s, 1]
        for i in range(far.size):  # no branch in it, so that it is done several points at a time
            dx, dy = u - x[i], v - y[i]
            near[i] = dx * dx + dy * dy
            far[i] = near[i] + (1.0 - nu * nx[i] - nv * ny[i]) * turn * turn
        best, chosen[s] = np.inf, -1
        for i in range(far.size):
            if (near[i] < best) & (far[i] < best):
                best, chosen[s] = far[i], outer[i]
