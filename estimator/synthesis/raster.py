"""A small depth-buffered triangle painter."""

from __future__ import annotations

import math

import numpy as np

from humanoid.compiled import jit


@jit
def paint(
    image: np.ndarray,
    nearness: np.ndarray,
    pixels: np.ndarray,
    depth: np.ndarray,
    colour: np.ndarray,
    faces: np.ndarray,
) -> None:
    """Paint triangles into image (H, W, 3) and nearness (H, W), the largest 1 / depth at each pixel so far, in place.

    pixels (V, 2), depth (V,) [m], colour (V, 3): of the corners; colour runs linearly in between. faces (F, 3) int.
    A triangle with a corner that is not in front of the camera is left out.
    """
    height, width = nearness.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if not (depth[a] > 0.05 and depth[b] > 0.05 and depth[c] > 0.05):
            continue
        ax, ay = pixels[a, 0], pixels[a, 1]
        bx, by = pixels[b, 0] - ax, pixels[b, 1] - ay
        cx, cy = pixels[c, 0] - ax, pixels[c, 1] - ay
        area = bx * cy - by * cx
        if not abs(area) > 1e-9:  # also leaves out NaN
            continue
        left, right = max(0, math.ceil(ax + min(0.0, bx, cx))), min(width - 1, math.floor(ax + max(0.0, bx, cx)))
        top, bottom = max(0, math.ceil(ay + min(0.0, by, cy))), min(height - 1, math.floor(ay + max(0.0, by, cy)))
        na, nb, nc = 1.0 / depth[a], 1.0 / depth[b], 1.0 / depth[c]
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                v = ((x - ax) * cy - (y - ay) * cx) / area
                w = (bx * (y - ay) - by * (x - ax)) / area
                u = 1.0 - v - w
                if u < -1e-9 or v < -1e-9 or w < -1e-9:
                    continue
                near = u * na + v * nb + w * nc
                if near > nearness[y, x]:
                    nearness[y, x] = near
                    for k in range(3):
                        image[y, x, k] = u * colour[a, k] + v * colour[b, k] + w * colour[c, k]
