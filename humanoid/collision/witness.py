"""Compiled kernels of `humanoid.collision.self_collision`: witness points to the last digits, and their gradients.

The signed distance of two convex solids is the largest gap s(n) = n . (c_b - c_a) - h_a(n) - h_b(-n) over unit vectors
n (h: support functions about the centres c). GJK and EPA find n for ellipsoids to about the root of their tolerance,
too little for gradients. Newton's method on the sphere takes it to the last digits in two or three steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from humanoid.support.compiled import jit

_STEPS = 8
_ABSURD = 1e6  # [m]
_BALL, _CYLINDER = 0, 1  # where a capsule is touched: at one of its ends, or between them


class _Touch(NamedTuple):
    """Which solids touch, and how: a, b; which of them is a capsule (-1: neither); on which piece it is touched, and at
    which end (-1.0 or 1.0) where that is `_BALL`."""

    a: int
    b: int
    capsule: int
    piece: int
    end: float


@jit
def sharpen(
    world: np.ndarray,
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    pairs: np.ndarray,
    near: np.ndarray,
    count: int,
    distance: np.ndarray,
    point_a: np.ndarray,
    point_b: np.ndarray,
    normal: np.ndarray,
    first: int,
    guessed: bool,
) -> int:
    """Improve the contacts from `first` to `count` in place.

    world (S, 12): rotations, column by column, and translations of the solids. segment (S, 6): centre and half of the
    core. radius (S,): about the core. radii (S, 3): of an ellipsoid, zero for others. pairs (P, 2) int: solids.
    near (M,) int: the contacts' pairs. distance (M,), point_a, point_b, normal (M, 3): see
    `humanoid.collision.self_collision.Contacts`. The buffers may have more than `count` rows.

    Capsules and hulls are exact already and left alone. Stops at a contact whose query failed and returns it, else -1:
    coal reports an overlap of 1.8e308 m, NaN or no normal; or, where a core just touches an ellipsoid, a normal from
    which Newton finds nothing. `guessed`: the first contact is the best there is.
    """
    for m in range(first, count):
        a, b = pairs[near[m], 0], pairs[near[m], 1]
        square = normal[m, 0] ** 2 + normal[m, 1] ** 2 + normal[m, 2] ** 2
        if not (abs(square - 1.0) < 1e-6 and distance[m] > -_ABSURD):
            return m
        if radii[a, 0] + radii[b, 0] > 0.0:
            improved = sharpen_pair(world, segment, radius, radii, a, b, distance[m], point_a[m], point_b[m], normal[m])
            if np.isfinite(improved):
                distance[m] = improved
            elif not (guessed and m == first):
                return m
    return -1


@jit
def sharpen_pair(
    world: np.ndarray,
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    a: int,
    b: int,
    distance: float,
    p: np.ndarray,
    q: np.ndarray,
    n: np.ndarray,
) -> float:
    """A pair with an ellipsoid: writes p, q, n (3,), returns the distance [m]; on failure NaN, with nothing written.

    The ascent begins at the normal n, and on the piece of a capsule that its witness point is on, p or q; that of an
    ellipsoid is not read. An answer below `distance` by more than 0.1 mm is a failure. Other arrays as in `sharpen`.
    They are passed one by one: in a tuple they would take a third longer.
    """
    capsule = a if radii[a, 0] == 0.0 else (b if radii[b, 0] == 0.0 else -1)
    if capsule < 0:
        return _newton(world, segment, radius, radii, _Touch(a, b, -1, _BALL, 0.0), distance, p, q, n)
    uu = along = 0.0
    for i in range(3):
        u = segment[capsule, 3 + i]
        core = p[i] - radius[a] * n[i] if capsule == a else q[i] + radius[b] * n[i]
        uu += u * u
        along += (core - segment[capsule, i]) * u
    end = 1.0 if along >= 0.0 else -1.0
    first = _CYLINDER if abs(along) < (1.0 - 1e-9) * uu else _BALL
    for piece in (first, 1 - first):  # rounding may have put the touched point on the wrong side of an end
        improved = _newton(world, segment, radius, radii, _Touch(a, b, capsule, piece, end), distance, p, q, n)
        if np.isfinite(improved):
            return improved
    return np.nan


@jit
def _newton(
    world: np.ndarray,
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    touch: _Touch,
    distance: float,
    p: np.ndarray,
    q: np.ndarray,
    n: np.ndarray,
) -> float:
    """Ascend the gap from the normal n (3,); NaN, and nothing written, if that fails or ends below `distance`.

    Other arrays as in `sharpen`. In one piece: with the gap and its derivatives in a function of their own, a contact
    takes a quarter longer.
    """
    room = np.zeros((7, 3))  # in one piece: seven take a sixth of a contact's time
    x, c, u, pa, pb, first, second = room[0], room[1], room[2], room[3], room[4], room[5], room[6]
    x[:] = n
    a, b, capsule, piece, end = touch
    thick = 0.0
    for i in range(3):
        c[i] = segment[b, i] - segment[a, i]
        if capsule >= 0:
            u[i] = segment[capsule, 3 + i]
            if piece == _BALL:
                c[i] += end * u[i] * (1.0 if capsule == b else -1.0)
    if capsule >= 0:
        thick = radius[capsule]
    on_cylinder = capsule >= 0 and piece == _CYLINDER
    uu = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
    if on_cylinder and uu == 0.0:
        return np.nan
    gap = np.nan
    for step in range(_STEPS):
        if on_cylinder:  # n at right angles to the axis: one direction is free
            along = (x[0] * u[0] + x[1] * u[1] + x[2] * u[2]) / uu
            for i in range(3):
                x[i] -= along * u[i]
        if not _normalise(x):
            return np.nan
        _tangents(x, u, on_cylinder, first, second)
        gap = x[0] * c[0] + x[1] * c[1] + x[2] * c[2]
        h11 = h12 = h22 = 0.0
        for k, point in ((a, pa), (b, pb)):
            if radii[k, 0] > 0.0:
                h = _support(world, radii, k, x, point)
                gap -= h
                h11 += _curvature(world, radii, k, h, point, first, first)
                h12 += _curvature(world, radii, k, h, point, first, second)
                h22 += _curvature(world, radii, k, h, point, second, second)
        g1 = g2 = 0.0
        for i in range(3):
            w = c[i] - pa[i] - pb[i]
            g1 += w * first[i]
            g2 += w * second[i]
        h11, h22 = h11 + gap, h22 + gap
        if on_cylinder:
            h12, h22, g2 = 0.0, 1.0, 0.0
        if abs(g1) + abs(g2) < 1e-14 or step == _STEPS - 1:
            break
        determinant = h11 * h22 - h12 * h12
        if h11 <= 0.0 or determinant <= 0.0:
            return np.nan
        d1, d2 = (h22 * g1 - h12 * g2) / determinant, (h11 * g2 - h12 * g1) / determinant
        if d1 * d1 + d2 * d2 > 1.0:  # far from where the query ended
            return np.nan
        for i in range(3):
            x[i] += d1 * first[i] + d2 * second[i]
        if d1 * d1 + d2 * d2 < 1e-26:
            break
    if not gap - thick > distance - 1e-4:
        return np.nan
    return _write(segment, radius, radii, touch, pa, pb, x, u, p, q, n)


@jit
def _write(
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    touch: _Touch,
    pa: np.ndarray,
    pb: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
    p: np.ndarray,
    q: np.ndarray,
    n: np.ndarray,
) -> float:
    """Write the contact of the direction x (3,), return its distance [m]; NaN, and nothing written, if the points are
    not on the piece assumed. p, q, n (3,): filled; other arrays as in `sharpen`. pa, pb (3,): the points touched, from
    the centres; u (3,): half of the capsule's core [m]."""
    a, b, capsule, end = touch.a, touch.b, touch.capsule, touch.end
    t = end
    if capsule >= 0:
        side = x[0] * u[0] + x[1] * u[1] + x[2] * u[2]
        uu = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
        if touch.piece == _CYLINDER:
            t = 0.0
            for i in range(3):
                touched = segment[a, i] + pa[i] if capsule == b else segment[b, i] - pb[i]
                t += (touched - segment[capsule, i]) * u[i] / uu
            if abs(t) > 1.0 + 1e-9:
                return np.nan
        elif end * side * (1.0 if capsule == a else -1.0) < -1e-9 * np.sqrt(uu):
            return np.nan
    distance = 0.0
    for i in range(3):
        n[i] = x[i]
        p[i] = segment[a, i] + (pa[i] if radii[a, 0] > 0.0 else t * u[i] + radius[a] * x[i])
        q[i] = segment[b, i] - (pb[i] if radii[b, 0] > 0.0 else radius[b] * x[i] - t * u[i])
        distance += x[i] * (q[i] - p[i])
    return distance


@jit
def _normalise(x: np.ndarray) -> bool:
    """Make x (3,) a unit vector in place; False where it is almost zero."""
    size = np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
    if size < 1e-9:
        return False
    for i in range(3):
        x[i] /= size
    return True


@jit
def _tangents(x: np.ndarray, u: np.ndarray, across: bool, first: np.ndarray, second: np.ndarray) -> None:
    """Fill unit vectors first, second (3,) at right angles to x (3,) and to each other; `across`: the first at right
    angles to u (3,) as well."""
    if across:
        for i in range(3):
            second[i] = u[i]
    else:
        least = np.argmin(np.abs(x))
        for i in range(3):
            second[i] = 1.0 if i == least else 0.0
    first[0] = x[1] * second[2] - x[2] * second[1]
    first[1] = x[2] * second[0] - x[0] * second[2]
    first[2] = x[0] * second[1] - x[1] * second[0]
    _normalise(first)
    second[0] = x[1] * first[2] - x[2] * first[1]
    second[1] = x[2] * first[0] - x[0] * first[2]
    second[2] = x[0] * first[1] - x[1] * first[0]


@jit
def _support(world: np.ndarray, radii: np.ndarray, k: int, x: np.ndarray, point: np.ndarray) -> float:
    """Support function [m] of ellipsoid k about its centre; world (S, 12), radii (S, 3): see `sharpen`.

    point (3,): filled with the furthest point along x (3,), from the centre [m].
    """
    square = 0.0
    point[:] = 0.0
    for j in range(3):
        along = x[0] * world[k, 3 * j] + x[1] * world[k, 3 * j + 1] + x[2] * world[k, 3 * j + 2]
        square += (radii[k, j] * along) ** 2
        for i in range(3):
            point[i] += radii[k, j] ** 2 * along * world[k, 3 * j + i]
    h = np.sqrt(square)
    for i in range(3):
        point[i] /= h
    return h


@jit
def _curvature(
    world: np.ndarray, radii: np.ndarray, k: int, h: float, point: np.ndarray, y: np.ndarray, z: np.ndarray
) -> float:
    """Second derivative [m] of the support function of ellipsoid k along y and z (3,), where `_support` gave h and
    point (3,)."""
    total = along_y = along_z = 0.0
    for j in range(3):
        yj = y[0] * world[k, 3 * j] + y[1] * world[k, 3 * j + 1] + y[2] * world[k, 3 * j + 2]
        zj = z[0] * world[k, 3 * j] + z[1] * world[k, 3 * j + 1] + z[2] * world[k, 3 * j + 2]
        total += radii[k, j] ** 2 * yj * zj
        along_y += point[j] * y[j]
        along_z += point[j] * z[j]
    return (total - along_y * along_z) / h


@jit
def gradients(
    spatial_jacobian: np.ndarray,
    dof_parent: np.ndarray,
    last_dof: np.ndarray,
    points_a: np.ndarray,
    points_b: np.ndarray,
    normals: np.ndarray,
) -> np.ndarray:
    """Gradients (M, nv) of signed distances: n . (J_b(p_b) - J_a(p_a)).

    spatial_jacobian (nv, 6): see `PosedBody`. dof_parent (nv,): see `Tree`. last_dof (M, 2): last degree of freedom of
    either solid. points_a, points_b, normals (M, 3): witness points and normal from a to b.

    A degree of freedom that moves both solids leaves their distance alone, so the walk to the root ends where the two
    chains meet.
    """
    gradient = np.zeros((normals.shape[0], spatial_jacobian.shape[0]))
    for m in range(normals.shape[0]):
        a, b = last_dof[m, 0], last_dof[m, 1]
        while a != b:  # a parent comes before its children, so the larger of the two is on one chain only
            k, sign = (a, -1.0) if a > b else (b, 1.0)
            p = points_a[m] if a > b else points_b[m]
            n, c = normals[m], spatial_jacobian[k]
            gradient[m, k] = sign * (
                n[0] * (c[0] + c[4] * p[2] - c[5] * p[1])
                + n[1] * (c[1] + c[5] * p[0] - c[3] * p[2])
                + n[2] * (c[2] + c[3] * p[1] - c[4] * p[0])
            )
            if a > b:
                a = dof_parent[a]
            else:
                b = dof_parent[b]
    return gradient
