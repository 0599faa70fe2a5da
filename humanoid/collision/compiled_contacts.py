"""Compiled kernels: the contacts of a pose, except those that are left to coal.

The signed distance of two convex solids is the largest gap s(n) over unit vectors n, see `witness`. For two capsules it
is the distance of their cores less both radii. For a pair with an ellipsoid Newton's method finds a direction in which
s is stationary, where the way from one witness point to the other is along n. No other gap is larger

- where the solids are apart, because s, continued to vectors of any length, is concave;
- in overlap, where the depth is less than the radius of a ball that rolls inside the solids' Minkowski difference. The
  ball that touches its surface at the witness points then contains the origin, and the surface is nowhere nearer. Such
  radii of two solids add up: a capsule's is its own radius, an ellipsoid's its least radius of curvature (Blaschke's
  rolling theorem).

In deeper overlap s may have several largest values, of which Newton's method finds any. Those contacts, and whatever
else is not certain, are left to coal.
"""

from __future__ import annotations

import numpy as np

from humanoid.collision import broad_phase, witness
from humanoid.collision.curvature import ELLIPSOID, UNKNOWN
from humanoid.support.compiled import jit

_CROSSING = 1e-6  # [m] between two cores: nearer, rounding turns the direction by more than 1e-10
_PARALLEL = 1e-6  # squared sine of the angle of two cores: below, rounding moves witness points by more than 1e-10
_ASIDE = 1e-11  # [m] by which witness points may miss each other along the normal


@jit
def find_contacts(  # type: ignore[no-untyped-def]
    placements, joint, local, core, radius, radii, kind, pairs, limit, world, segment, candidates, near, distance,
    point_a, point_b, normal, left,
):  # fmt: skip
    """Contacts nearer than `limit` [m], in the order of the pairs; returns how many, and how many pairs are left.

    placements (njoints, 12): see `PosedBody`. joint (S,), local (S, 12), core (S, 6), radius (S,), radii (S, 3),
    kind (S,), pairs (P, 2): see `humanoid.collision.self_collision.SolidArrays`.
    Written: world (S, 12), segment (S, 6): see `broad_phase.place`. candidates (P,): room. near (P,), distance (P,)
    [m], point_a, point_b, normal (P, 3): the contacts, see `humanoid.collision.self_collision.Contacts`; rows beyond
    them have no meaning. left (P,): pairs that may be nearer than the limit, in their order, for coal to measure.
    """
    broad_phase.place(placements, joint, local, core, world, segment)
    some = broad_phase.candidates(world, segment, radius, radii, pairs, limit, candidates)
    count = remaining = 0
    for k in candidates[:some]:
        a, b = pairs[k, 0], pairs[k, 1]
        p, q, n = point_a[count], point_b[count], normal[count]
        d = np.nan
        if kind[a] != UNKNOWN and kind[b] != UNKNOWN:
            if kind[a] == ELLIPSOID or kind[b] == ELLIPSOID:
                d = _with_ellipsoid(world, segment, radius, radii, kind, a, b, p, q, n)
            else:
                d = _of_capsules(segment, radius, a, b, p, q, n)
        if d < limit:
            near[count], distance[count] = k, d
            count += 1
        elif not d >= limit:  # NaN
            left[remaining] = k
            remaining += 1
    return count, remaining


@jit
def find_distances(  # type: ignore[no-untyped-def]
    placements, joint, local, core, radius, radii, kind, pairs, limit, world, segment, first, first_left
):  # fmt: skip
    """`find_contacts` for N poses: returns the pairs (M,), distances (M,) [m] and pairs left (L,), pose after pose.

    placements (N, njoints, 12); other arrays as there. Written: world (N, S, 12), segment (N, S, 6); first (N + 1,),
    first_left (N + 1,): where the contacts, and the pairs left, of each pose begin.
    """
    size, count, remaining = pairs.shape[0], 0, 0
    candidates, near, left = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    distance, point_a, point_b, normal = np.empty(size), np.empty((size, 3)), np.empty((size, 3)), np.empty((size, 3))
    all_near, all_distance, all_left = np.empty(64, np.int64), np.empty(64), np.empty(64, np.int64)
    first[0] = first_left[0] = 0
    for i in range(placements.shape[0]):
        more, unsure = find_contacts(
            placements[i], joint, local, core, radius, radii, kind, pairs, limit, world[i], segment[i], candidates,
            near, distance, point_a, point_b, normal, left,
        )  # fmt: skip
        while count + more > all_near.size:
            all_near = np.concatenate((all_near, np.empty_like(all_near)))
            all_distance = np.concatenate((all_distance, np.empty_like(all_distance)))
        while remaining + unsure > all_left.size:
            all_left = np.concatenate((all_left, np.empty_like(all_left)))
        all_near[count : count + more] = near[:more]
        all_distance[count : count + more] = distance[:more]
        all_left[remaining : remaining + unsure] = left[:unsure]
        count, remaining = count + more, remaining + unsure
        first[i + 1], first_left[i + 1] = count, remaining
    return all_near[:count], all_distance[:count], all_left[:remaining]


@jit
def _of_capsules(segment, radius, a, b, p, q, n):  # type: ignore[no-untyped-def]
    """Signed distance [m] of two capsules, witness points p, q and normal n (3,); NaN where these are not unique.

    segment (S, 6), radius (S,): see `find_contacts`.
    """
    d, s, t = broad_phase.closest_on_cores(segment, a, b, n)
    uu = uv = vv = 0.0
    for i in range(3):
        u, v = segment[a, 3 + i], segment[b, 3 + i]
        uu += u * u
        uv += u * v
        vv += v * v
    if not d > _CROSSING or uv * uv > (1.0 - _PARALLEL) * uu * vv:
        return np.nan
    for i in range(3):
        n[i] /= d
        p[i] = segment[a, i] + s * segment[a, 3 + i] + radius[a] * n[i]
        q[i] = segment[b, i] + t * segment[b, 3 + i] - radius[b] * n[i]
    return d - radius[a] - radius[b]


@jit
def _with_ellipsoid(world, segment, radius, radii, kind, a, b, p, q, n):  # type: ignore[no-untyped-def]
    """Signed distance [m] of a pair with an ellipsoid, witness points p, q and normal n (3,); NaN if it is not certain.

    Other arrays as in `find_contacts`.
    """
    if kind[a] == kind[b]:
        _start_between(world, radii, a, b, n)
    elif kind[a] == ELLIPSOID:
        _start_at_core(world, segment, radius, radii, a, b, -1.0, q, n)
    else:
        _start_at_core(world, segment, radius, radii, b, a, 1.0, p, n)
    d = witness.sharpen_pair(world, segment, radius, radii, a, b, -np.inf, p, q, n)
    aside = 0.0
    for i in range(3):
        aside += (q[i] - p[i] - d * n[i]) ** 2
    rolling = _rolling(radius, radii, kind, a) + _rolling(radius, radii, kind, b)
    return d if d > -rolling and aside < _ASIDE**2 else np.nan


@jit
def _rolling(radius, radii, kind, k):  # type: ignore[no-untyped-def]
    """Radius [m] of a ball that rolls inside solid k; radius (S,), radii (S, 3), kind (S,): see `find_contacts`."""
    if kind[k] != ELLIPSOID:
        return radius[k]
    x, y, z = radii[k, 0], radii[k, 1], radii[k, 2]
    return min(x, y, z) ** 2 / max(x, y, z)


@jit
def _start_at_core(world, segment, radius, radii, e, c, sign, point, n):  # type: ignore[no-untyped-def]
    """Fill n (3,) with a first guess of the normal of ellipsoid e and capsule c, point (3,) with the capsule's witness
    point for it.

    The guess is the normal of the ellipsoid made larger by the capsule's radius, and scaled until it touches the
    capsule's core. sign: 1.0 where the normal points from the capsule to the ellipsoid, else -1.0. Other arrays as in
    `find_contacts`.
    """
    W, yy, yu, uu = world[e], 0.0, 0.0, 0.0
    for m in range(3):
        y = u = 0.0
        for i in range(3):
            y += W[3 * m + i] * (segment[c, i] - W[9 + i])
            u += W[3 * m + i] * segment[c, 3 + i]
        scale = 1.0 / (radii[e, m] + radius[c]) ** 2
        yy += y * y * scale
        yu += y * u * scale
        uu += u * u * scale
    t = min(max(-yu / uu, -1.0), 1.0) if uu > 0.0 else 0.0
    n[:] = 0.0
    for m in range(3):
        y = 0.0
        for i in range(3):
            y += W[3 * m + i] * (segment[c, i] + t * segment[c, 3 + i] - W[9 + i])
        y /= (radii[e, m] + radius[c]) ** 2
        for i in range(3):
            n[i] -= sign * y * W[3 * m + i]
    size = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
    for i in range(3):
        n[i] /= size
        point[i] = segment[c, i] + t * segment[c, 3 + i] + sign * radius[c] * n[i]


@jit
def _start_between(world, radii, a, b, n):  # type: ignore[no-untyped-def]
    """Fill n (3,) with a first guess of the normal of two ellipsoids.

    x' M^-1 x = 1 is the ellipsoid around their Minkowski difference that touches it where the normal is along the line
    of centres c. The guess is the normal of that ellipsoid scaled until it contains c: M^-1 c. Other arrays as in
    `find_contacts`.
    """
    c, M = np.empty(3), np.zeros((3, 3))
    for i in range(3):
        c[i] = world[b, 9 + i] - world[a, 9 + i]
    ha = hb = 0.0
    for j in range(3):
        along_a = along_b = 0.0
        for i in range(3):
            along_a += c[i] * world[a, 3 * j + i]
            along_b += c[i] * world[b, 3 * j + i]
        ha += (radii[a, j] * along_a) ** 2
        hb += (radii[b, j] * along_b) ** 2
    ratio = np.sqrt(hb / ha)
    for j in range(3):
        in_a, in_b = (1.0 + ratio) * radii[a, j] ** 2, (1.0 + 1.0 / ratio) * radii[b, j] ** 2
        for i in range(3):
            for k in range(3):
                M[i, k] += in_a * world[a, 3 * j + i] * world[a, 3 * j + k]
                M[i, k] += in_b * world[b, 3 * j + i] * world[b, 3 * j + k]
    size = 0.0
    for j in range(3):  # Cramer's rule but for the determinant
        k, m = (j + 1) % 3, (j + 2) % 3
        n[j] = 0.0
        for i in range(3):
            r, s = (i + 1) % 3, (i + 2) % 3
            n[j] += c[i] * (M[r, k] * M[s, m] - M[s, k] * M[r, m])
        size += n[j] ** 2
    size = np.sqrt(size)
    for i in range(3):
        n[i] /= size
