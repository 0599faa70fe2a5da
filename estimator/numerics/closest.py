"""The closest of some places to each of others, all compared: of a few hundred sooner done than a tree is built."""

from __future__ import annotations

import numpy as np

from humanoid.support.compiled import jit

_BLOCK = 256  # places whose distances stay in the nearest cache


@jit
def closest(places, among):  # type: ignore[no-untyped-def]
    """For each of places (N, 3) which of others (M, 3) is closest, (N,) int, the first of equals, and its squared
    distance (N,); infinitely far where there are none."""
    columns = np.ascontiguousarray(places.T)
    which, squared = np.zeros(len(places), np.int64), np.full(len(places), np.inf)
    for first in range(0, len(places), _BLOCK):
        block = slice(first, first + _BLOCK)
        _compare(columns[0, block], columns[1, block], columns[2, block], among, which[block], squared[block])
    return which, squared


@jit
def _compare(x, y, z, among, which, squared):  # type: ignore[no-untyped-def]
    """Fill which (N,) and lower squared (N,) for places x, y, z (N,) among others: among (M, 3). The inner loop runs
    over the places, not over the others that are minimised over, so that it is vectorised."""
    for k in range(among.shape[0]):
        a, b, c = among[k, 0], among[k, 1], among[k, 2]
        for i in range(x.shape[0]):
            off = (x[i] - a) ** 2 + (y[i] - b) ** 2 + (z[i] - c) ** 2
            closer = off < squared[i]
            which[i] = k if closer else which[i]
            squared[i] = off if closer else squared[i]
