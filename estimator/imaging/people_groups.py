"""Pieces put together to people, by what speaks for and against each pair."""

from __future__ import annotations

import numpy as np


def grouped(affinity: np.ndarray) -> np.ndarray:
    """Group (P,) of each piece, from a symmetric matrix (P, P) of what speaks for two being one.

    Greedy additive edge contraction (Keuper et al., Efficient decomposition of image and mesh graphs by lifted
    multicuts, ICCV 2015): the two groups with most for them are joined, what speaks for each adds up, and it ends when
    more speaks against every pair.
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
