"""One camera's view of a surface in one compiled call: the kernels beside this file, one after the other."""

from __future__ import annotations

import numpy as np

from estimator.data.cameras.lens import is_parallel
from estimator.vision.seeing import see_nodes, see_points
from estimator.vision.visibility import (
    classify_contours,
    classify_nodes,
    contour_points,
    fill_buffer,
    frame_buffer,
)
from humanoid.support.compiled import jit

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
