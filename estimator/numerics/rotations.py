"""Unit quaternions x, y, z, w in compiled code: q and -q are the same rotation everywhere."""

from __future__ import annotations

import math

from humanoid.support.compiled import jit


@jit
def turn_between(a, b):  # type: ignore[no-untyped-def]
    """The four numbers of a^-1 b, of quaternions a and b, each (4,) and of length 1."""
    x = a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1]
    y = a[3] * b[1] - a[1] * b[3] - a[2] * b[0] + a[0] * b[2]
    z = a[3] * b[2] - a[2] * b[3] - a[0] * b[1] + a[1] * b[0]
    w = a[3] * b[3] + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return x, y, z, w


@jit
def turn_after(a, b):  # type: ignore[no-untyped-def]
    """The four numbers of a b, of quaternions a and b, each (4,) and of length 1; made of length 1 again."""
    x = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1]
    y = a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2]
    z = a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0]
    w = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]
    scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
    return x * scale, y * scale, z * scale, w * scale


@jit
def turn_of(R):  # type: ignore[no-untyped-def]
    """The four numbers of the quaternion of a rotation R (3, 3), from the largest of their squares, so that no angle
    is worse than others (Shepperd 1978)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    x, y, z, w = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + trace
    if R[0, 0] > trace and R[0, 0] >= R[1, 1] and R[0, 0] >= R[2, 2]:
        x, y, z, w = 1.0 + 2.0 * R[0, 0] - trace, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], x
    elif R[1, 1] > trace and R[1, 1] >= R[2, 2]:
        x, y, z, w = R[0, 1] + R[1, 0], 1.0 + 2.0 * R[1, 1] - trace, R[1, 2] + R[2, 1], y
    elif R[2, 2] > trace:
        x, y, z, w = R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1.0 + 2.0 * R[2, 2] - trace, z
    scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
    return x * scale, y * scale, z * scale, w * scale


@jit
def half_sine_ratio(x, y, z, w):  # type: ignore[no-untyped-def]
    """Exact factor from (x, y, z) of a unit quaternion to its rotation vector: angle / sin(angle / 2), the angle at
    most pi in size, negative where w is: so q and -q have the same vector."""
    sine = math.sqrt(x * x + y * y + z * z)
    if w < 0.0:
        return -2.0 * math.atan2(sine, -w) / sine if sine > 1e-9 else -2.0
    return 2.0 * math.atan2(sine, w) / sine if sine > 1e-9 else 2.0


@jit
def exponential(x, y, z):  # type: ignore[no-untyped-def]
    """The four numbers of the quaternion that a rotation vector [rad] makes."""
    angle = math.sqrt(x * x + y * y + z * z)
    ratio = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    return ratio * x, ratio * y, ratio * z, math.cos(0.5 * angle)


@jit
def turned_back(q, x, y, z):  # type: ignore[no-untyped-def]
    """The vector (x, y, z) in the frame that q (4,) turns the world's to."""
    a = 2.0 * (y * q[2] - z * q[1])
    b = 2.0 * (z * q[0] - x * q[2])
    c = 2.0 * (x * q[1] - y * q[0])
    return (
        x + q[3] * a + b * q[2] - c * q[1],
        y + q[3] * b + c * q[0] - a * q[2],
        z + q[3] * c + a * q[1] - b * q[0],
    )


@jit
def turned(q, x, y, z):  # type: ignore[no-untyped-def]
    """The vector (x, y, z) turned by q (4,)."""
    a = 2.0 * (q[1] * z - q[2] * y)
    b = 2.0 * (q[2] * x - q[0] * z)
    c = 2.0 * (q[0] * y - q[1] * x)
    return (
        x + q[3] * a + q[1] * c - q[2] * b,
        y + q[3] * b + q[2] * a - q[0] * c,
        z + q[3] * c + q[0] * b - q[1] * a,
    )


@jit
def difference(n, turns, centre, point, e):  # type: ignore[no-untyped-def]
    """The tangent e (n + 3 * turns,) at a centre that leads to a point, both (n + 4 * turns,): see `Space`."""
    for i in range(n):
        e[i] = point[i] - centre[i]
    if turns:
        if n == 3:
            e[0], e[1], e[2] = turned_back(centre[3:], e[0], e[1], e[2])
        x, y, z, w = turn_between(centre[n:], point[n:])
        ratio = half_sine_ratio(x, y, z, w)
        e[n], e[n + 1], e[n + 2] = ratio * x, ratio * y, ratio * z


@jit
def moved(n, turns, centre, e, point):  # type: ignore[no-untyped-def]
    """The point (n + 4 * turns,) that a tangent e (n + 3 * turns,) at a centre (n + 4 * turns,) leads to."""
    if turns and n == 3:
        point[0], point[1], point[2] = turned(centre[3:], e[0], e[1], e[2])
        for i in range(n):
            point[i] += centre[i]
    else:
        for i in range(n):
            point[i] = centre[i] + e[i]
    if turns:
        step = exponential(e[n], e[n + 1], e[n + 2])
        point[n], point[n + 1], point[n + 2], point[n + 3] = turn_after(centre[n:], step)


@jit
def transport(n, turns, e, centre, point, A):  # type: ignore[no-untyped-def]
    """Fill A (n + 3 * turns, n + 3 * turns): how the tangent e (n + 3 * turns,) at a centre that leads to a point
    changes as the point moves by a tangent of its own; centre, point (n + 4 * turns,)."""
    d = n + 3 * turns
    for i in range(d):
        for j in range(d):
            A[i, j] = 1.0 if i == j else 0.0
    if not turns:
        return
    if n == 3:
        relative = turn_between(centre[3:], point[3:])
        A[0, 0], A[1, 0], A[2, 0] = turned(relative, 1.0, 0.0, 0.0)
        A[0, 1], A[1, 1], A[2, 1] = turned(relative, 0.0, 1.0, 0.0)
        A[0, 2], A[1, 2], A[2, 2] = turned(relative, 0.0, 0.0, 1.0)
    # inverse right Jacobian of SO(3): I + [e]/2 + bend [e]^2
    x, y, z = e[n], e[n + 1], e[n + 2]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    half = 0.5 * angle
    bend = (1.0 - half * math.cos(half) / math.sin(half)) / square if angle > 1e-4 else 1.0 / 12.0
    for i in range(3):
        for j in range(3):
            A[n + i, n + j] += bend * (e[n + i] * e[n + j] - (square if i == j else 0.0))
    A[n, n + 1] -= 0.5 * z
    A[n, n + 2] += 0.5 * y
    A[n + 1, n] += 0.5 * z
    A[n + 1, n + 2] -= 0.5 * x
    A[n + 2, n] -= 0.5 * y
    A[n + 2, n + 1] += 0.5 * x
