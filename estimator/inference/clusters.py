"""Clusters of a weighted set, and the mean and covariance of states on a manifold."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from humanoid.support.compiled import jit

MEAN_STEPS = 20
MEAN_TOLERANCE = 1e-10  # rad or m


def clusters(points: np.ndarray, weights: np.ndarray, radius: float, count: int) -> np.ndarray:
    """The cluster (N,) each point (N, D) belongs to, the heaviest first; at most `count`.

    The point with the most weight within `radius` leads the first cluster; then the same among the points farther than
    `radius` from every leader; all go to the nearest leader at the end. So one compact set of particles stays one
    cluster, and with a `count` of 1 everything is.
    """
    square = np.sum(np.square(points), axis=1)
    apart, near = 2.0 * points @ points.T, np.empty((len(points), len(points)))
    _square_distances(square, radius * radius, apart, near)
    free = weights.copy()
    leaders: list[int] = []
    while len(leaders) < count and free.max() > 0.0:
        mass = np.where(free > 0.0, near @ free, -1.0)
        leaders.append(int(np.argmax(mass)))
        free[near[leaders[-1]] > 0.0] = 0.0
    nearest = np.argmin(apart[:, leaders], axis=1)
    nearest[leaders] = np.arange(len(leaders))
    total = np.bincount(nearest, weights=weights, minlength=len(leaders))
    rank = np.empty(len(leaders), dtype=np.int64)
    rank[np.argsort(-total, kind="stable")] = np.arange(len(leaders))
    return rank[nearest]


@jit
def _square_distances(square, limit, apart, near):  # type: ignore[no-untyped-def]
    """Make squared distances of twice the scalar products in apart (N, N), given the squared lengths, square (N,);
    fill near (N, N) with ones where they are within the limit, and on the diagonal, else zeros."""
    for i in range(square.shape[0]):
        for j in range(square.shape[0]):
            apart[i, j] = square[i] + square[j] - apart[i, j]
            near[i, j] = 1.0 if apart[i, j] <= limit else 0.0
        near[i, i] = 1.0


class Manifold(Protocol):
    """What states live on: a body's configurations, or placements."""

    def differences(self, q0: np.ndarray, q1: np.ndarray, /) -> np.ndarray:
        """Tangents (N, nv) that lead from q0 (nq,) to each of q1 (N, nq)."""
        ...

    def integrate(self, q: np.ndarray, tangent: np.ndarray, /) -> np.ndarray:
        """The state (nq,) that a tangent (nv,) at q (nq,) leads to."""
        ...


def mean_and_covariance(manifold: Manifold, q: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (nq,) of states (N, nq) on the manifold and their covariance (nv, nv) in the tangent space at it.

    The mean is where the weighted tangents to all cancel; found by moving along their mean, from the heaviest one.
    weights (N,) need not sum to one.
    """
    share = weights / weights.sum()
    mean = q[int(np.argmax(share))]
    for _ in range(MEAN_STEPS):
        tangents = manifold.differences(mean, q)
        step = share @ tangents
        if np.max(np.abs(step)) < MEAN_TOLERANCE:
            break
        mean = manifold.integrate(mean, step)
    tangents = manifold.differences(mean, q)
    covariance = (share[:, None] * tangents).T @ tangents
    return mean, 0.5 * (covariance + covariance.T)
