"""Which points of two outlines belong together: compiled kernels."""

from __future__ import annotations

import numpy as np

from estimator.prediction.visibility import OUTER
from humanoid.support.compiled import jit


@jit
def nearest_outline(pixels, state, nearest, chosen):  # type: ignore[no-untyped-def]
    """For each OUTER contour point the index of the boundary pixel nearest to it, -1 for others; fills chosen (M,).

    pixels (M, 2) [px], state (M,). nearest (H, W): for every pixel, the index of the boundary pixel nearest to it.
    """
    height, width = nearest.shape
    for i in range(pixels.shape[0]):
        chosen[i] = -1
        if state[i] == OUTER:
            x, y = int(pixels[i, 0] + 0.5), int(pixels[i, 1] + 0.5)
            chosen[i] = nearest[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]


@jit
def nearest_contour(samples, sample_normals, pixels, normals, state, turn, chosen):  # type: ignore[no-untyped-def]
    """For each boundary sample the index of the OUTER contour point nearest in place and direction: chosen (S,).

    samples, sample_normals (S, 2); pixels, normals (M, 2) and state (M,): of the contour points [px].
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
