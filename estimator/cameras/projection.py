"""The projection as compiled kernels: pinhole with Brown's distortion (Brown 1966), OpenCV's conventions.

A camera is four arrays, see `Camera.arrays`: intrinsics (5,) fx, fy, cx, cy, skew [px]; distortion (5,) k1, k2, p1, p2,
k3; R (3, 3) and t (3,) [m] camera from world.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.cameras.camera import Camera, distorted
from humanoid.support.compiled import jit

MIN_DEPTH = 0.05  # m in front of a camera; nearer landmarks have no projection: their derivatives grow without bound


def pack_cameras(cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The arrays of several cameras: intrinsics, distortion (C, 5), R (C, 3, 3), t (C, 3)."""
    intrinsics, distortion, R, t = (np.array(each) for each in zip(*(c.arrays for c in cameras), strict=True))
    return intrinsics, distortion, R, t


_distorted = jit(distorted)


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

    The camera: intrinsics (5,), distortion (5,), R (3, 3), t (3,).
    """
    x, y, z = in_camera(p, R, t)
    if z < MIN_DEPTH:
        return 0.0, 0.0, False
    ad, bd = _distorted(x / z, y / z, distortion)
    return intrinsics[0] * ad + intrinsics[4] * bd + intrinsics[2], intrinsics[1] * bd + intrinsics[3], True


@jit
def project_with_jacobian(p, intrinsics, distortion, R, t, image_jacobian):  # type: ignore[no-untyped-def]
    """`project_point`; fills image_jacobian (2, 3), d pixel / d p [px/m], where p is in front of the camera."""
    x, y, z = in_camera(p, R, t)
    if z < MIN_DEPTH:
        return 0.0, 0.0, False
    a, b = x / z, y / z
    ad, bd = _distorted(a, b, distortion)
    k1, k2, p1, p2, k3 = distortion[0], distortion[1], distortion[2], distortion[3], distortion[4]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)  # d radial / d r2
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
