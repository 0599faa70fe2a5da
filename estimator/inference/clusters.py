"""Clusters of a weighted set, and the mean and covariance of states on a manifold."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from humanoid.support.compiled import jit

MEAN_STEPS = 20
MEAN_TOLERANCE = 1e-10  # rad or m
_ROWS = 128  # of distances that are in memory at a time
_DIGITS = 12  # of shares of the weight that count


def clusters(points: np.ndarray, weights: np.ndarray, radius: float, count: int) -> np.ndarray:
    """The cluster (N,) each point (N, D) belongs to, the heaviest first; at most `count`.

    The point with the most weight within `radius` leads the first cluster; then the same among the points farther than
    `radius` from every leader; all go to the nearest leader at the end. So one compact set of particles stays one
    cluster, and with a `count` of 1 everything is. Distances are made a few rows at a time, so memory grows with N.
    Equal points, of which a set has many once it was resampled, count as one with their weight.
    """
    if count == 1:
        return np.zeros(len(points), dtype=np.int64)
    first, same = _equal(points)
    if len(first) == len(points):
        return _distinct_clusters(points, weights, radius, count)
    weight = np.bincount(same, weights=weights, minlength=len(first))
    return _distinct_clusters(points[first], weight, radius, count)[same]


def _equal(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first of each group of equal points (N, D), in order, and the number (N,) of the group of each."""
    rows = np.ascontiguousarray(points + 0.0).view(np.dtype((np.void, points.itemsize * points.shape[1]))).ravel()
    _, first, same = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.empty(len(first), dtype=np.int64)
    number[order] = np.arange(len(first))
    return first[order], number[same.ravel()]


def _distinct_clusters(points: np.ndarray, weights: np.ndarray, radius: float, count: int) -> np.ndarray:
    """`clusters` of points that differ."""
    free = weights > 0.0
    mass = _mass_within(points, points, weights, radius)
    leaders: list[int] = []
    to_leader = np.empty((len(points), count))
    while len(leaders) < count and free.any():
        # masses that differ by rounding alone are equal: the first of them leads
        leader = int(np.argmax(np.where(free, np.round(mass / weights.sum(), _DIGITS), -1.0)))
        apart = to_leader[:, len(leaders)] = np.square(points - points[leader]).sum(axis=1)
        leaders.append(leader)
        gone = free & (apart <= radius * radius)
        free &= ~gone
        if len(leaders) < count and free.any():
            mass[free] -= _mass_within(points[free], points[gone], weights[gone], radius)
    nearest = np.argmin(to_leader[:, : len(leaders)], axis=1)
    nearest[leaders] = np.arange(len(leaders))
    total = np.bincount(nearest, weights=weights, minlength=len(leaders))
    rank = np.empty(len(leaders), dtype=np.int64)
    rank[np.argsort(-total, kind="stable")] = np.arange(len(leaders))
    return rank[nearest]


def _mass_within(points: np.ndarray, others: np.ndarray, weights: np.ndarray, radius: float) -> np.ndarray:
    """Sum (N,) of the weights (M,) of others (M, D) within a radius of each of the points (N, D)."""
    mass = np.empty(len(points))
    square, square_of_others = np.square(points).sum(axis=1), np.square(others).sum(axis=1)
    for start in range(0, len(points), _ROWS):
        rows = slice(start, start + _ROWS)
        _masses(square[rows], square_of_others, points[rows] @ others.T, weights, radius * radius, mass[rows])
    return mass


@jit
def _masses(square, square_of_others, scalar, weights, limit, mass):  # type: ignore[no-untyped-def]
    """Fill mass (N,) with the sums of weights (M,) of points within a squared distance limit, by squared lengths,
    square (N,) and square_of_others (M,), and scalar products, scalar (N, M)."""
    for i in range(scalar.shape[0]):
        total = 0.0
        for j in range(scalar.shape[1]):
            total += weights[j] if square[i] + square_of_others[j] - 2.0 * scalar[i, j] <= limit else 0.0
        mass[i] = total


class Manifold(Protocol):
    """The space of states: a body's configurations, or placements."""

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
