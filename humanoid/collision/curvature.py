"""Compiled kernel: second derivatives of signed distances between placed solids.

The signed distance is the largest gap s(n) = n . (p_b(n) - p_a(n)) over unit vectors n, p_a and p_b being the points of
the solids that lie farthest along n and -n. As the solids move, n moves with them, so that the distance's second
derivative is, with C_a, C_b (3, 3) the derivatives of those points by the normal (the solids' radii of curvature) and
d the distance,

    n . (d2p_b - d2p_a)  -  W_a' C_a W_a  -  W_b' C_b W_b  +  G' (C_a + C_b + d)^-1 G

where W = w x n is how the normal seems to turn for a solid that turns by w, and G = J_b - J_a + C_a W_a + C_b W_b is
how the points part. The last inverse is on the plane across n.
"""

from __future__ import annotations

import numpy as np

from humanoid.support.compiled import jit

UNKNOWN, CAPSULE, ELLIPSOID = 0, 1, 2  # kinds of solids; hulls have edges, and no curvature that would be of use
_STRAIGHT = 1e6  # [m] radius of curvature along a capsule's side, where it has none


@jit
def add_curvature(  # type: ignore[no-untyped-def]
    J, dof_joint, dof_parent, last_dof, solids, kind, world, segment, radius, radii, point_a, point_b, normal, distance,
    factor, hessian,
):  # fmt: skip
    """Add factor_m times the second derivative of distance m, in the tangent space, to hessian (nv, nv).

    J (nv, 6), dof_joint, dof_parent (nv,): see `PosedBody`, `Tree`. last_dof, solids (M, 2): last degrees of freedom of
    both solids of a contact, and these. kind (S,), world (S, 12), segment (S, 6), radius (S,), radii (S, 3): of all
    solids, see `witness.sharpen`. point_a, point_b, normal (M, 3), distance, factor (M,): of the contacts.
    Contacts of a solid of UNKNOWN kind, and those of parts so deep in each other that the gap has no largest, add
    nothing.
    """
    nv = J.shape[0]
    W, G, side, chain = np.zeros((nv, 3)), np.zeros((nv, 3)), np.zeros(nv, np.int64), np.zeros(nv, np.int64)
    C = np.zeros((2, 3, 3))
    speed = np.zeros((nv, 3))
    t1, t2 = np.zeros(3), np.zeros(3)
    for m in range(distance.size):
        a, b = solids[m, 0], solids[m, 1]
        if kind[a] == UNKNOWN or kind[b] == UNKNOWN or factor[m] == 0.0:
            continue
        n = normal[m]
        side_a = _bent(C[0], kind[a], world[a], segment[a], radius[a], radii[a], point_a[m], n, 1.0)
        side_b = _bent(C[1], kind[b], world[b], segment[b], radius[b], radii[b], point_b[m], n, -1.0)
        _across(n, segment[a if side_a or not side_b else b, 3:], side_a or side_b, t1, t2)
        k11 = k12 = k22 = 0.0
        for i in range(3):
            for k in range(3):
                c = C[0, i, k] + C[1, i, k]
                k11 += t1[i] * c * t1[k]
                k12 += t1[i] * c * t2[k]
                k22 += t2[i] * c * t2[k]
        k11 += distance[m]
        k22 += distance[m]
        det = k11 * k22 - k12 * k12
        if not (k11 + k22 > 0.0 and det > 1e-12 * (k11 + k22) ** 2):
            continue
        count, i, j = 0, last_dof[m, 0], last_dof[m, 1]
        while i != j:  # degrees of freedom that move both leave the distance alone
            s = 0 if i > j else 1
            d = i if i > j else j
            p = point_a[m] if s == 0 else point_b[m]
            v, w = J[d, :3], J[d, 3:]
            side[d], chain[count] = s, d
            _cross(w, p, speed[d])
            for x in range(3):
                speed[d, x] += v[x]
            _cross(w, n, W[d])
            for x in range(3):
                G[d, x] = (-1.0 if s == 0 else 1.0) * speed[d, x]
                for y in range(3):
                    G[d, x] += C[s, x, y] * W[d, y]
            count += 1
            if s == 0:
                i = dof_parent[i]
            else:
                j = dof_parent[j]
        for x in range(count):
            d = chain[x]
            g1 = t1[0] * G[d, 0] + t1[1] * G[d, 1] + t1[2] * G[d, 2]
            g2 = t2[0] * G[d, 0] + t2[1] * G[d, 1] + t2[2] * G[d, 2]
            along1, along2 = (k22 * g1 - k12 * g2) / det, (k11 * g2 - k12 * g1) / det
            for y in range(x + 1):
                e = chain[y]
                h = along1 * (t1[0] * G[e, 0] + t1[1] * G[e, 1] + t1[2] * G[e, 2])
                h += along2 * (t2[0] * G[e, 0] + t2[1] * G[e, 1] + t2[2] * G[e, 2])
                if side[d] == side[e]:
                    s = side[d]
                    for r in range(3):
                        for c in range(3):
                            h -= W[d, r] * C[s, r, c] * W[e, c]
                    h += (-1.0 if s == 0 else 1.0) * _carried(J, dof_joint, speed, n, d, e)
                hessian[d, e] += factor[m] * h
                if d != e:
                    hessian[e, d] += factor[m] * h


@jit
def _carried(J, dof_joint, speed, n, d, e):  # type: ignore[no-untyped-def]
    """n . d2p of a point fixed to a solid that d and e (d at or above e) both move; speed (nv, 3): dp by each.

    J (nv, 6), dof_joint (nv,): see `add_curvature`. n (3,): the normal.
    """
    upper, lower = speed[d], speed[e]
    w, v = J[d, 3:], J[e, 3:]
    first = (
        n[0] * (w[1] * lower[2] - w[2] * lower[1])
        + n[1] * (w[2] * lower[0] - w[0] * lower[2])
        + n[2] * (w[0] * lower[1] - w[1] * lower[0])
    )
    if dof_joint[d] != dof_joint[e]:
        return first
    second = (
        n[0] * (v[1] * upper[2] - v[2] * upper[1])
        + n[1] * (v[2] * upper[0] - v[0] * upper[2])
        + n[2] * (v[0] * upper[1] - v[1] * upper[0])
    )
    return 0.5 * (first + second)


@jit
def _bent(C, kind, world, segment, radius, radii, point, n, sign):  # type: ignore[no-untyped-def]
    """Fill C (3, 3) [m] with the derivative of a solid's farthest point along sign n (3,) by that direction; whether
    the point lies on the side of a capsule, between its ends.

    world (12,), segment (6,), radii (3,): of the solid. point (3,): where it is touched.
    """
    if kind == ELLIPSOID:
        h = 0.0
        u = np.zeros(3)
        for k in range(3):
            along = world[3 * k] * n[0] + world[3 * k + 1] * n[1] + world[3 * k + 2] * n[2]
            h += (radii[k] * along) ** 2
            for i in range(3):
                u[i] += radii[k] ** 2 * along * world[3 * k + i]
        h = np.sqrt(h)
        for i in range(3):
            for j in range(3):
                s = -u[i] * u[j] / h**3
                for k in range(3):
                    s += radii[k] ** 2 * world[3 * k + i] * world[3 * k + j] / h
                C[i, j] = s
        return False
    uu, along, across = 0.0, 0.0, 0.0
    for i in range(3):
        uu += segment[3 + i] ** 2
        along += (point[i] - sign * radius * n[i] - segment[i]) * segment[3 + i]
        across += segment[3 + i] * n[i]
    on_side = uu > 0.0 and abs(along) < (1.0 - 1e-9) * uu
    straight = _STRAIGHT / uu if on_side else 0.0
    for i in range(3):
        for j in range(3):
            e, f = segment[3 + i] - across * n[i], segment[3 + j] - across * n[j]
            C[i, j] = radius * ((1.0 if i == j else 0.0) - n[i] * n[j]) + straight * e * f
    return on_side


@jit
def _across(n, axis, along, t1, t2):  # type: ignore[no-untyped-def]
    """Fill t1 (3,), t2 (3,), unit vectors across n (3,) and each other, t1 `along` the axis (3,) if requested: the
    straight side of a capsule is then in one entry of the matrix to be inverted."""
    least = 0
    for i in range(3):
        if abs(n[i]) < abs(n[least]):
            least = i
    for i in range(3):
        t2[i] = axis[i] if along else (1.0 if i == least else 0.0)
    across = n[0] * t2[0] + n[1] * t2[1] + n[2] * t2[2]
    size = 0.0
    for i in range(3):
        t1[i] = t2[i] - across * n[i]
        size += t1[i] ** 2
    for i in range(3):
        t1[i] /= np.sqrt(size)
    _cross(n, t1, t2)


@jit
def _cross(a, b, out):  # type: ignore[no-untyped-def]
    """Fill out (3,) with a (3,) x b (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
