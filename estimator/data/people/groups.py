"""Pieces clustered into people by the affinities of their pairs."""

from __future__ import annotations

import numpy as np


def grouped(affinity: np.ndarray) -> np.ndarray:
    """Group (P,) of each piece, from a symmetric matrix (P, P) of affinities.

    Greedy additive edge contraction (Keuper et al., Efficient decomposition of image and mesh graphs by lifted
    multicuts, ICCV 2015): the two groups of largest affinity are joined, affinities of the joined ones add up,
    and it ends when no pair's is above 0.
    """
    count = len(affinity)
    between = affinity.astype(np.float64, copy=True)
    np.fill_diagonal(between, -np.inf)
    group = np.arange(count)
    if count < 2:
        return group
    nearest = between.argmax(axis=1)
    best = between[np.arange(count), nearest]
    while True:
        i = int(best.argmax())
        if not best[i] > 0.0:
            return np.unique(group, return_inverse=True)[1]
        j = int(nearest[i])
        _join(between, i, j)
        group[group == j] = i
        stale = np.flatnonzero((nearest == i) | (nearest == j))
        stale = np.unique(np.append(stale, (i, j)))
        closer = between[:, i] > best
        nearest[closer], best[closer] = i, between[closer, i]
        nearest[stale] = between[stale].argmax(axis=1)
        best[stale] = between[stale, nearest[stale]]


def _join(between: np.ndarray, i: int, j: int) -> None:
    """Make group j a part of group i."""
    between[i] += between[j]
    between[:, i] = between[i]
    between[i, i] = -np.inf
    between[j] = between[:, j] = -np.inf


def exchange_pieces(
    affinity: np.ndarray, group: np.ndarray, who: int, camera: np.ndarray, begin: np.ndarray
) -> np.ndarray:
    """The groups (P,) after the best exchanges between group `who` and each other, which greed alone does not find.

    Exchanged is what one camera, or all, saw of both in a stretch of time: there two people may have changed places.
    Pieces with a `camera` (P,) below 0 stay; `begin` (P,): when each begins. Every exchange raises the sum of
    affinities within the groups, so that it ends.
    """
    group = group.copy()
    changed = True
    while changed:
        changed = False
        for other in [*np.setdiff1d(group, [who]).tolist(), int(group.max()) + 1]:  # and with none
            for c in (*np.unique(camera[camera >= 0]).tolist(), None):
                pieces = np.flatnonzero(camera >= 0 if c is None else camera == c)
                moved = _exchange(affinity, group, (who, other), pieces, begin)
                group[moved] = who + other - group[moved]
                changed |= len(moved) > 0
    return group


def _exchange(
    affinity: np.ndarray, group: np.ndarray, two: tuple[int, int], pieces: np.ndarray, begin: np.ndarray
) -> np.ndarray:
    """The pieces, consecutive in time, that two groups exchange with most gain; none without gain."""
    pieces = pieces[np.isin(group[pieces], two)]
    pieces = pieces[np.argsort(begin[pieces], kind="stable")]
    if not len(pieces):
        return pieces
    mine, theirs = ((group == g).astype(float) for g in two)
    sign = np.where(group[pieces] == two[0], 1.0, -1.0)
    alone = sign * (affinity[pieces] @ (theirs - mine))  # what each would gain if the others stayed
    both = sign[:, None] * affinity[np.ix_(pieces, pieces)] * sign  # and the affinities of those that change along
    ends = np.concatenate([[0.0], np.cumsum(alone)])
    corner = np.zeros((len(ends), len(ends)))
    corner[1:, 1:] = np.cumsum(np.cumsum(both, axis=0), axis=1)
    inner = np.diag(corner)
    gain = ends[None, :] - ends[:, None] + inner[None, :] + inner[:, None] - corner - corner.T
    gain = np.triu(gain, 1)
    i, j = np.unravel_index(int(gain.argmax()), gain.shape)
    return pieces[i:j] if gain[i, j] > 1e-6 else pieces[:0]
