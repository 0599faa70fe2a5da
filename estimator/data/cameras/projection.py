"""The projection as compiled kernels: pinhole and lens, OpenCV's conventions, and parallel cameras.

A camera is four arrays, see `Camera.arrays`: intrinsics (5,) fx, fy, cx, cy, skew [px]; distortion, the lens as
`estimator.data.cameras.lens` has it: (5,) k1, k2, p1, p2, k3 (Brown 1966), (1, 22) of any other model, (1, 1, 22) where
cameras may be parallel; R (3, 3) and t (3,) [m] camera from world. Brown's derivatives stand here, those of the other
models with their lens. Of a parallel camera the intrinsics are fx, fy, skew [px/m] and cx, cy [px]: the pixel is linear
in the point, and every point has one, whatever its depth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.lens import bent_curvatures, bent_slopes, distorted, is_parallel, of_one_size, row_of
from humanoid.support.compiled import jit

MIN_DEPTH = 0.05  # m in front of a camera; nearer landmarks have no projection: their derivatives grow without bound


def pack_cameras(cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The arrays of several cameras: intrinsics (C, 5), distortion (C, 5), (C, 1, 22) or (C, 1, 1, 22), R (C, 3, 3),
    t (C, 3)."""
    if not cameras:
        return np.zeros((0, 5)), np.zeros((0, 5)), np.zeros((0, 3, 3)), np.zeros((0, 3))
    intrinsics, lenses, R, t = zip(*(c.arrays for c in cameras), strict=True)
    return np.array(intrinsics), of_one_size(list(lenses)), np.array(R), np.array(t)


_distorted = jit(distorted)

AWAY = 1e3
"""The distance before a parallel camera's plane from which depths of occlusion are counted [m]."""


@jit
def nearness(depth, parallel):  # type: ignore[no-untyped-def]
    """Nearness, which is linear in the picture along a straight line in space, positive, and larger for nearer points:
    1 / depth, or 2 AWAY - depth for a parallel camera. It is its own inverse."""
    if parallel:
        return 2.0 * AWAY - depth
    return 1.0 / depth


@jit
def in_camera(p, R, t):  # type: ignore[no-untyped-def]
    """World point p (3,) in the frame of a camera with rotation R (3, 3) and translation t (3,): x, y, z [m]."""
    x = R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2] + t[0]
    y = R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2] + t[1]
    z = R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2]
    return x, y, z


@jit
def project_point(p, intrinsics, distortion, R, t):  # type: ignore[no-untyped-def]
    """World point p (3,) -> u, v [px] and whether it is in front of the camera; zeros where it is not.

    The camera: intrinsics (5,), distortion (5,), (1, 22) or (1, 1, 22), R (3, 3), t (3,).
    """
    x, y, z = in_camera(p, R, t)
    return project_from_camera(x, y, z, intrinsics, distortion)


@jit
def project_from_camera(x, y, z, intrinsics, distortion):  # type: ignore[no-untyped-def]
    """`project_point` of a point x, y, z [m] in the frame of the camera."""
    if is_parallel(distortion):
        u, v = parallel_pixel(x, y, intrinsics)
        return u, v, True
    if z < MIN_DEPTH:
        return 0.0, 0.0, False
    ad, bd = _distorted(x / z, y / z, distortion)
    return intrinsics[0] * ad + intrinsics[4] * bd + intrinsics[2], intrinsics[1] * bd + intrinsics[3], True


@jit
def parallel_pixel(x, y, intrinsics):  # type: ignore[no-untyped-def]
    """u, v [px] of a point x, y [m] in the frame of a parallel camera with intrinsics (5,)."""
    return intrinsics[0] * x + intrinsics[4] * y + intrinsics[2], intrinsics[1] * y + intrinsics[3]


@jit
def project_with_jacobian(p, intrinsics, distortion, R, t, image_jacobian):  # type: ignore[no-untyped-def]
    """`project_point`; fills image_jacobian (2, 3), d pixel / d p [px/m], where p is in front of the camera."""
    x, y, z = in_camera(p, R, t)
    if is_parallel(distortion):
        return _parallel_with_jacobian(x, y, intrinsics, R, image_jacobian)
    if z < MIN_DEPTH:
        return 0.0, 0.0, False
    a, b = x / z, y / z
    ad, bd = _distorted(a, b, distortion)
    if distortion.ndim >= 2:
        ad_a, ad_b, bd_a, bd_b = bent_slopes(a, b, row_of(distortion))
    else:
        k1, k2, p1, p2, k3 = distortion[0], distortion[1], distortion[2], distortion[3], distortion[4]
        r2 = a * a + b * b
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)  # d radial / d r2
        ad_a = radial + 2.0 * a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a
        ad_b = 2.0 * a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
        bd_a = ad_b
        bd_b = radial + 2.0 * b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a
    fx, fy, skew = intrinsics[0], intrinsics[1], intrinsics[4]
    u_a, u_b = fx * ad_a + skew * bd_a, fx * ad_b + skew * bd_b
    v_a, v_b = fy * bd_a, fy * bd_b
    for k in range(3):
        da = (R[0, k] - a * R[2, k]) / z
        db = (R[1, k] - b * R[2, k]) / z
        image_jacobian[0, k] = u_a * da + u_b * db
        image_jacobian[1, k] = v_a * da + v_b * db
    return fx * ad + skew * bd + intrinsics[2], fy * bd + intrinsics[3], True


@jit
def _parallel_with_jacobian(x, y, intrinsics, R, image_jacobian):  # type: ignore[no-untyped-def]
    """`project_with_jacobian` of a parallel camera, from places x, y [m] in it: R (3, 3), intrinsics (5,); fills
    image_jacobian (2, 3)."""
    fx, fy, skew = intrinsics[0], intrinsics[1], intrinsics[4]
    for k in range(3):
        image_jacobian[0, k] = fx * R[0, k] + skew * R[1, k]
        image_jacobian[1, k] = fy * R[1, k]
    u, v = parallel_pixel(x, y, intrinsics)
    return u, v, True


@jit
def add_projection_curvature(p, intrinsics, distortion, R, t, gu, gv, weight):  # type: ignore[no-untyped-def]
    """Add gu d2u + gv d2v, the second derivatives of the pixel by the world point p (3,), to weight (3, 3) [1/m^2].

    gu, gv [1/px]: an energy's derivatives by the pixel. The camera as for `project_point`; p is in front of it. A
    parallel camera adds nothing, its pixel being linear.
    """
    if is_parallel(distortion):
        return
    x, y, z = in_camera(p, R, t)
    a, b = x / z, y / z
    ga, gb = gu * intrinsics[0], gu * intrinsics[4] + gv * intrinsics[1]  # by the distorted ray
    if distortion.ndim >= 2:
        row = row_of(distortion)
        ad_a, ad_b, bd_a, bd_b = bent_slopes(a, b, row)
        ad_aa, ad_ab, ad_bb, bd_aa, bd_ab, bd_bb = bent_curvatures(a, b, row)
        by_a, by_b = ga * ad_a + gb * bd_a, ga * ad_b + gb * bd_b
        by_aa, by_ab, by_bb = ga * ad_aa + gb * bd_aa, ga * ad_ab + gb * bd_ab, ga * ad_bb + gb * bd_bb
    else:
        k1, k2, p1, p2, k3 = distortion[0], distortion[1], distortion[2], distortion[3], distortion[4]
        r2 = a * a + b * b
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)  # d radial / d r2
        bend = 2.0 * k2 + 6.0 * r2 * k3
        mixed = 2.0 * a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
        by_a = ga * (radial + 2.0 * a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a) + gb * mixed
        by_b = ga * mixed + gb * (radial + 2.0 * b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a)
        aab = 2.0 * b * slope + 4.0 * a * a * b * bend + 2.0 * p1
        abb = 2.0 * a * slope + 4.0 * a * b * b * bend + 2.0 * p2
        by_aa = ga * (6.0 * a * slope + 4.0 * a * a * a * bend + 6.0 * p2) + gb * aab
        by_ab = ga * aab + gb * abb
        by_bb = ga * abb + gb * (6.0 * b * slope + 4.0 * b * b * b * bend + 6.0 * p1)
    for i in range(3):
        da_i, db_i = (R[0, i] - a * R[2, i]) / z, (R[1, i] - b * R[2, i]) / z
        for k in range(i + 1):
            da_k, db_k = (R[0, k] - a * R[2, k]) / z, (R[1, k] - b * R[2, k]) / z
            s = by_aa * da_i * da_k + by_ab * (da_i * db_k + db_i * da_k) + by_bb * db_i * db_k
            s -= (by_a * (da_i * R[2, k] + da_k * R[2, i]) + by_b * (db_i * R[2, k] + db_k * R[2, i])) / z
            weight[i, k] += s
            if k != i:
                weight[k, i] += s
