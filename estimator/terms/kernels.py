"""Compiled inner loops of the cost terms, on plain arrays."""

from __future__ import annotations

import math

import numpy as np

from humanoid.support.compiled import jit

GAUSSIAN, LORENTZIAN, LECLERC = 0, 1, 2
BEHIND = 1e4  # squared whitened residual charged for a landmark that is not in front of its camera
MIN_DEPTH = 0.05  # m in front of a camera; nearer landmarks have no projection


@jit
def rho(kind: int, s: float, nu: float) -> tuple[float, float, float]:
    """Value, first and second derivative of the potential at the squared whitened residual s."""
    if kind == LORENTZIAN:
        slope = 1.0 / (1.0 + s / nu)
        return nu * math.log1p(s / nu), slope, -slope * slope / nu
    if kind == LECLERC:
        e = math.exp(-s / nu)
        return nu * (1.0 - e), e, -e / nu
    return s, 1.0, 0.0


@jit
def robust_square(e, precision, kind, nu, exact, pull, bend):  # type: ignore[no-untyped-def]
    """1/2 sum rho(precision e^2), its derivative `pull` and (Gauss-Newton or exact) curvature `bend`, all (nv,)."""
    value = 0.0
    for i in range(e.shape[0]):
        cost, slope, curve = rho(kind, e[i] * e[i] * precision[i], nu)
        value += 0.5 * cost
        pull[i] = slope * precision[i] * e[i]
        bend[i] = precision[i] * (slope + (2.0 * curve * e[i] * e[i] * precision[i] if exact else 0.0))
    return value


@jit
def stabilise(q, q_index, v_index, rest, precision, weight, kind, nu, gradient, hessian, exact):  # type: ignore[no-untyped-def]
    """Value of the stabilisers; adds their gradient (nv,) and diagonal Hessian (nv, nv)."""
    value = 0.0
    for i in range(q_index.shape[0]):
        e = q[q_index[i]] - rest[i]
        cost, slope, bend = rho(kind, e * e * precision[i], nu)
        value += 0.5 * weight * cost
        gradient[v_index[i]] += weight * slope * precision[i] * e
        curvature = slope + 2.0 * bend * e * e * precision[i] if exact else slope
        hessian[v_index[i], v_index[i]] += weight * curvature * precision[i]
    return value


@jit
def tilt(placement, axis, up, precision, weight, kind, nu, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """Value of the pull of R axis (3,) towards up (3,), R from the root's placement (12,); adds its derivatives to the
    root's three angular degrees of freedom, which turn about the root's own axes."""
    u, e = np.zeros(3), np.zeros(3)
    for i in range(3):
        for k in range(3):
            u[i] += placement[3 * k + i] * axis[k]
        e[i] = u[i] - up[i]
    s = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    cost, slope, bending = rho(kind, s * precision, nu)
    pull, curve = weight * slope * precision, 2.0 * weight * bending * precision * precision
    J, along, w_e, w_u = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(3):  # column k: w x u for the root's axis w in the world
        w = placement[3 * k : 3 * k + 3]
        J[0, k] = w[1] * u[2] - w[2] * u[1]
        J[1, k] = w[2] * u[0] - w[0] * u[2]
        J[2, k] = w[0] * u[1] - w[1] * u[0]
        for i in range(3):
            along[k] += J[i, k] * e[i]
            w_e[k] += w[i] * e[i]
            w_u[k] += w[i] * u[i]
        gradient[3 + k] += pull * along[k]
    e_u = e[0] * u[0] + e[1] * u[1] + e[2] * u[2]
    for a in range(3):
        for b in range(3):
            for i in range(3):
                hessian[3 + a, 3 + b] += pull * J[i, a] * J[i, b]
            if exact:  # d2 u = w_a (w_b . u) - u (w_a . w_b), the symmetric half
                second = 0.5 * (w_e[a] * w_u[b] + w_u[a] * w_e[b]) - (e_u if a == b else 0.0)
                hessian[3 + a, 3 + b] += pull * second + curve * along[a] * along[b]
    return 0.5 * weight * cost


@jit
def diffuse(e, precision, kind, nu, exact, ranges, jacobian, pull, bend, gradient, hessian):  # type: ignore[no-untyped-def]
    """Value of the transition; `jacobian` (nv, nv) is the derivative of e, the identity outside the diagonal blocks
    in `ranges` (B, 2)."""
    value = robust_square(e, precision, kind, nu, exact, pull, bend)
    first = 0
    for b in range(ranges.shape[0] + 1):
        start = ranges[b, 0] if b < ranges.shape[0] else e.shape[0]
        for i in range(first, start):
            gradient[i] += pull[i]
            hessian[i, i] += bend[i]
        if b < ranges.shape[0]:
            first = ranges[b, 1]
            for i in range(start, first):
                for m in range(start, first):
                    gradient[i] += jacobian[m, i] * pull[m]
                    for k in range(start, first):
                        hessian[i, k] += jacobian[m, i] * bend[m] * jacobian[m, k]
    return value


@jit
def project_with_jacobian(p, intrinsics, distortion, R, t, image_jacobian):  # type: ignore[no-untyped-def]
    """Project world point p (3,); fills d pixel / d p (2, 3); returns u, v and whether p is in front of the camera."""
    x = R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2] + t[0]
    y = R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2] + t[1]
    z = R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2]
    if z < MIN_DEPTH:
        return 0.0, 0.0, False
    a, b = x / z, y / z
    k1, k2, p1, p2, k3 = distortion[0], distortion[1], distortion[2], distortion[3], distortion[4]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)  # d radial / d r2
    ad = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    bd = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    ad_a = radial + 2.0 * a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a
    ad_b = 2.0 * a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
    bd_b = radial + 2.0 * b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a
    fx, fy, skew = intrinsics[0], intrinsics[1], intrinsics[4]
    u_a, u_b = fx * ad_a + skew * ad_b, fx * ad_b + skew * bd_b
    v_a, v_b = fy * ad_b, fy * bd_b
    for k in range(3):
        da = (R[0, k] - a * R[2, k]) / z
        db = (R[1, k] - b * R[2, k]) / z
        image_jacobian[0, k] = u_a * da + u_b * db
        image_jacobian[1, k] = v_a * da + v_b * db
    return fx * ad + skew * bd + intrinsics[2], fy * bd + intrinsics[3], True


@jit
def see_points(  # type: ignore[no-untyped-def]
    placements, joints, local, normals, intrinsics, distortion, R, t, world, pixels, depth, facing, image_normals
):
    """Look at points of the body with one camera: intrinsics (5,), distortion (5,), R (3, 3), t (3,).

    Fills their places in the world (N, 3), pixels (N, 2), depth (N,) [m] (negative where there is no image), `facing`
    (N,): cosine between the outward normal and the viewing ray, negative on the front, and the unit direction (N, 2) of
    the normal in the image.
    """
    image_jacobian = np.zeros((2, 3))
    n = np.zeros(3)
    for i in range(joints.shape[0]):
        M = placements[joints[i]]
        p = world[i]
        for k in range(3):
            p[k] = M[9 + k]
            n[k] = 0.0
            for m in range(3):
                p[k] += M[3 * m + k] * local[i, m]
                n[k] += M[3 * m + k] * normals[i, m]
        u, v, visible = project_with_jacobian(p, intrinsics, distortion, R, t, image_jacobian)
        pixels[i, 0], pixels[i, 1] = u, v
        along, square, z = 0.0, 0.0, t[2]
        for k in range(3):
            ray = p[k] + R[0, k] * t[0] + R[1, k] * t[1] + R[2, k] * t[2]
            along += n[k] * ray
            square += ray * ray
            z += R[2, k] * p[k]
        depth[i] = z if visible else -1.0
        facing[i] = along / math.sqrt(square)
        a = image_jacobian[0, 0] * n[0] + image_jacobian[0, 1] * n[1] + image_jacobian[0, 2] * n[2]
        b = image_jacobian[1, 0] * n[0] + image_jacobian[1, 1] * n[1] + image_jacobian[1, 2] * n[2]
        length = max(math.sqrt(a * a + b * b), 1e-12)
        image_normals[i, 0], image_normals[i, 1] = a / length, b / length


@jit
def assigned_loads(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, first, target, precision, weight, kind, nu, exact, points,
    force, load,
):  # fmt: skip
    """Value of assigned image points of one camera, 1/2 sum weight rho(e' W e) with e = target - projection.

    Point n has the assignments first[n] to first[n + 1] - 1: target (A, 2) [px], precision (A, 3) the entries xx, xy,
    yy of W, weight (A,), kind (A,), nu (A,). Fills the points in the world (N, 3), and gradient `force` (N, 3) and
    Hessian `load` (N, 3, 3) of the value with respect to them.
    """
    value = 0.0
    J = np.zeros((2, 3))
    for n in range(joints.shape[0]):
        p, f, W = points[n], force[n], load[n]
        M = placements[joints[n]]
        for k in range(3):
            p[k] = M[9 + k] + M[k] * local[n, 0] + M[3 + k] * local[n, 1] + M[6 + k] * local[n, 2]
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
    return value


@jit
def point_loads(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, pixels, confidence, precision, kind, nu, exact, points,
    force, weight,
):  # fmt: skip
    """Value of the term; fills landmarks in the world `points` (L, 3), and the gradient `force` (L, 3) and Hessian
    `weight` (L, 3, 3) of the value with respect to them."""
    value = 0.0
    image_jacobian = np.zeros((2, 3))
    along = np.zeros(3)  # residual pulled back to the point
    for n in range(joints.shape[0]):
        p, f, W = points[n], force[n], weight[n]
        for k in range(3):
            p[k] = placements[joints[n], 9 + k]
            for i in range(3):
                p[k] += placements[joints[n], 3 * i + k] * local[n, i]
        f[:] = 0.0
        W[:] = 0.0
        for c in range(pixels.shape[0]):
            if confidence[c, n] <= 0.0:
                continue
            u, v, visible = project_with_jacobian(p, intrinsics[c], distortion[c], R[c], t[c], image_jacobian)
            if not visible:
                value += 0.5 * confidence[c, n] * rho(kind, BEHIND, nu)[0]
                continue
            ru, rv = pixels[c, n, 0] - u, pixels[c, n, 1] - v
            cost, slope, bending = rho(kind, (ru * ru + rv * rv) * precision[c, n], nu)
            value += 0.5 * confidence[c, n] * cost
            pull = confidence[c, n] * slope * precision[c, n]
            curve = 2.0 * confidence[c, n] * bending * precision[c, n] ** 2 if exact else 0.0
            for k in range(3):
                along[k] = ru * image_jacobian[0, k] + rv * image_jacobian[1, k]
                f[k] -= pull * along[k]
            for i in range(3):
                for k in range(3):
                    square = image_jacobian[0, i] * image_jacobian[0, k] + image_jacobian[1, i] * image_jacobian[1, k]
                    W[i, k] += pull * square + curve * along[i] * along[k]
    return value


@jit
def whitened_distances(points, intrinsics, distortion, R, t, pixels, confidence, precision, out):  # type: ignore[no-untyped-def]
    """Fill `out` (C, L) with the distances of keypoints from projected points (L, 3) in standard deviations."""
    image_jacobian = np.zeros((2, 3))
    for c in range(pixels.shape[0]):
        for n in range(pixels.shape[1]):
            if confidence[c, n] > 0.0:
                u, v, visible = project_with_jacobian(
                    points[n], intrinsics[c], distortion[c], R[c], t[c], image_jacobian
                )
                s = ((pixels[c, n, 0] - u) ** 2 + (pixels[c, n, 1] - v) ** 2) * precision[c, n]
                out[c, n] = np.sqrt(s) if visible else np.inf
