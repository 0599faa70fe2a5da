"""Where along the normals of a predicted contour a limb's colours end: a compiled kernel."""

from __future__ import annotations

import math

import numpy as np

from estimator.vision.visibility import INNER, OUTER, part_at
from humanoid.support.compiled import jit

OFF, MATCHED, MISSING = 0, 1, 2
"""States of a contour point: colours do not count there, show where the limb ends, or show that it is not there."""
_BESIDE = 0.8  # cells: so far from a contour its own cells end, as in `estimator.vision.visibility`


@jit
def find_borders(  # type: ignore[no-untyped-def]
    pixels, normals, state, part, owner, frame, bins, log_density, apart, window, wide, share, offset, variance,
    weight, status,
):  # fmt: skip
    """Where along its normal each contour point's limb ends, by the colours of the pixels along it.

    pixels, normals (M, 2), state, part (M,): of the contour points. owner (rows, columns), frame (3,): of the depth
    buffer. bins (H, W): of the picture. log_density (2P, BINS), apart (P, P + 1): see `LimbColours`. window [px]: how
    far is searched. wide [px]: a border this far off is half as likely. share: of its log-likelihood ratio that a pixel
    counts, neighbours being alike.
    Fills offset, variance (M,) [px, px^2]: mean and variance of the border's place along the outward normal; weight
    (M,): how surely the limb's colours differ from those behind it; status (M,): `OFF`, `MATCHED` or `MISSING`.

    The limb is in front: were its border at d, the pixels on this side of d have the limb's colours, those beyond the
    colours of what the prediction has there. Each way the search ends where the prediction has something else.
    """
    height, width = bins.shape
    rows, columns = owner.shape
    parts = apart.shape[0]
    left, top, cell = frame[0], frame[1], frame[2]
    reach = int(window)
    ratio = np.zeros(2 * reach)
    score = np.zeros(2 * reach + 1)
    for i in range(pixels.shape[0]):
        offset[i], variance[i], weight[i], status[i] = 0.0, 0.0, 0.0, OFF
        if state[i] != OUTER and state[i] != INNER:
            continue
        own = part[i]
        x = int((pixels[i, 0] + _BESIDE * cell * normals[i, 0] - left) / cell + 0.5)
        y = int((pixels[i, 1] + _BESIDE * cell * normals[i, 1] - top) / cell + 0.5)
        other = owner[y, x] if 0 <= x < columns and 0 <= y < rows else -1
        if other == own:
            continue
        weight[i] = apart[own, other if other >= 0 else parts]
        if weight[i] <= 0.0:
            continue
        behind = other if other >= 0 else parts + own
        first, last = 0, 0
        for side in (-1, 1):
            for k in range(reach):
                along = side * (k + 0.5)
                u, v = pixels[i, 0] + along * normals[i, 0], pixels[i, 1] + along * normals[i, 1]
                column, row = math.floor(u + 0.5), math.floor(v + 0.5)
                if not (0 <= column < width and 0 <= row < height):
                    break
                if abs(along) > _BESIDE * cell and part_at(owner, frame, u, v) != (own if side < 0 else other):
                    break
                of = bins[row, column]
                ratio[reach + (k if side > 0 else -k - 1)] = share * (log_density[own, of] - log_density[behind, of])
                if side < 0:
                    first = -k - 1
                else:
                    last = k + 1
        if first == 0 or last == 0:
            weight[i] = 0.0
            continue
        total, best, most = 0.0, first, -1e300
        for d in range(first, last + 1):
            if d > first:
                total += ratio[reach + d - 1]
            score[reach + d] = total - math.log1p((d / wide) ** 2)
            if score[reach + d] > most:
                best, most = d, score[reach + d]
        if best == first:
            status[i] = MISSING
            continue
        mass, mean, square = 0.0, 0.0, 0.0
        for d in range(first, last + 1):
            p = math.exp(score[reach + d] - most)
            mass += p
            mean += p * d
            square += p * d * d
        mean /= mass
        offset[i], variance[i], status[i] = mean, max(square / mass - mean * mean, 0.0) + 1.0 / 12.0, MATCHED


@jit
def limb_costs(pixels, visible, part, bins, log_density, apart, costs):  # type: ignore[no-untyped-def]
    """Fill `costs` (N,) with -log of the probability that a visible node's pixel shows its own part and not what lies
    beside that, were both as likely before: zero where colours do not count, or the node is not visible.

    pixels (N, 2), visible, part (N,): of the nodes. bins (H, W). log_density (2P, BINS), apart (P, P + 1): see
    `LimbColours`.
    """
    height, width = bins.shape
    parts = apart.shape[0]
    for i in range(pixels.shape[0]):
        costs[i] = 0.0
        if not visible[i]:
            continue
        sure = apart[part[i], parts]
        column, row = math.floor(pixels[i, 0] + 0.5), math.floor(pixels[i, 1] + 0.5)
        if sure <= 0.0 or not (0 <= column < width and 0 <= row < height):
            continue
        of = bins[row, column]
        costs[i] = sure * math.log1p(math.exp(log_density[parts + part[i], of] - log_density[part[i], of]))
