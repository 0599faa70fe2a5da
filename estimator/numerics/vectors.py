"""Vectors of three numbers, compiled: arrays or tuples. Results are tuples, which need no memory of their own. Angles,
an axis beside one, the mean of several.
"""

from __future__ import annotations

import math

import numpy as np

from humanoid.support.compiled import jit


@jit
def dot(a, b):  # type: ignore[no-untyped-def]
    """Scalar product of vectors a, b (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def cross(a, b):  # type: ignore[no-untyped-def]
    """Vector product (3,) of vectors a, b (3,)."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit
def plus(a, factor, b):  # type: ignore[no-untyped-def]
    """a + factor b (3,), of vectors a, b (3,) and a number."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@jit
def times(factor, a):  # type: ignore[no-untyped-def]
    """factor a (3,), of a number and a vector (3,)."""
    return factor * a[0], factor * a[1], factor * a[2]


@jit
def furthest(a, b):  # type: ignore[no-untyped-def]
    """The largest distance of points a (N, 3) from points b (N, 3)."""
    most = 0.0
    for i in range(a.shape[0]):
        way = plus(a[i], -1.0, b[i])
        most = max(most, dot(way, way))
    return math.sqrt(most)


@jit
def rotated(axis, angle, v):  # type: ignore[no-untyped-def]
    """v (3,) turned by `angle` [rad] about the unit vector `axis` (3,)."""
    c, s = math.cos(angle), math.sin(angle)
    along = dot(axis, v) * (1.0 - c)
    return (
        c * v[0] + s * (axis[1] * v[2] - axis[2] * v[1]) + along * axis[0],
        c * v[1] + s * (axis[2] * v[0] - axis[0] * v[2]) + along * axis[1],
        c * v[2] + s * (axis[0] * v[1] - axis[1] * v[0]) + along * axis[2],
    )


@jit
def turn_in_place(axis, through, place, cosine, sine, v):  # type: ignore[no-untyped-def]
    """Turn v (3,) in place about an axis, a unit vector (3,) through a point (3,): v is a point where `place` is 1, a
    direction where it is 0. cosine, sine: of the angle."""
    x, y, z = v[0] - place * through[0], v[1] - place * through[1], v[2] - place * through[2]
    along = (axis[0] * x + axis[1] * y + axis[2] * z) * (1.0 - cosine)
    v[0] = cosine * x + sine * (axis[1] * z - axis[2] * y) + along * axis[0] + place * through[0]
    v[1] = cosine * y + sine * (axis[2] * x - axis[0] * z) + along * axis[1] + place * through[1]
    v[2] = cosine * z + sine * (axis[0] * y - axis[1] * x) + along * axis[2] + place * through[2]


def axes_across(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors (3, 2), its columns, across a unit vector (3,) and each other, right-handed with it before
    them."""
    first = np.array(cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction))
    first /= np.linalg.norm(first)
    return np.stack([first, cross(direction, first)], axis=1)


def mean_direction(ways: np.ndarray) -> np.ndarray:
    """Mean (3,) of the directions of ways (T, 3), shorter than 1 the more they differ; those that are missing (NaN) or
    nowhere are left out, and without any others it is 0."""
    length = np.linalg.norm(ways, axis=1)
    known = length > 0.0
    return np.asarray((ways[known] / length[known, None]).mean(axis=0)) if known.any() else np.zeros(3)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., n) of length 1; of next to none, none."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Between vectors (..., n), (...) [rad]."""
    return np.asarray(np.arccos(np.clip((unit(a) * unit(b)).sum(axis=-1), -1.0, 1.0)))
