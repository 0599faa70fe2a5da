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
def nearest_contour(samples, sample_normals, pixels, normals, state, turn, chosen):  # type: ignore[no-untyped-def]
    """For each boundary sample (S, 2) the index of the OUTER contour point nearest in place and direction: `chosen`.

    turn [px]: a normal at a right angle counts like this distance.
    """
    for s in range(samples.shape[0]):
        best, chosen[s] = np.inf, -1
        for i in range(pixels.shape[0]):
            if state[i] != OUTER:
                continue
            dx, dy = samples[s, 0] - pixels[i, 0], samples[s, 1] - pixels[i, 1]
            d = dx * dx + dy * dy
            if d >= best:
                continue
            d += (1.0 - sample_normals[s, 0] * normals[i, 0] - sample_normals[s, 1] * normals[i, 1]) * turn * turn
            if d < best:
                best, chosen[s] = d, i
