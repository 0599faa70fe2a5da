"""The compiled part of `outline_values`: limbs as cones in an image, their outlines and insides looked up in maps."""

from __future__ import annotations

import math

import numpy as np

from estimator.cameras.projection import in_camera, project_point
from humanoid.support.compiled import jit

INNER, OUTER = 0.55, 1.6  # in half-widths from the axis: where a limb is asked for, and where it should end
CAP = 0.9  # how far a limb goes on beyond its ends, in half-widths there: ends are round


@jit
def project_limb(t, R, z, axes, eye, along, intrinsics, lens, Rc, tc, out):  # type: ignore[no-untyped-def]
    """Fill out (S, 5) with stations of one limb: pixel x, y of its axis, the half-width as a vector in pixels, depth.

    t (3,), R (3, 3): T_world_limb. z (S,) [m]: of the stations; axes (S, 2) [m]: semi-axes there. eye (3,): optical
    centre, or along (3,) the viewing direction of a parallel camera, whose eye is NaN. The camera: intrinsics (5,),
    lens, Rc (3, 3), tc (3,). False where a part of it is behind the camera.

    The half-width is what an elliptic section shows sideways, normal to the axis and to the view.
    """
    point, side = np.empty(3), np.empty(3)
    for s in range(z.shape[0]):
        for c in range(3):
            point[c] = t[c] + R[c, 2] * z[s]
        vx, vy, vz = along[0], along[1], along[2]
        if eye[0] == eye[0]:
            vx, vy, vz = point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]
        wx = R[1, 2] * vz - R[2, 2] * vy
        wy = R[2, 2] * vx - R[0, 2] * vz
        wz = R[0, 2] * vy - R[1, 2] * vx
        size = math.sqrt(wx * wx + wy * wy + wz * wz)
        size = size if size > 1e-9 else 1.0
        a = (wx * R[0, 0] + wy * R[1, 0] + wz * R[2, 0]) / size * axes[s, 0]
        b = (wx * R[0, 1] + wy * R[1, 1] + wz * R[2, 1]) / size * axes[s, 1]
        half = math.sqrt(a * a + b * b) / size
        side[0], side[1], side[2] = point[0] + half * wx, point[1] + half * wy, point[2] + half * wz
        u, v, seen = project_point(point, intrinsics, lens, Rc, tc)
        us, vs, seen_side = project_point(side, intrinsics, lens, Rc, tc)
        if not (seen and seen_side):
            return False
        out[s, 0], out[s, 1], out[s, 2], out[s, 3] = u, v, us - u, vs - v
        out[s, 4] = in_camera(point, Rc, tc)[2]
    return True


@jit
def depth_inside(u, v, limb):  # type: ignore[no-untyped-def]
    """Depth [m] of a limb's axis at a pixel u, v inside of it, infinite outside. limb (S, 5): of `project_limb`."""
    last = limb.shape[0] - 1
    dx, dy = limb[last, 0] - limb[0, 0], limb[last, 1] - limb[0, 1]
    square = dx * dx + dy * dy
    x, y = u - limb[0, 0], v - limb[0, 1]
    share = (x * dx + y * dy) / square if square > 1e-9 else 0.5
    level = min(max(share, 0.0), 1.0)
    hx = limb[0, 2] + level * (limb[last, 2] - limb[0, 2])
    hy = limb[0, 3] + level * (limb[last, 3] - limb[0, 3])
    width = math.sqrt(hx * hx + hy * hy)
    x, y = x - level * dx, y - level * dy
    beyond = math.sqrt(x * x + y * y)
    # beside the axis the distance is across it, beyond an end to that end
    inside = beyond <= (width if level == share else CAP * width)
    return limb[0, 4] + level * (limb[last, 4] - limb[0, 4]) if inside else np.inf


@jit
def _edge_at(u, v, nx, ny, edges, neutral):  # type: ignore[no-untyped-def]
    """Log ratio of an outline with normal (nx, ny) at a pixel u, v, by edges (B, H, W) of orientations from 0 to pi;
    neutral outside of the picture."""
    count, height, width = edges.shape
    x, y = round(u), round(v)
    if x < 0 or y < 0 or x >= width or y >= height:
        return neutral
    angle = math.atan2(ny, nx)
    b = math.floor(angle / math.pi * count + 0.5) % count
    return edges[b, y, x]


@jit
def outline_values(  # type: ignore[no-untyped-def]
    t, R, z, axes, eye, along, intrinsics, lens, Rc, tc, edges, mask, ratios, cells, wanted, weights, values, cover,
):  # fmt: skip
    """Fill values (N, L), what each limb says, and cover (N,), what the foreground that limbs explain says [nats].

    t (N, L, 3), R (N, L, 3, 3): T_world_limb. z (L, S), axes (L, S, 2): stations of the limbs. eye, along (3,),
    intrinsics (5,), lens, Rc (3, 3), tc (3,): the camera, see `project_limb`. edges (B, H, W): log ratios by
    orientation; B is 0 without. mask (H, W): 1 on the foreground, 0 on the background, -1 where nothing is known.
    ratios (2, 2): log ratios on the body and beside it, where the mask is 0 and 1. cells (G, 2): pixels of the
    foreground, none where its share is not looked at. wanted (L,) bool: which limbs. weights (3,): of edges, mask and
    cells, in all.
    """
    count, stations = z.shape
    limbs, seen = np.empty((count, stations, 5)), np.empty(count, dtype=np.bool_)
    height, width = mask.shape
    each = 1.0 / (2.0 * count * stations)
    for n in range(t.shape[0]):
        for k in range(count):
            seen[k] = project_limb(t[n, k], R[n, k], z[k], axes[k], eye, along, intrinsics, lens, Rc, tc, limbs[k])
        for k in range(count):
            values[n, k] = 0.0
            if not wanted[k] or not seen[k]:
                continue
            for s in range(stations):
                hx, hy, depth = limbs[k, s, 2], limbs[k, s, 3], limbs[k, s, 4]
                length = math.sqrt(hx * hx + hy * hy)
                if length < 1e-9:
                    continue
                for sign in (-1.0, 1.0):
                    u, v = limbs[k, s, 0] + sign * hx, limbs[k, s, 1] + sign * hy
                    # beside the outline: another limb there explains the picture, a nearer one hides the outline
                    un, vn = limbs[k, s, 0] + sign * OUTER * hx, limbs[k, s, 1] + sign * OUTER * hy
                    hidden, beside = False, False
                    for j in range(count):
                        if j != k and seen[j]:
                            hidden = hidden or depth_inside(u, v, limbs[j]) < depth
                            beside = beside or depth_inside(un, vn, limbs[j]) < np.inf
                    if edges.shape[0] > 0 and not hidden:
                        values[n, k] += weights[0] * each * _edge_at(u, v, hx / length, hy / length, edges, 0.0)
                    ui, vi = limbs[k, s, 0] + sign * INNER * hx, limbs[k, s, 1] + sign * INNER * hy
                    x, y = round(ui), round(vi)
                    if 0 <= x < width and 0 <= y < height and mask[y, x] >= 0:
                        values[n, k] += weights[1] * each * ratios[0, mask[y, x]]
                    x, y = round(un), round(vn)
                    if not beside and 0 <= x < width and 0 <= y < height and mask[y, x] >= 0:
                        values[n, k] += weights[1] * each * ratios[1, mask[y, x]]
        cover[n] = 0.0
        for g in range(cells.shape[0]):
            explained = False
            for k in range(count):
                if seen[k] and depth_inside(cells[g, 0], cells[g, 1], limbs[k]) < np.inf:
                    explained = True
                    break
            if explained:
                cover[n] += weights[2] / cells.shape[0]
