"""The compiled part of `outline_values`: limbs as cones in an image, their outlines and insides looked up in maps."""

from __future__ import annotations

import math

import numpy as np

from estimator.data.cameras.lens import is_parallel
from estimator.data.cameras.projection import in_camera, parallel_pixel, project_from_camera
from humanoid.support.compiled import jit

INNER, OUTER = 0.55, 1.6  # in half-widths from the axis: where a limb is expected, and where it should end
CAP = 0.9  # how far a limb extends beyond its ends, in half-widths there: ends are round


@jit
def project_limb(t, R, z, axes, intrinsics, lens, Rc, tc, out):  # type: ignore[no-untyped-def]
    """Fill out (S, 5) with stations of one limb: pixel x, y of its axis, the half-width as a vector in pixels, depth.

    t (3,), R (3, 3): T_world_limb. z (S,) [m]: of the stations; axes (S, 2) [m]: semi-axes there. The camera:
    intrinsics (5,), lens, Rc (3, 3), tc (3,). False where a part of it is behind the camera.

    The half-width is what an elliptic section shows sideways, normal to the axis and to the view.
    """
    parallel = is_parallel(lens)
    x0, y0, z0 = in_camera(t, Rc, tc)  # all from here on in the frame of the camera
    ax, ay, az = _turned(Rc, R, 0)
    bx, by, bz = _turned(Rc, R, 1)
    cx, cy, cz = _turned(Rc, R, 2)
    for s in range(z.shape[0]):
        x, y, depth = x0 + cx * z[s], y0 + cy * z[s], z0 + cz * z[s]
        vx, vy, vz = (0.0, 0.0, 1.0) if parallel else (x, y, depth)
        wx, wy, wz = cy * vz - cz * vy, cz * vx - cx * vz, cx * vy - cy * vx
        size = math.sqrt(wx * wx + wy * wy + wz * wz)
        inverse = 1.0 / size if size > 1e-9 else 1.0
        a = (wx * ax + wy * ay + wz * az) * axes[s, 0]
        b = (wx * bx + wy * by + wz * bz) * axes[s, 1]
        half = math.sqrt(a * a + b * b) * inverse * inverse
        if parallel:  # without the call of what any lens needs, which takes most of the time
            u, v = parallel_pixel(x, y, intrinsics)
            us, vs = parallel_pixel(x + half * wx, y + half * wy, intrinsics)
        else:
            u, v, seen = project_from_camera(x, y, depth, intrinsics, lens)
            us, vs, seen_side = project_from_camera(x + half * wx, y + half * wy, depth + half * wz, intrinsics, lens)
            if not (seen and seen_side):
                return False
        out[s, 0], out[s, 1], out[s, 2], out[s, 3], out[s, 4] = u, v, us - u, vs - v, depth
    return True


@jit
def _turned(Rc, R, k):  # type: ignore[no-untyped-def]
    """Column k of R (3, 3) in the frame of a camera with rotation Rc (3, 3) from the world."""
    x, y, z = R[0, k], R[1, k], R[2, k]
    return (
        Rc[0, 0] * x + Rc[0, 1] * y + Rc[0, 2] * z,
        Rc[1, 0] * x + Rc[1, 1] * y + Rc[1, 2] * z,
        Rc[2, 0] * x + Rc[2, 1] * y + Rc[2, 2] * z,
    )


@jit
def lower_depths(xs, ys, limb, nearest):  # type: ignore[no-untyped-def]
    """Lower nearest (P,), depths [m], to that of the axis of a limb at those of points xs, ys (P,) [px] that are inside
    of it.

    limb (S, 5): of `project_limb`. Without branches, and with separate coordinates, so that several points are computed
    together.
    """
    last = limb.shape[0] - 1
    x0, y0, hx0, hy0, depth = limb[0, 0], limb[0, 1], limb[0, 2], limb[0, 3], limb[0, 4]
    dx, dy = limb[last, 0] - x0, limb[last, 1] - y0
    dhx, dhy, deeper = limb[last, 2] - hx0, limb[last, 3] - hy0, limb[last, 4] - depth
    square = dx * dx + dy * dy
    inverse, middle = (1.0 / square, 0.0) if square > 1e-9 else (0.0, 0.5)
    for p in range(xs.shape[0]):
        x, y = xs[p] - x0, ys[p] - y0
        share = (x * dx + y * dy) * inverse + middle
        level = 0.0 if share < 0.0 else share
        level = 1.0 if level > 1.0 else level
        hx, hy = hx0 + level * dhx, hy0 + level * dhy
        x, y = x - level * dx, y - level * dy
        # beside the axis the distance is across it, beyond an end to that end
        cap = 1.0 if level == share else CAP * CAP
        there = depth + level * deeper
        within = (x * x + y * y <= cap * (hx * hx + hy * hy)) & (there < nearest[p])
        nearest[p] = there if within else nearest[p]


@jit
def fill_points(limbs, xs, ys):  # type: ignore[no-untyped-def]
    """Fill xs, ys (L, S, 2, 2) [px] with points at the outlines of limbs (L, S, 5): of each station both sides, on the
    outline and beside it."""
    for k in range(limbs.shape[0]):
        for s in range(limbs.shape[1]):
            x, y, hx, hy = limbs[k, s, 0], limbs[k, s, 1], limbs[k, s, 2], limbs[k, s, 3]
            for side in range(2):
                sign = 2.0 * side - 1.0
                xs[k, s, side, 0], ys[k, s, side, 0] = x + sign * hx, y + sign * hy
                xs[k, s, side, 1], ys[k, s, side, 1] = x + sign * OUTER * hx, y + sign * OUTER * hy


@jit
def _inside(x, y, width, height):  # type: ignore[no-untyped-def]
    """Whether a pixel is in a picture."""
    return 0 <= x < width and 0 <= y < height


@jit
def outline_values(  # type: ignore[no-untyped-def]
    t, R, z, axes, intrinsics, lens, Rc, tc, edges, mask, ratios, cells, wanted, weights, points, owner,
    values, cover, hidden,
):  # fmt: skip
    """Fill values (N, L) with the log ratio of each limb [nats], cover (N,) with that of the foreground explained by
    limbs [nats], and hidden (N, F) bool: points behind the axis of a limb and inside of it in the image.

    t (N, L, 3), R (N, L, 3, 3): T_world_limb. z (L, S), axes (L, S, 2): stations of the limbs. intrinsics (5,), lens,
    Rc (3, 3), tc (3,): the camera, see `project_limb`. edges (B, H, W): log ratios by orientation from 0 to pi; B is 0
    without. mask (H, W): 1 on the foreground, 0 on the background, -1 where unknown. ratios (2, 2): log ratios on the
    body and beside it, where the mask is 0 and 1. cells (2, G): x, y of pixels of the foreground, none where its share
    is not used. wanted (L,) bool: which limbs. weights (3,): of edges, mask and cells, in all.
    points (N, F, 3) [m] in the world, owner (F,): the limb of each, which does not hide it.
    """
    count, stations = z.shape
    limbs, seen = np.empty((count, stations, 5)), np.empty(count, dtype=np.bool_)
    shape = (count, stations, 2, 2)
    xs, ys, nearest = np.empty(shape), np.empty(shape), np.empty(shape)
    flat_xs, flat_ys, flat_nearest = xs.reshape(-1), ys.reshape(-1), nearest.reshape(-1)
    own, covering = 4 * stations, np.empty(cells.shape[1])
    x_of, y_of, before_it = np.empty(1), np.empty(1), np.empty(1)  # of a point
    kinds, height, width = edges.shape[0], mask.shape[0], mask.shape[1]
    each = 1.0 / (2.0 * count * stations)
    for n in range(t.shape[0]):
        for k in range(count):
            seen[k] = project_limb(t[n, k], R[n, k], z[k], axes[k], intrinsics, lens, Rc, tc, limbs[k])
        fill_points(limbs, xs, ys)
        flat_nearest[:], covering[:] = np.inf, np.inf
        for k in range(count):
            if seen[k]:
                before, after = k * own, (k + 1) * own  # no limb hides its own outline
                lower_depths(flat_xs[:before], flat_ys[:before], limbs[k], flat_nearest[:before])
                lower_depths(flat_xs[after:], flat_ys[after:], limbs[k], flat_nearest[after:])
                lower_depths(cells[0], cells[1], limbs[k], covering)
        for f in range(points.shape[1]):
            px, py, depth = in_camera(points[n, f], Rc, tc)
            x_of[0], y_of[0], ahead = project_from_camera(px, py, depth, intrinsics, lens)
            before_it[0] = depth if ahead else -np.inf
            for k in range(count):
                if seen[k] and owner[f] != k:
                    lower_depths(x_of, y_of, limbs[k], before_it)
            hidden[n, f] = ahead and before_it[0] < depth
        for k in range(count):
            values[n, k] = 0.0
            if not wanted[k] or not seen[k]:
                continue
            for s in range(stations):
                hx, hy, depth = limbs[k, s, 2], limbs[k, s, 3], limbs[k, s, 4]
                if hx * hx + hy * hy < 1e-18:
                    continue
                kind = 0  # the orientation of its normal, the same on both sides
                if kinds > 0:
                    kind = math.floor(math.atan2(hy, hx) / math.pi * kinds + 0.5) % kinds
                for side in range(2):
                    x, y = round(xs[k, s, side, 0]), round(ys[k, s, side, 0])
                    # a nearer limb hides an outline
                    if kinds > 0 and nearest[k, s, side, 0] >= depth and _inside(x, y, width, height):
                        values[n, k] += weights[0] * each * edges[kind, y, x]
                    sign = 2.0 * side - 1.0
                    x, y = round(limbs[k, s, 0] + sign * INNER * hx), round(limbs[k, s, 1] + sign * INNER * hy)
                    if _inside(x, y, width, height) and mask[y, x] >= 0:
                        values[n, k] += weights[1] * each * ratios[0, mask[y, x]]
                    x, y = round(xs[k, s, side, 1]), round(ys[k, s, side, 1])
                    # another limb beside an outline explains the picture there
                    if nearest[k, s, side, 1] == np.inf and _inside(x, y, width, height) and mask[y, x] >= 0:
                        values[n, k] += weights[1] * each * ratios[1, mask[y, x]]
        cover[n] = 0.0
        for g in range(len(covering)):
            if covering[g] < np.inf:
                cover[n] += weights[2] / len(covering)
