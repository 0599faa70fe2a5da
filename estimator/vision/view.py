"""One camera's view of a surface in one compiled call: places, depth, and whether points face the camera."""

from __future__ import annotations

import math

import numpy as np

from estimator.data.cameras.lens import is_parallel
from estimator.data.cameras.projection import AWAY, project_point, project_with_jacobian
from estimator.energy.kernels.points import to_world, turn
from estimator.vision.visibility import (
    classify_contours,
    classify_nodes,
    contour_points,
    fill_buffer,
    frame_buffer,
)
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


GAP = 0.02  # m; a node this much behind another part's front is hidden
JOINED = 0.05  # m; a part this little behind a contour continues the surface: no edge is seen there


@jit
def view_of_nodes(  # type: ignore[no-untyped-def]
    placements, joints, local, normals, part, convex, faces, intrinsics, distortion, R, t, width, height, fineness
):
    """The view of the nodes and their occlusion; the arguments are those of `see_nodes`, `fill_buffer` and the others.

    placements (njoints, 12); joints, part (N,), local, normals (N, 3): nodes; convex (B,); faces (F, 3).
    Returns pixels (N, 2), depth, facing, state (N,), how many nodes are back-facing and how many occluded, nearness and
    owner (rows, columns), and frame (3,).
    """
    count = len(joints)
    pixels, depth, facing = np.empty((count, 2)), np.empty(count), np.empty(count)
    see_nodes(placements, joints, local, normals, intrinsics, distortion, R, t, pixels, depth, facing)
    frame, state, parallel = np.empty(3), np.empty(count, np.int8), is_parallel(distortion)
    rows, columns = frame_buffer(pixels, depth, fineness, frame)
    nearness, owner = np.empty((rows, columns)), np.empty((rows, columns), np.int32)
    fill_buffer(pixels, depth, part, faces, parallel, frame, nearness, owner)
    back, hidden = classify_nodes(
        pixels, depth, facing, part, convex, parallel, frame, nearness, owner, width, height, GAP, state
    )
    return pixels, depth, facing, state, back, hidden, nearness, owner, frame


@jit
def view_of_contours(  # type: ignore[no-untyped-def]
    placements, edges, joints, local, normals, part, depth, facing, frame, nearness, owner, intrinsics, distortion, R,
    t, width, height, most, every,
):  # fmt: skip
    """The occluding contours of nodes that `view_of_nodes` has seen; edges (E, 2): the mesh's.

    Returns the points' joint (M,), local (M, 3), pixels (M, 2), image normals (M, 2), state (M,), nodes (M, 2) and
    share (M,), see `Contours`; at most `most` points, of those there are one in `every`.
    """
    points, point_normals = np.empty((most, 3)), np.empty((most, 3))
    nodes, share = np.empty((most, 2), np.int64), np.empty(most)
    count = contour_points(edges, local, normals, depth, facing, every, points, point_normals, nodes, share)
    nodes, points = nodes[:count], points[:count]
    joint, own = joints[nodes[:, 0]], part[nodes[:, 0]]
    world, pixels, image_normals = np.empty((count, 3)), np.empty((count, 2)), np.empty((count, 2))
    there, ahead, state = np.empty(count), np.empty(count), np.empty(count, np.int8)
    see_points(
        placements, joint, points, point_normals[:count], intrinsics, distortion, R, t, world, pixels, there, ahead,
        image_normals,
    )  # fmt: skip
    classify_contours(
        pixels,
        there,
        image_normals,
        own,
        is_parallel(distortion),
        frame,
        nearness,
        owner,
        width,
        height,
        GAP,
        JOINED,
        state,
    )
    return joint, points, pixels, image_normals, state, nodes, share[:count]
