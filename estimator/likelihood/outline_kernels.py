"""The compiled part of `outline_values`: limbs as cones in an image, their outlines and insides looked up in maps."""

from __future__ import annotations

import math

import numpy as np

from estimator.cameras.projection import in_camera, project_point
from humanoid.support.compiled import jit

INNER, OUTER = 0.55, 1.6  # in half-widths from the axis: where a limb is asked for, and where it should end
CAP = 0.9  # how far a limb goes on beyond its ends, in half-widths there: ends are round
_ROUNDING = 1e-6  # px


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
def look_past(points, owner, limbs, k, nearest):  # type: ignore[no-untyped-def]
    """Lower nearest (P,), depths [m], to that of the axis of limb k at those of points (P, 2) [px] that are inside of
    it, unless they are its own, owner (P,).

    limbs (L, S, 5): of `project_limb`. All points at once, so that what is the same for all of them is fetched once.
    """
    last = limbs.shape[1] - 1
    x0, y0, hx0, hy0, depth = limbs[k, 0, 0], limbs[k, 0, 1], limbs[k, 0, 2], limbs[k, 0, 3], limbs[k, 0, 4]
    dx, dy = limbs[k, last, 0] - x0, limbs[k, last, 1] - y0
    dhx, dhy, deeper = limbs[k, last, 2] - hx0, limbs[k, last, 3] - hy0, limbs[k, last, 4] - depth
    square = dx * dx + dy * dy
    inverse = 1.0 / square if square > 1e-9 else 0.0
    reach = max(hx0 * hx0 + hy0 * hy0, limbs[k, last, 2] ** 2 + limbs[k, last, 3] ** 2)  # no half-width is longer
    half = 0.5 * math.sqrt(square) + math.sqrt(reach) + _ROUNDING
    for p in range(points.shape[0]):
        x, y = points[p, 0] - x0, points[p, 1] - y0
        mx, my = x - 0.5 * dx, y - 0.5 * dy
        if mx * mx + my * my > half * half or owner[p] == k:
            continue
        share = (x * dx + y * dy) * inverse if inverse > 0.0 else 0.5
        level = min(max(share, 0.0), 1.0)
        hx, hy = hx0 + level * dhx, hy0 + level * dhy
        x, y = x - level * dx, y - level * dy
        # beside the axis the distance is across it, beyond an end to that end
        cap = 1.0 if level == share else CAP * CAP
        if x * x + y * y <= cap * (hx * hx + hy * hy):
            nearest[p] = min(nearest[p], depth + level * deeper)


@jit
def fill_points(limbs, points, owner):  # type: ignore[no-untyped-def]
    """Fill points (P, 2, 2) [px], P = 2 L S, with those on and beside the outlines of limbs (L, S, 5), side by side,
    and owner (P, 2) with the limb each belongs to."""
    n = 0
    for k in range(limbs.shape[0]):
        for s in range(limbs.shape[1]):
            for side in range(2):
                sign = 2.0 * side - 1.0
                for c in range(2):
                    points[n, 0, c] = limbs[k, s, c] + sign * limbs[k, s, 2 + c]
                    points[n, 1, c] = limbs[k, s, c] + sign * OUTER * limbs[k, s, 2 + c]
                    owner[n, c] = k
                n += 1


@jit
def _inside(x, y, width, height):  # type: ignore[no-untyped-def]
    """Whether a pixel is in a picture."""
    return 0 <= x < width and 0 <= y < height


@jit
def outline_values(  # type: ignore[no-untyped-def]
    t, R, z, axes, eye, along, intrinsics, lens, Rc, tc, edges, mask, ratios, cells, wanted, weights, values, cover,
):  # fmt: skip
    """Fill values (N, L), what each limb says, and cover (N,), what the foreground that limbs explain says [nats].

    t (N, L, 3), R (N, L, 3, 3): T_world_limb. z (L, S), axes (L, S, 2): stations of the limbs. eye, along (3,),
    intrinsics (5,), lens, Rc (3, 3), tc (3,): the camera, see `project_limb`. edges (B, H, W): log ratios by
    orientation from 0 to pi; B is 0 without. mask (H, W): 1 on the foreground, 0 on the background, -1 where nothing is
    known. ratios (2, 2): log ratios on the body and beside it, where the mask is 0 and 1. cells (G, 2): pixels of the
    foreground, none where its share is not looked at. wanted (L,) bool: which limbs. weights (3,): of edges, mask and
    cells, in all.
    """
    count, stations = z.shape
    limbs, seen = np.empty((count, stations, 5)), np.empty(count, dtype=np.bool_)
    sides = np.empty((2 * count * stations, 2, 2))
    side_owner = np.empty((2 * count * stations, 2), dtype=np.int64)
    nearest, covering = np.empty((2 * count * stations, 2)), np.empty(len(cells))
    nobody = np.full(len(cells), -1)
    flat, flat_owner, flat_nearest = sides.reshape(-1, 2), side_owner.reshape(-1), nearest.reshape(-1)
    kinds, height, width = edges.shape[0], mask.shape[0], mask.shape[1]
    each = 1.0 / (2.0 * count * stations)
    for n in range(t.shape[0]):
        for k in range(count):
            seen[k] = project_limb(t[n, k], R[n, k], z[k], axes[k], eye, along, intrinsics, lens, Rc, tc, limbs[k])
        fill_points(limbs, sides, side_owner)
        nearest[:], covering[:] = np.inf, np.inf
        for k in range(count):
            if seen[k]:
                look_past(flat, flat_owner, limbs, k, flat_nearest)
                look_past(cells, nobody, limbs, k, covering)
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
                    p = 2 * (k * stations + s) + side
                    x, y = round(sides[p, 0, 0]), round(sides[p, 0, 1])
                    # a nearer limb hides an outline
                    if kinds > 0 and nearest[p, 0] >= depth and _inside(x, y, width, height):
                        values[n, k] += weights[0] * each * edges[kind, y, x]
                    sign = 2.0 * side - 1.0
                    x, y = round(limbs[k, s, 0] + sign * INNER * hx), round(limbs[k, s, 1] + sign * INNER * hy)
                    if _inside(x, y, width, height) and mask[y, x] >= 0:
                        values[n, k] += weights[1] * each * ratios[0, mask[y, x]]
                    x, y = round(sides[p, 1, 0]), round(sides[p, 1, 1])
                    # another limb beside an outline explains the picture there
                    if nearest[p, 1] == np.inf and _inside(x, y, width, height) and mask[y, x] >= 0:
                        values[n, k] += weights[1] * each * ratios[1, mask[y, x]]
        cover[n] = 0.0
        for g in range(len(cells)):
            if covering[g] < np.inf:
                cover[n] += weights[2] / len(cells)
