"""Whose left is left: a detector that takes a person's front for the back exchanges the sides of a whole frame."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from estimator.data.cameras.epipolar import essential_of, sampson
from estimator.data.rigs.bundle import RigState
from estimator.data.rigs.views import with_depth

_FAR = 4.0  # standard deviations, beyond which a distance counts no more
_SURE = 0.8  # of the distances of a frame as it is, below which its sides are exchanged
_ROUNDS = 4


def _distances(state: RigState, first: np.ndarray, second: np.ndarray, a: int, b: int) -> np.ndarray:
    """Sampson's distances (T, J) of rays (T, J, 2) of cameras a and b in the plane z = 1."""
    R = state.R[b] @ state.R[a].T
    E = essential_of(R, state.t[b] - R @ state.t[a])
    return sampson(E, with_depth(state.through(a, first)), with_depth(state.through(b, second)))


def exchanged(state: RigState, rays: np.ndarray, std: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Frames (C, T) bool whose sides have to be exchanged for the rays (C, T, J, 2) to meet best; the first camera's of
    two are as they are. std (C, J): of the rays. mirror (J,): the other side of each joint."""
    cameras, instants = rays.shape[:2]
    flips = np.zeros((cameras, instants), dtype=bool)
    cost = np.zeros((cameras, cameras, 2, instants))  # of two cameras, whether one of both is exchanged
    for a, b in combinations(range(cameras), 2):
        allowed = _FAR * np.hypot(std[a], std[b])
        for k, second in enumerate((rays[b], rays[b][:, mirror])):
            distance = np.minimum(_distances(state, rays[a], second, a, b) / allowed, 1.0)
            cost[a, b, k] = cost[b, a, k] = np.nan_to_num(distance).sum(axis=1)
    frames = np.arange(instants)
    for _ in range(_ROUNDS):
        before = flips.copy()
        for c in range(1 if cameras == 2 else 0, cameras):
            as_is, other = (
                sum(cost[c, o, (flips[c] ^ flips[o] ^ turn).astype(int), frames] for o in range(cameras) if o != c)
                for turn in (False, True)
            )
            flips[c] ^= other < _SURE * as_is
        if np.array_equal(flips, before):
            break
    return flips ^ (flips.mean(axis=0) > 0.5)  # all exchanged is as good as none


def with_exchanged(rays: np.ndarray, flips: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Rays (C, T, J, 2), or slopes, with the sides of some frames (C, T) exchanged."""
    return np.where(flips[:, :, None, None], rays[:, :, mirror], rays)
