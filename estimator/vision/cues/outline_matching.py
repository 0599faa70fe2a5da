"""Which points of two outlines belong together: compiled kernels."""

from __future__ import annotations

import math

import numpy as np

from estimator.vision.visibility import OUTER
from humanoid.support.compiled import jit

_CELL = 0.6  # of `turn`: side of the cells in which contour points are searched for


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
    """For each boundary sample the index of the OUTER contour point nearest in place and direction: `chosen` (S,).

    samples, sample_normals (S, 2); pixels, normals (M, 2), state (M,): of the contour points. turn [px]: a normal at a
    right angle counts like this distance. Of points equally near the first is taken; -1 where there is none.
    """
    chosen[:] = -1
    outer = np.flatnonzero(state == OUTER)
    if len(outer) == 0:
        return
    cell = max(_CELL * turn, 2.0)
    left, top, columns, rows, first, order = sorted_by_cell(pixels[outer, 0], pixels[outer, 1], cell)
    outer = outer[order]
    x, y, nx, ny = pixels[outer, 0], pixels[outer, 1], normals[outer, 0], normals[outer, 1]
    for s in range(samples.shape[0]):
        u, v, nu, nv = samples[s, 0], samples[s, 1], sample_normals[s, 0], sample_normals[s, 1]
        column, row = math.floor((u - left) / cell), math.floor((v - top) / cell)
        best, nearest, reach, everywhere = np.inf, len(state), 0, False
        # what lies further off in the image than the best counts more than it, whatever its direction
        while not everywhere and best >= 0.999 * (reach * cell) ** 2:
            reach = max(1, 2 * reach)
            start, stop = min(max(column - reach, 0), columns), min(max(column + reach + 1, 0), columns)
            lowest, highest = max(row - reach, 0), min(row + reach + 1, rows)
            for r in range(lowest, highest):
                for i in range(first[r * columns + start], first[r * columns + stop]):
                    dx, dy = u - x[i], v - y[i]
                    far = (dx * dx + dy * dy) + (1.0 - nu * nx[i] - nv * ny[i]) * turn * turn
                    if (far < best) | ((far == best) & (outer[i] < nearest)):
                        best, nearest = far, outer[i]
            everywhere = stop - start == columns and highest - lowest == rows
        chosen[s] = nearest


@jit
def sorted_by_cell(x, y, cell):  # type: ignore[no-untyped-def]
    """Points x, y (N,) sorted into square cells of an image: left and top of the first cell, how many columns and rows
    there are, where the points of each cell start in the order, row by row (columns rows + 1,), and the order (N,)."""
    left, top = x.min(), y.min()
    columns, rows = int((x.max() - left) / cell) + 1, int((y.max() - top) / cell) + 1
    place, start = np.empty(len(x), np.int64), np.zeros(columns * rows + 2, np.int64)
    for i in range(len(x)):
        place[i] = int((y[i] - top) / cell) * columns + int((x[i] - left) / cell)
        start[place[i] + 2] += 1
    for c in range(2, len(start)):
        start[c] += start[c - 1]
    order = np.empty(len(x), np.int64)
    for i in range(len(x)):
        order[start[place[i] + 1]] = i
        start[place[i] + 1] += 1
    return left, top, columns, rows, start[:-1], order
