"""Points of the body with image features assigned to them, in one camera: compiled kernels."""

from __future__ import annotations

import numpy as np

from estimator.data.cameras.projection import add_projection_curvature, project_point, project_with_jacobian
from estimator.energy.kernels.keypoints import BEHIND
from estimator.energy.kernels.points import to_world
from estimator.numerics.robust import rho
from humanoid.support.compiled import jit


@jit
def assigned_loads(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, first, target, precision, weight, kind, nu, exact, points,
    force, load,
):  # fmt: skip
    """Value of assigned image points of one camera, 1/2 sum weight rho(e' W e) with e = target - projection.

    placements (njoints, 12); joints (N,), local (N, 3): points on joints. The camera: intrinsics (5,), distortion
    (5,) or (1, 22), R (3, 3), t (3,). first (N + 1,): point n has the assignments first[n] to first[n + 1] - 1. target
    (A, 2) [px], precision (A, 3) the entries xx, xy, yy of W, weight (A,), kind (A,), nu (A,). Fills the points in the
    world (N, 3), and gradient `force` (N, 3) and Hessian `load` (N, 3, 3) of the value with respect to them.
    """
    value = 0.0
    J = np.zeros((2, 3))
    for n in range(joints.shape[0]):
        p, f, W = points[n], force[n], load[n]
        to_world(placements[joints[n]], local[n], p)
        f[:] = 0.0
        W[:] = 0.0
        u, v, visible = project_with_jacobian(p, intrinsics, distortion, R, t, J)
        gx, gy, hxx, hxy, hyy = 0.0, 0.0, 0.0, 0.0, 0.0
        for a in range(first[n], first[n + 1]):
            if not visible:
                value += 0.5 * weight[a] * rho(kind[a], BEHIND, nu[a])[0]
                continue
            ex, ey = target[a, 0] - u, target[a, 1] - v
            px = precision[a, 0] * ex + precision[a, 1] * ey
            py = precision[a, 1] * ex + precision[a, 2] * ey
            cost, slope, bending = rho(kind[a], ex * px + ey * py, nu[a])
            value += 0.5 * weight[a] * cost
            pull = weight[a] * slope
            curve = 2.0 * weight[a] * bending if exact else 0.0
            gx -= pull * px
            gy -= pull * py
            hxx += pull * precision[a, 0] + curve * px * px
            hxy += pull * precision[a, 1] + curve * px * py
            hyy += pull * precision[a, 2] + curve * py * py
        if hxx == 0.0 and hxy == 0.0 and hyy == 0.0:
            continue
        for i in range(3):
            f[i] = gx * J[0, i] + gy * J[1, i]
            left, right = hxx * J[0, i] + hxy * J[1, i], hxy * J[0, i] + hyy * J[1, i]
            for k in range(3):
                W[i, k] = left * J[0, k] + right * J[1, k]
        if exact:
            add_projection_curvature(p, intrinsics, distortion, R, t, gx, gy, W)
    return value


@jit
def charge(a, visible, u, v, target, precision, weight, kind, nu):  # type: ignore[no-untyped-def]
    """Energy of assignment a of target (A, 2), precision (A, 3), weight, kind, nu (A,) with its point at u, v."""
    square = BEHIND
    if visible:
        ex, ey = target[a, 0] - u, target[a, 1] - v
        px = precision[a, 0] * ex + precision[a, 1] * ey
        py = precision[a, 1] * ex + precision[a, 2] * ey
        square = ex * px + ey * py
    return 0.5 * weight[a] * rho(kind[a], square, nu[a])[0]


@jit
def assigned_values(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, first, target, precision, weight, kind, nu, values
):
    """Fill values (S,) with those of `assigned_loads` for placements (S, njoints, 12)."""
    p = np.empty(3)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(joints.shape[0]):
            to_world(placements[s, joints[n]], local[n], p)
            u, v, visible = project_point(p, intrinsics, distortion, R, t)
            for a in range(first[n], first[n + 1]):
                value += charge(a, visible, u, v, target, precision, weight, kind, nu)
        values[s] = value


@jit
def group_by_point(point, count):  # type: ignore[no-untyped-def]
    """Sort assignments to point (A,), of `count` points: the points used (U,), where the assignments of each start
    (U + 1,), and the order of the assignments (A,); equal points keep theirs."""
    at = np.zeros(count + 1, np.int64)
    for p in point:
        at[p + 1] += 1
    used, first, order = np.empty(count, np.int64), np.empty(count + 1, np.int64), np.empty(len(point), np.int64)
    users, total = 0, 0
    for p in range(count):
        many = at[p + 1]
        if many > 0:
            used[users], first[users] = p, total
            users += 1
        at[p] = total
        total += many
    first[users] = total
    for a in range(len(point)):
        order[at[point[a]]] = a
        at[point[a]] += 1
    return used[:users], first[: users + 1], order


@jit
def value_here(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, point, target, precision, weight, kind, nu
):
    """The value of `assigned_values` for placements (njoints, 12) and assignments in any order: point (A,) is the index
    of each one's point, target (A, 2), precision (A, 3), weight, kind, nu (A,); joints (N,), local (N, 3)."""
    used, first, order = group_by_point(point, joints.shape[0])
    p = np.empty(3)
    value = 0.0
    for n in range(used.shape[0]):
        to_world(placements[joints[used[n]]], local[used[n]], p)
        u, v, visible = project_point(p, intrinsics, distortion, R, t)
        for k in range(first[n], first[n + 1]):
            value += charge(order[k], visible, u, v, target, precision, weight, kind, nu)
    return value


@jit
def in_order(order, target, precision, weight, kind, nu):  # type: ignore[no-untyped-def]
    """Assignments (A,) rearranged by order (A,): target (A, 2), precision (A, 3), weight, kind, nu (A,)."""
    return target[order], precision[order], weight[order], kind[order], nu[order]
