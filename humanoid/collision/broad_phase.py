"""Compiled kernels of `humanoid.collision.self_collision`: placed solids, and lower bounds of all distances at once."""

from __future__ import annotations

import numpy as np

from humanoid.support.compiled import jit

_SLACK = 1e-6  # [m] what rounding may add to a lower bound where two cores are nearly parallel
_DIRECTIONS = 4  # tried for a pair with an ellipsoid; each costs a tenth of the search that it may save


@jit
def place(
    placements: np.ndarray,
    joint: np.ndarray,
    local: np.ndarray,
    core: np.ndarray,
    world: np.ndarray,
    segment: np.ndarray,
) -> None:
    """Solids into the world.

    placements (njoints, 12): see `PosedBody`. joint (S,), local (S, 12): joint of each solid, T_joint_solid in the same
    layout. core (S, 6): centre and half-axis of each solid's capsule in its frame.
    Written: world (S, 12), T_world_solid; segment (S, 6), the cores in the world.
    """
    for i in range(joint.size):
        P = placements[joint[i]]
        L, W, C, G = local[i], world[i], core[i], segment[i]
        for r in range(3):
            for c in range(3):
                W[3 * c + r] = P[r] * L[3 * c] + P[3 + r] * L[3 * c + 1] + P[6 + r] * L[3 * c + 2]
            W[9 + r] = P[r] * L[9] + P[3 + r] * L[10] + P[6 + r] * L[11] + P[9 + r]
        for r in range(3):
            G[r] = W[r] * C[0] + W[3 + r] * C[1] + W[6 + r] * C[2] + W[9 + r]
            G[3 + r] = W[r] * C[3] + W[3 + r] * C[4] + W[6 + r] * C[5]


@jit
def candidates(
    world: np.ndarray,
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    pairs: np.ndarray,
    limit: float,
    index: np.ndarray,
) -> int:
    """Pairs whose distance may be below `limit` [m]; returns how many, their indices in index (P,).

    world (S, 12), segment (S, 6): from `place`. radius (S,): of the capsules. radii (S, 3): of the ellipsoids, zero for
    other shapes. pairs (P, 2): solids of each pair.

    A pair is dropped only on a lower bound: the distance of the two capsules, and for ellipsoids (which their capsule
    overstates) the gap between the two solids seen along some directions.
    """
    direction, reach = np.empty(3), np.empty(radius.size)  # reach: of a ball around each capsule
    for i in range(radius.size):
        reach[i] = radius[i] + np.sqrt(segment[i, 3] ** 2 + segment[i, 4] ** 2 + segment[i, 5] ** 2)
    close = 0
    for k in range(pairs.shape[0]):  # most pairs end here, so that a branch would often be predicted wrongly
        a, b = pairs[k, 0], pairs[k, 1]
        x, y, z = segment[b, 0] - segment[a, 0], segment[b, 1] - segment[a, 1], segment[b, 2] - segment[a, 2]
        far = max(reach[a] + reach[b] + limit + _SLACK, 0.0)
        index[close] = k
        close += int(not x * x + y * y + z * z > far * far)
    count = 0
    for k in index[:close]:
        a, b = pairs[k, 0], pairs[k, 1]
        if closest_on_cores(segment, a, b, direction)[0] > max(radius[a] + radius[b] + limit + _SLACK, 0.0):
            continue
        if (
            radii[a, 0] + radii[b, 0] > 0.0
            and _gap(world, segment, radius, radii, a, b, direction, limit) > limit + _SLACK
        ):
            continue
        index[count] = k
        count += 1
    return count


@jit
def closest_on_cores(segment: np.ndarray, a: int, b: int, direction: np.ndarray) -> tuple[float, float, float]:
    """Distance [m] of two segments centre -+ half-axis, of segment (S, 6), and where it is, -1.0 to 1.0 along each.

    direction (3,): filled with the way from the closest point of a to that of b [m]. Where the segments are parallel
    the points are any of several.
    """
    cu = cv = uu = uv = vv = 0.0
    for i in range(3):
        c, u, v = segment[b, i] - segment[a, i], segment[a, 3 + i], segment[b, 3 + i]
        cu += c * u
        cv += c * v
        uu += u * u
        uv += u * v
        vv += v * v
    determinant = uu * vv - uv * uv
    s = t = 0.0
    if determinant > 1e-12 * uu * vv:
        s = min(max((cu * vv - cv * uv) / determinant, -1.0), 1.0)
    if vv > 0.0:
        t = min(max((s * uv - cv) / vv, -1.0), 1.0)
    if uu > 0.0:
        s = min(max((cu + t * uv) / uu, -1.0), 1.0)
    square = 0.0
    for i in range(3):
        direction[i] = segment[b, i] + t * segment[b, 3 + i] - segment[a, i] - s * segment[a, 3 + i]
        square += direction[i] ** 2
    return np.sqrt(square), s, t


@jit
def _gap(
    world: np.ndarray,
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    a: int,
    b: int,
    direction: np.ndarray,
    limit: float,
) -> float:
    """Largest gap of two solids along a few directions, n.x over b at its least - over a at its most: a lower bound.

    The best direction is that from a's nearest point to b's; each direction tried is halfway between the last one and
    the line joining the two points that the last one gave. It ends early where that bound is above the limit, or those
    points, and so the solids, are nearer than it. direction (3,), overwritten; world (S, 12), segment (S, 6),
    radius (S,), radii (S, 3): see `candidates`.
    """
    best = -np.inf
    p, q = np.empty(3), np.empty(3)
    for _ in range(_DIRECTIONS):
        size = np.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
        if size < 1e-9:
            break
        for i in range(3):
            direction[i] /= size
        extreme_point(world, segment, radius, radii, a, direction, 1.0, p)
        extreme_point(world, segment, radius, radii, b, direction, -1.0, q)
        gap = far = 0.0
        for i in range(3):
            gap += direction[i] * (q[i] - p[i])
            far += (q[i] - p[i]) ** 2
        best = max(best, gap)
        if best > limit + _SLACK or far <= max(limit, 0.0) ** 2:
            break
        for i in range(3):
            direction[i] += (q[i] - p[i]) / np.sqrt(far)
    return best


@jit
def extreme_point(
    world: np.ndarray,
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    k: int,
    n: np.ndarray,
    sign: float,
    point: np.ndarray,
) -> None:
    """Fill point (3,) with that of solid k furthest along sign * n, n (3,) a unit vector; of its capsule if it is not
    an ellipsoid. world (S, 12), segment (S, 6), radius (S,), radii (S, 3): see `candidates`."""
    if radii[k, 0] == 0.0:
        along = n[0] * segment[k, 3] + n[1] * segment[k, 4] + n[2] * segment[k, 5]
        end = sign if along >= 0.0 else -sign
        for i in range(3):
            point[i] = segment[k, i] + end * segment[k, 3 + i] + sign * radius[k] * n[i]
        return
    square = 0.0
    for i in range(3):
        square += (
            radii[k, i] * (n[0] * world[k, 3 * i] + n[1] * world[k, 3 * i + 1] + n[2] * world[k, 3 * i + 2])
        ) ** 2
    for i in range(3):
        point[i] = world[k, 9 + i]
    for j in range(3):
        along = n[0] * world[k, 3 * j] + n[1] * world[k, 3 * j + 1] + n[2] * world[k, 3 * j + 2]
        step = sign * radii[k, j] ** 2 * along / np.sqrt(square)
        for i in range(3):
            point[i] += step * world[k, 3 * j + i]


@jit
def guess_contact(
    world: np.ndarray,
    segment: np.ndarray,
    radius: np.ndarray,
    radii: np.ndarray,
    a: int,
    b: int,
    p: np.ndarray,
    q: np.ndarray,
    n: np.ndarray,
) -> float:
    """Contact for a query that failed: the direction of largest gap among the lines worth a try.

    They are the query's own normal n, the line of centres, the common perpendicular of the two cores (right where they
    cross) and the axes of both solids (right where one lies in the other).
    Writes witness points p, q and normal n (3,); returns the gap [m]. world (S, 12), segment (S, 6), radius (S,),
    radii (S, 3): see `candidates`.
    """
    lines = np.empty((9, 3))
    lines[8] = n
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        lines[0, i] = segment[b, i] - segment[a, i]
        lines[1, i] = segment[a, 3 + j] * segment[b, 3 + k] - segment[a, 3 + k] * segment[b, 3 + j]
        for axis in range(3):
            lines[2 + axis, i] = world[a, 3 * axis + i]
            lines[5 + axis, i] = world[b, 3 * axis + i]
    best = -np.inf
    x, y, direction = np.empty(3), np.empty(3), np.empty(3)
    for line in lines:
        size = np.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
        if not size > 1e-9:  # NaN where the query failed
            continue
        for sign in (1.0, -1.0):
            for i in range(3):
                direction[i] = sign * line[i] / size
            extreme_point(world, segment, radius, radii, a, direction, 1.0, x)
            extreme_point(world, segment, radius, radii, b, direction, -1.0, y)
            gap = 0.0
            for i in range(3):
                gap += direction[i] * (y[i] - x[i])
            if gap > best:
                best = gap
                p[:], q[:], n[:] = x, y, direction
    return best
