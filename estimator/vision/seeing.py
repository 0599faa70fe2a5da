"""View of the body's points by a camera: places, depth, and whether they face it; compiled kernels."""

from __future__ import annotations

import math

import numpy as np

from estimator.data.cameras.lens import is_parallel
from estimator.data.cameras.projection import AWAY, project_point, project_with_jacobian
from estimator.energy.kernels.points import to_world, turn
from humanoid.support.compiled import jit


@jit
def see_points(  # type: ignore[no-untyped-def]
    placements, joints, local, normals, intrinsics, distortion, R, t, world, pixels, depth, facing, image_normals
):
    """Project points of the body with one camera: intrinsics (5,), distortion, the lens, (5,), (1, 22) or (1, 1, 22), R
    (3, 3), t (3,).

    placements (njoints, 12); joints (N,), local, normals (N, 3): points, and their outward normals, on joints.

    Fills their places in the world (N, 3), pixels (N, 2), depth (N,) [m] (negative where there is no image; of a
    parallel camera counted from `AWAY` before its plane, so that it is positive everywhere), `facing` (N,): cosine
    between the outward normal and the viewing ray, negative on the front, and image_normals (N, 2): the unit direction
    of the normal in the image.
    """
    image_jacobian = np.zeros((2, 3))
    n = np.zeros(3)
    for i in range(joints.shape[0]):
        M = placements[joints[i]]
        p = world[i]
        to_world(M, local[i], p)
        turn(M, normals[i], n)
        u, v, visible = project_with_jacobian(p, intrinsics, distortion, R, t, image_jacobian)
        pixels[i, 0], pixels[i, 1] = u, v
        z, facing[i] = _depth_and_facing(p, n, distortion, R, t)
        depth[i] = z if visible else -1.0
        a = image_jacobian[0, 0] * n[0] + image_jacobian[0, 1] * n[1] + image_jacobian[0, 2] * n[2]
        b = image_jacobian[1, 0] * n[0] + image_jacobian[1, 1] * n[1] + image_jacobian[1, 2] * n[2]
        length = max(math.sqrt(a * a + b * b), 1e-12)
        image_normals[i, 0], image_normals[i, 1] = a / length, b / length


@jit
def see_nodes(  # type: ignore[no-untyped-def]
    placements, joints, local, normals, intrinsics, distortion, R, t, pixels, depth, facing
):
    """`see_points` of what has no direction in the image: fills pixels (N, 2), depth (N,) and facing (N,)."""
    p, n = np.empty(3), np.empty(3)
    for i in range(joints.shape[0]):
        M = placements[joints[i]]
        to_world(M, local[i], p)
        turn(M, normals[i], n)
        pixels[i, 0], pixels[i, 1], visible = project_point(p, intrinsics, distortion, R, t)
        z, facing[i] = _depth_and_facing(p, n, distortion, R, t)
        depth[i] = z if visible else -1.0


@jit
def _depth_and_facing(p, n, lens, R, t):  # type: ignore[no-untyped-def]
    """Depth [m] of a point p (3,) in the world, and the cosine between its normal n (3,) and its viewing ray.

    lens (5,), (1, 22) or (1, 1, 22). R (3, 3), t (3,): world to camera.
    """
    if is_parallel(lens):  # all rays are along the axis
        away = R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2]
        return AWAY + away, R[2, 0] * n[0] + R[2, 1] * n[1] + R[2, 2] * n[2]
    along, square, z = 0.0, 0.0, t[2]
    for k in range(3):
        ray = p[k] + R[0, k] * t[0] + R[1, k] * t[1] + R[2, k] * t[2]
        along += n[k] * ray
        square += ray * ray
        z += R[2, k] * p[k]
    return z, along / math.sqrt(square)
