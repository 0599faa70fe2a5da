"""The gradient of a colour picture, normalised by the local contrast, and means of blocks: compiled."""

from __future__ import annotations

import math

import numpy as np

from humanoid.support.compiled import jit


@jit
def normalised_gradient(planes, variance, floor, scale):  # type: ignore[no-untyped-def]
    """Strength (H, W) and direction (H, W, 2) of edges, both float32, see
    `estimator.vision.cues.edges.edge_map.EdgeMap`.

    planes (C, H, W) float32: the channels, which are reflected at the border. variance (H, W) float32: local contrast,
    squared, to which `floor` (float32) is added. scale (float32): strength of the slope 1 at the contrast 1.
    Sobel's derivatives [1/px]; each pixel has those of the channel in which they are largest.
    """
    height, width = variance.shape
    strength, direction = np.empty((height, width), np.float32), np.empty((height, width, 2), np.float32)
    best, best_x, best_y = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    down, level = np.empty(width, np.float32), np.empty(width, np.float32)
    zero, two, eighth, whole = np.float32(0.0), np.float32(2.0), np.float32(0.125), np.float32(1.0)
    least = np.float32(1e-24)
    for y in range(height):
        for c in range(planes.shape[0]):
            channel = planes[c]
            above, here = channel[y - 1 if y > 0 else min(1, height - 1)], channel[y]
            below = channel[y + 1 if y < height - 1 else max(0, height - 2)]
            for x in range(width):
                down[x] = below[x] - above[x]
                level[x] = above[x] + two * here[x] + below[x]
            for x in (0, width - 1):
                beside = down[min(1, width - 1)] if x == 0 else down[max(0, width - 2)]
                dy = two * (down[x] + beside)
                take = (c == 0) | (dy * dy > best[x])
                best[x], best_x[x], best_y[x] = (dy * dy, zero, dy) if take else (best[x], best_x[x], best_y[x])
            # slices, so that no index can be negative and the loop can do several pixels at once
            left, right, d0, d1, d2 = level[:-2], level[2:], down[:-2], down[1:-1], down[2:]
            most, most_x, most_y = best[1:-1], best_x[1:-1], best_y[1:-1]
            for x in range(width - 2):
                dx = right[x] - left[x]
                dy = d0[x] + two * d1[x] + d2[x]
                square = dx * dx + dy * dy
                steeper = (c == 0) | (square > most[x])
                most[x] = square if steeper else most[x]
                most_x[x] = dx if steeper else most_x[x]
                most_y[x] = dy if steeper else most_y[x]
        local, strong, towards = variance[y], strength[y], direction[y]
        for x in range(width):
            size = math.sqrt(best[x])
            strong[x] = min(scale * eighth * size / math.sqrt(local[x] + floor), whole)
            unit = whole / math.sqrt(max(best[x], least))
            towards[x, 0], towards[x, 1] = best_x[x] * unit, best_y[x] * unit
    return strength, direction


@jit
def block_means(planes, side):  # type: ignore[no-untyped-def]
    """Means of planes (C, H, W) float32, and of their squares, in square blocks of `side` pixels: (C, H // side,
    W // side) float32 each, at least one block; what is left over at the right and below is left out."""
    channels, height, width = planes.shape
    rows, columns = max(1, height // side), max(1, width // side)
    tall, wide = height // rows, width // columns
    mean, square = np.empty((channels, rows, columns), np.float32), np.empty((channels, rows, columns), np.float32)
    total, squares = np.empty(width, np.float32), np.empty(width, np.float32)
    share = np.float32(1.0 / (tall * wide))
    for c in range(channels):
        for row in range(rows):
            total[:] = np.float32(0.0)
            squares[:] = np.float32(0.0)
            for y in range(row * tall, (row + 1) * tall):
                line = planes[c, y]
                for x in range(width):
                    total[x] += line[x]
                    squares[x] += line[x] * line[x]
            for column in range(columns):
                first, second = np.float32(0.0), np.float32(0.0)
                for x in range(column * wide, (column + 1) * wide):
                    first += total[x]
                    second += squares[x]
                mean[c, row, column], square[c, row, column] = share * first, share * second
    return mean, square
