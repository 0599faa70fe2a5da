"""Depth-buffered triangle painters."""

from __future__ import annotations

import math

import numpy as np

from estimator.data.cameras.projection import nearness as nearness_at
from humanoid.support.compiled import jit

_NEAREST = 0.05  # [m] triangles with a corner nearer to the camera are left out


@jit
def _box(pixels, face, height, width):  # type: ignore[no-untyped-def]
    """First and last column and row of the pixels that a triangle can cover; pixels (V, 2), face (3,) int."""
    a, b, c = pixels[face[0]], pixels[face[1]], pixels[face[2]]
    left, right = max(0, math.ceil(min(a[0], b[0], c[0]))), min(width - 1, math.floor(max(a[0], b[0], c[0])))
    top, bottom = max(0, math.ceil(min(a[1], b[1], c[1]))), min(height - 1, math.floor(max(a[1], b[1], c[1])))
    return left, right, top, bottom


@jit
def _twice_area(pixels, depth, face):  # type: ignore[no-untyped-def]
    """Twice the signed area [px^2], negative where the corners run counter-clockwise as seen (y points down); 0 where
    the triangle is not drawn: a corner is not in front of the camera, or it has no extent. pixels (V, 2), depth (V,)
    [m], face (3,) int."""
    if not (depth[face[0]] > _NEAREST and depth[face[1]] > _NEAREST and depth[face[2]] > _NEAREST):
        return 0.0
    a, b, c = pixels[face[0]], pixels[face[1]], pixels[face[2]]
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return area if abs(area) > 1e-9 else 0.0  # also leaves out NaN


@jit
def _weights(pixels, face, area, x, y):  # type: ignore[no-untyped-def]
    """Barycentric coordinates of a pixel in the picture; one is negative outside. pixels (V, 2), face (3,) int."""
    a, b, c = pixels[face[0]], pixels[face[1]], pixels[face[2]]
    v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
    w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
    return 1.0 - v - w, v, w


@jit
def _nearness(depth, face, parallel):  # type: ignore[no-untyped-def]
    """Nearness of a triangle's corners, see `estimator.data.cameras.projection.nearness`; depth (V,) [m], face (3,)
    int."""
    a, b, c = depth[face[0]], depth[face[1]], depth[face[2]]
    return nearness_at(a, parallel), nearness_at(b, parallel), nearness_at(c, parallel)


@jit
def paint(
    image: np.ndarray,
    nearness: np.ndarray,
    pixels: np.ndarray,
    depth: np.ndarray,
    colour: np.ndarray,
    faces: np.ndarray,
    parallel: bool = False,
) -> None:
    """Paint triangles into image (H, W, 3) and nearness (H, W), the largest 1 / depth at each pixel so far, in place;
    of a parallel camera that number is `estimator.data.cameras.projection.nearness`.

    pixels (V, 2), depth (V,) [m], colour (V, 3): of the corners; colour runs linearly in between. faces (F, 3) int.
    A triangle with a corner that is not in front of the camera is left out. Both sides are painted.
    """
    height, width = nearness.shape
    for f in range(faces.shape[0]):
        face = faces[f]
        area = _twice_area(pixels, depth, face)
        if area == 0.0:
            continue
        left, right, top, bottom = _box(pixels, face, height, width)
        na, nb, nc = _nearness(depth, face, parallel)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                u, v, w = _weights(pixels, face, area, x, y)
                if u < -1e-9 or v < -1e-9 or w < -1e-9:
                    continue
                near = u * na + v * nb + w * nc
                if near > nearness[y, x]:
                    nearness[y, x] = near
                    for k in range(3):
                        image[y, x, k] = u * colour[face[0], k] + v * colour[face[1], k] + w * colour[face[2], k]


@jit
def paint_index(
    index: np.ndarray,
    nearness: np.ndarray,
    pixels: np.ndarray,
    depth: np.ndarray,
    faces: np.ndarray,
    number: np.ndarray,
    closed: bool,
    parallel: bool = False,
) -> None:
    """Like `paint`, with number (F,) of the nearest face written into index (H, W) int instead of colours.

    nearness (H, W), pixels (V, 2), depth (V,) [m], faces (F, 3) int: see `paint`. closed: the faces bound solids,
    counter-clockwise from outside, so that their back sides need no painting.
    """
    height, width = nearness.shape
    for f in range(faces.shape[0]):
        face = faces[f]
        area = _twice_area(pixels, depth, face)
        if area == 0.0 or (closed and area > 0.0):
            continue
        left, right, top, bottom = _box(pixels, face, height, width)
        na, nb, nc = _nearness(depth, face, parallel)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                u, v, w = _weights(pixels, face, area, x, y)
                if u < -1e-9 or v < -1e-9 or w < -1e-9:
                    continue
                near = u * na + v * nb + w * nc
                if near > nearness[y, x]:
                    nearness[y, x] = near
                    index[y, x] = number[f]


@jit
def paint_cloth(
    image: np.ndarray,
    nearness: np.ndarray,
    pixels: np.ndarray,
    depth: np.ndarray,
    local: np.ndarray,
    colour: np.ndarray,
    light: np.ndarray,
    faces: np.ndarray,
    part: np.ndarray,
    pattern: np.ndarray,
    grain: np.ndarray,
    parallel: bool = False,
) -> None:
    """Paint closed solids whose cloth has a pattern in the space of each part, so that it moves with the body.

    image (H, W, 3), nearness (H, W): see `paint`. pixels (V, 2), depth (V,) [m], local (V, 3) [m] in the part's own
    frame, colour (V, 3), light (V,): of the corners.
    faces (F, 3) int, counter-clockwise from outside; part (F,) int. pattern (B, 7), by part: strength and size [m] of
    the coarse and of the fine mottling, strength and period [m] of stripes along the third axis, and an offset [m]
    that gives each part its own piece of cloth. grain (N, N, N): periodic noise of unit variance, N a power of two.
    """
    height, width = nearness.shape
    for f in range(faces.shape[0]):
        face = faces[f]
        area = _twice_area(pixels, depth, face)
        if area >= 0.0:
            continue
        left, right, top, bottom = _box(pixels, face, height, width)
        na, nb, nc = _nearness(depth, face, parallel)
        p, q, r, cloth = local[face[0]], local[face[1]], local[face[2]], pattern[part[f]]
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                u, v, w = _weights(pixels, face, area, x, y)
                if u < -1e-9 or v < -1e-9 or w < -1e-9:
                    continue
                near = u * na + v * nb + w * nc
                if near > nearness[y, x]:
                    nearness[y, x] = near
                    if not parallel:  # straight in space, not in the picture
                        u, v, w = u * na / near, v * nb / near, w * nc / near
                    bright = u * light[face[0]] + v * light[face[1]] + w * light[face[2]]
                    bright *= _cloth(
                        u * p[0] + v * q[0] + w * r[0],
                        u * p[1] + v * q[1] + w * r[1],
                        u * p[2] + v * q[2] + w * r[2],
                        cloth,
                        grain,
                    )
                    for k in range(3):
                        image[y, x, k] = bright * (
                            u * colour[face[0], k] + v * colour[face[1], k] + w * colour[face[2], k]
                        )


@jit
def _cloth(x, y, z, cloth, grain):  # type: ignore[no-untyped-def]
    """Brightness of the cloth (7,) at a place of its part [m], 1 on average; grain (N, N, N): see `paint_cloth`."""
    shift = cloth[6]
    value = 1.0 + cloth[0] * _noise(x / cloth[1] + shift, y / cloth[1] + shift, z / cloth[1], grain)
    value += cloth[2] * _noise(x / cloth[3], y / cloth[3] + shift, z / cloth[3] + shift, grain)
    if cloth[4] > 0.0:
        value += cloth[4] * max(-1.0, min(1.0, 3.0 * math.sin(2.0 * math.pi * z / cloth[5])))
    return max(value, 0.1)


@jit
def _noise(x, y, z, grain):  # type: ignore[no-untyped-def]
    """Trilinear value of the periodic grid grain (N, N, N)."""
    last = grain.shape[0] - 1
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    a, b, c = x - i, y - j, z - k
    i, j, k = int(i) & last, int(j) & last, int(k) & last
    i1, j1, k1 = (i + 1) & last, (j + 1) & last, (k + 1) & last
    low = (1.0 - b) * ((1.0 - a) * grain[i, j, k] + a * grain[i1, j, k])
    low += b * ((1.0 - a) * grain[i, j1, k] + a * grain[i1, j1, k])
    high = (1.0 - b) * ((1.0 - a) * grain[i, j, k1] + a * grain[i1, j, k1])
    high += b * ((1.0 - a) * grain[i, j1, k1] + a * grain[i1, j1, k1])
    return (1.0 - c) * low + c * high
