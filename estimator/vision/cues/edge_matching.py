"""Edges found near a predicted contour: compiled kernels (CSS section 3.1.2)."""

from __future__ import annotations

import numpy as np

from estimator.vision.visibility import HIDDEN, INNER, OUTER
from humanoid.support.compiled import jit

_STRAIGHT = 0.6  # cosine between contour normal and image gradient from which an edge may belong to the contour
_WEAK = 0.08  # strength below which an edge is noise
_UNSURE = 0.3  # strength of the unseen alternative that the candidates of a contour point compete with


@jit
def search_edges(  # type: ignore[no-untyped-def]
    pixels,
    normals,
    state,
    strength,
    direction,
    boundary,
    distance,
    window,
    wide,
    most,
    near,
    emphasis,
    target,
    share,
    trust,
):
    """Edges along the normals of contour points (CSS eq. 8), up to `most` a point, strongest first.

    pixels, normals (M, 2), state (M,). strength (H, W), direction (H, W, 2): of the edges. boundary (H, W): S_p, or
    empty. distance (H, W): signed distance to the foreground's outline, or empty; edges further from it than about
    `near` [px] count less for the body's outline, edges outside of it for contours within the body. window [px]: how
    far is searched; wide [px]: an edge this far off is half as likely.
    Fills target (M, most, 2), share (M, most): each candidate's part of the point's weight, zero where there is none,
    and trust (M, most): W = 1 - emphasis S_p.
    """
    height, width = strength.shape
    reach = int(window)
    profile = np.zeros(2 * reach + 3)
    step = np.uint32(1)  # unsigned indices need no check whether they count from the end
    for i in range(pixels.shape[0]):
        share[i] = 0.0
        if state[i] != OUTER and state[i] != INNER:
            continue
        nx, ny = normals[i, 0], normals[i, 1]
        for k in range(2 * reach + 3):
            u, v = pixels[i, 0] + (k - reach - 1) * nx, pixels[i, 1] + (k - reach - 1) * ny
            profile[k] = 0.0
            if not (0.0 <= u < width - 1 and 0.0 <= v < height - 1):
                continue
            column, row = np.uint32(u + 0.5), np.uint32(v + 0.5)
            along = abs(direction[row, column, 0] * nx + direction[row, column, 1] * ny)
            if (along > _STRAIGHT) & (strength[row, column] >= 0.5 * _WEAK):
                x, y = np.uint32(u), np.uint32(v)
                a, b = u - x, v - y
                upper = (1.0 - a) * strength[y, x] + a * strength[y, x + step]
                lower = (1.0 - a) * strength[y + step, x] + a * strength[y + step, x + step]
                profile[k] = ((1.0 - b) * upper + b * lower) * along
        total = _UNSURE
        for k in range(1, 2 * reach + 2):
            s = profile[k]
            if s < _WEAK or s < profile[k - 1] or s <= profile[k + 1]:
                continue
            bend = profile[k - 1] - 2.0 * s + profile[k + 1]
            offset = k - reach - 1 + (0.5 * (profile[k - 1] - profile[k + 1]) / bend if bend < -1e-6 else 0.0)
            u, v = pixels[i, 0] + offset * nx, pixels[i, 1] + offset * ny
            at, line = min(max(int(u + 0.5), 0), width - 1), min(max(int(v + 0.5), 0), height - 1)
            if distance.shape[0] > 0:
                d = distance[line, at] if state[i] == INNER else abs(distance[line, at])
                s /= 1.0 + max(d / near, 0.0) ** 2
            w = 1.0 - emphasis * boundary[line, at] if boundary.shape[0] > 0 else 1.0
            s /= 1.0 + (offset / wide) ** 2
            total += s
            for c in range(most):
                if s > share[i, c]:  # push the weaker ones down
                    for m in range(most - 1, c, -1):
                        share[i, m], trust[i, m] = share[i, m - 1], trust[i, m - 1]
                        target[i, m, 0], target[i, m, 1] = target[i, m - 1, 0], target[i, m - 1, 1]
                    share[i, c], trust[i, c] = s, w
                    target[i, c, 0], target[i, c, 1] = u, v
                    break
        for c in range(most):
            share[i, c] /= total


@jit
def take_candidates(target, share, trust, normals, each, precision, point, place, weights, shares):  # type: ignore[no-untyped-def]
    """Make assignments of the candidates of `search_edges`, measured along the normals; returns how many.

    Fills point (A,), place (A, 2), weights (A, 3): trust times `precision` [1/px^2] along the normal, as xx, xy, yy;
    shares (A,): `each` times the candidate's share.
    """
    count = 0
    for i in range(share.shape[0]):
        x, y = normals[i, 0], normals[i, 1]
        for c in range(share.shape[1]):
            if share[i, c] <= 0.0:
                break
            w = trust[i, c] * precision
            point[count], place[count, 0], place[count, 1] = i, target[i, c, 0], target[i, c, 1]
            weights[count, 0], weights[count, 1], weights[count, 2] = w * x * x, w * x * y, w * y * y
            shares[count] = each * share[i, c]
            count += 1
    return count


@jit
def edge_assignments(  # type: ignore[no-untyped-def]
    pixels, normals, state, strength, direction, boundary, distance, window, wide, most, near, emphasis, each,
    precision, kind, nu,
):  # fmt: skip
    """`take_candidates` of `search_edges`: point (A,), target (A, 2), precision (A, 3), weight, kind and nu (A,) as in
    `Assignments`; and the shares (S, most) of the contour points that are not hidden."""
    count = len(state)
    target, share, trust = np.empty((count, most, 2)), np.empty((count, most)), np.empty((count, most))
    search_edges(
        pixels, normals, state, strength, direction, boundary, distance, window, wide, most, near, emphasis, target,
        share, trust,
    )  # fmt: skip
    point, place = np.empty(share.size, np.int64), np.empty((share.size, 2))
    weights, shares = np.empty((share.size, 3)), np.empty(share.size)
    taken = take_candidates(target, share, trust, normals, each, precision, point, place, weights, shares)
    return (
        point[:taken], place[:taken], weights[:taken], shares[:taken], np.full(taken, kind), np.full(taken, nu),
        share[state != HIDDEN],
    )  # fmt: skip
