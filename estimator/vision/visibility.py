"""Which nodes of a surface a camera sees, and where the surface's occluding contours lie: compiled kernels.

Depth is compared in a buffer of cells, a few pixels wide, over the body's rectangle in the image: fine enough to
separate parts, small enough to be filled for every hypothesis.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.data.cameras.projection import nearness as nearness_at
from humanoid.support.compiled import jit

VISIBLE, BACK_FACING, OCCLUDED, OUTSIDE = 0, 1, 2, 3
"""States of a node: assigned, self-occluded by its own part's front, hidden by another part, not in the image."""
OUTER, INNER, HIDDEN = 0, 1, 2
"""States of a contour point: on the body's outline, in front of another part, hidden or inside a joint's overlap."""


@jit
def frame_buffer(pixels, depth, fineness, frame):  # type: ignore[no-untyped-def]
    """Choose the buffer's rectangle: fills frame (3,) = left, top, cell size [px]; returns its rows and columns.

    pixels (N, 2) [px], depth (N,) [m], negative where there is no image.
    About `fineness` cells, never finer than a pixel; one cell of margin on every side.
    """
    left, top, right, bottom = 1e9, 1e9, -1e9, -1e9
    for i in range(pixels.shape[0]):
        if depth[i] > 0.0:
            left, right = min(left, pixels[i, 0]), max(right, pixels[i, 0])
            top, bottom = min(top, pixels[i, 1]), max(bottom, pixels[i, 1])
    if right < left:
        frame[0], frame[1], frame[2] = 0.0, 0.0, 1.0
        return 1, 1
    cell = max(1.0, math.sqrt((right - left + 1.0) * (bottom - top + 1.0) / fineness))
    frame[0], frame[1], frame[2] = left - 1.5 * cell, top - 1.5 * cell, cell
    return int((bottom - top) / cell) + 4, int((right - left) / cell) + 4


@jit
def part_at(owner, frame, x, y):  # type: ignore[no-untyped-def]
    """The part of owner (rows, columns) at x, y [px] of the image, -1 for none; frame (3,): see `frame_buffer`."""
    row, column = math.floor((y - frame[1]) / frame[2] + 0.5), math.floor((x - frame[0]) / frame[2] + 0.5)
    return owner[row, column] if 0 <= row < owner.shape[0] and 0 <= column < owner.shape[1] else -1


@jit
def fill_buffer(pixels, depth, part, faces, parallel, frame, nearness, owner):  # type: ignore[no-untyped-def]
    """Draw the front-facing triangles: nearness (rows, columns) the largest 1 / depth (of a parallel camera, see
    `estimator.data.cameras.projection.nearness`), owner (rows, columns) its part or -1.

    pixels (N, 2) [px], depth (N,) [m], part (N,): of the vertices. faces (F, 3). parallel: whether the
    camera is. frame (3,): see `frame_buffer`.
    Every part is closed, so its front hides as much as front and back together.
    """
    nearness[:] = 0.0
    owner[:] = -1
    left, top, cell = frame[0], frame[1], frame[2]
    rows, columns = nearness.shape
    place, inverse = np.empty(pixels.shape), np.empty(pixels.shape[0])
    for i in range(pixels.shape[0]):
        place[i, 0], place[i, 1] = (pixels[i, 0] - left) / cell, (pixels[i, 1] - top) / cell
        inverse[i] = nearness_at(depth[i], parallel)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if depth[a] <= 0.0 or depth[b] <= 0.0 or depth[c] <= 0.0:
            continue
        ax, ay = place[a, 0], place[a, 1]
        bx, by = place[b, 0] - ax, place[b, 1] - ay
        cx, cy = place[c, 0] - ax, place[c, 1] - ay
        area = bx * cy - by * cx
        if area > -1e-12:  # counter-clockwise from outside is clockwise with y down: negative on the front
            continue
        x0, x1 = max(0, math.ceil(ax + min(0.0, bx, cx))), min(columns - 1, math.floor(ax + max(0.0, bx, cx)))
        y0, y1 = max(0, math.ceil(ay + min(0.0, by, cy))), min(rows - 1, math.floor(ay + max(0.0, by, cy)))
        if x0 > x1 or y0 > y1:
            continue
        na, nb, nc = inverse[a], inverse[b], inverse[c]
        vx, wx = cy / area, -by / area  # change of the weights of b and c from column to column
        for y in range(y0, y1 + 1):
            v = ((x0 - ax) * cy - (y - ay) * cx) / area
            w = (bx * (y - ay) - by * (x0 - ax)) / area
            for x in range(x0, x1 + 1):
                near = na + v * (nb - na) + w * (nc - na)
                # one branch instead of four: its direction is unpredictable, and that costs most
                if (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1.0 + 1e-9) & (near > nearness[y, x]):
                    nearness[y, x] = near
                    owner[y, x] = part[a]
                v += vx
                w += wx


@jit
def classify_nodes(pixels, depth, facing, part, convex, parallel, frame, nearness, owner, width, height, gap, state):  # type: ignore[no-untyped-def]
    """Fill `state` (N,) and return how many nodes are back-facing and how many are occluded.

    pixels (N, 2) [px], depth (N,) [m], facing (N,) and part (N,): of the nodes; see `see_points`. convex (P,): whether
    a part is. parallel, frame, nearness, owner: see `fill_buffer`. width, height: of the image [px].
    A node is occluded where the buffer holds a surface nearer by more than `gap` [m] of another part, or of its own if
    that is not convex.
    """
    back, hidden = 0, 0
    left, top, cell = frame[0], frame[1], frame[2]
    for i in range(pixels.shape[0]):
        inside = -0.5 <= pixels[i, 0] <= width - 0.5 and -0.5 <= pixels[i, 1] <= height - 0.5
        if depth[i] <= 0.0:
            state[i] = OUTSIDE
        elif facing[i] >= 0.0:
            state[i] = BACK_FACING
            back += 1
        else:
            x = int((pixels[i, 0] - left) / cell + 0.5)
            y = int((pixels[i, 1] - top) / cell + 0.5)
            other = owner[y, x]
            state[i] = VISIBLE if inside else OUTSIDE
            if (
                other >= 0
                and (other != part[i] or not convex[part[i]])
                and depth[i] - nearness_at(nearness[y, x], parallel) > gap
            ):
                state[i] = OCCLUDED
                hidden += 1
    return back, hidden


@jit
def contour_points(edges, local, normal, depth, facing, every, points, normals, between, share):  # type: ignore[no-untyped-def]
    """Points where mesh edges (E, 2) pass from front to back, all or every second, third...; returns how many.

    local, normal (N, 3), depth, facing (N,): of the nodes, in their joints' frames, see `see_points`.
    Fills points (M, 3) and normals (M, 3) in their joints' frames, the nodes `between` (M, 2) which they lie and the
    `share` (M,) of the way.

    The point lies where the facing interpolated along the edge is zero, lifted off the chord towards the smooth surface
    by the tangent planes at the edge's ends (as in Phong tessellation, Boubekeur and Alexa 2008): by half, which is
    exact to second order in the edge's length.
    """
    count, passed = 0, 0
    chord, normal_here = np.zeros(3), np.zeros(3)
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        if (facing[a] < 0.0) == (facing[b] < 0.0) or depth[a] <= 0.0 or depth[b] <= 0.0:
            continue
        passed += 1
        if (passed - 1) % every != 0:
            continue
        s = facing[a] / (facing[a] - facing[b])
        over_a, over_b, square = 0.0, 0.0, 0.0
        for k in range(3):
            chord[k] = (1.0 - s) * local[a, k] + s * local[b, k]
            normal_here[k] = (1.0 - s) * normal[a, k] + s * normal[b, k]
            square += normal_here[k] * normal_here[k]
        for k in range(3):
            over_a += (chord[k] - local[a, k]) * normal[a, k]
            over_b += (chord[k] - local[b, k]) * normal[b, k]
        length = max(math.sqrt(square), 1e-9)
        for k in range(3):
            lifted = (1.0 - s) * over_a * normal[a, k] + s * over_b * normal[b, k]
            points[count, k] = chord[k] - 0.5 * lifted
            normals[count, k] = normal_here[k] / length
        between[count, 0], between[count, 1], share[count] = a, b, s
        count += 1
        if count == points.shape[0]:
            break
    return count


@jit
def classify_contours(  # type: ignore[no-untyped-def]
    pixels, depth, image_normals, parts, parallel, frame, nearness, owner, width, height, gap, joined, state
):
    """Fill the `state` (M,) of contour points by what the buffer holds just outside and just inside of them.

    pixels, image_normals (M, 2), depth, parts (M,): of the contour points. parallel, frame,
    nearness, owner: see `fill_buffer`.
    gap [m]: surfaces nearer by more hide the point. joined [m]: a surface behind by less continues this one.
    """
    left, top, cell = frame[0], frame[1], frame[2]
    rows, columns = owner.shape
    for i in range(pixels.shape[0]):
        state[i] = HIDDEN
        u, v = pixels[i, 0], pixels[i, 1]
        if depth[i] <= 0.0 or not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
            continue
        reach = 0.8 * cell  # more than half a cell's diagonal: never in the point's own cells
        xo = int((u + reach * image_normals[i, 0] - left) / cell + 0.5)
        yo = int((v + reach * image_normals[i, 1] - top) / cell + 0.5)
        xi = min(max(int((u - reach * image_normals[i, 0] - left) / cell + 0.5), 0), columns - 1)
        yi = min(max(int((v - reach * image_normals[i, 1] - top) / cell + 0.5), 0), rows - 1)
        if (
            owner[yi, xi] >= 0
            and owner[yi, xi] != parts[i]
            and depth[i] - nearness_at(nearness[yi, xi], parallel) > gap
        ):
            continue
        if not (0 <= xo < columns and 0 <= yo < rows) or owner[yo, xo] < 0:
            state[i] = OUTER
        elif nearness_at(nearness[yo, xo], parallel) - depth[i] > joined:
            state[i] = INNER
