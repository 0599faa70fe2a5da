"""Which modes are the same, and which prior mode a new one continues."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from humanoid.kinematics.body import Body
from humanoid.support.compiled import jit

Item = TypeVar("Item")


def body_size(body: Body) -> float:
    """Largest distance [m] between two landmarks at rest: the yardstick for 'the same pose'."""
    points = body.landmarks(body.at(body.neutral))
    return float(np.max(np.linalg.norm(points[:, None] - points[None, :], axis=-1), initial=1e-3))


def best_distinct(
    items: Sequence[Item],
    score: Callable[[Item], float],
    points: Callable[[Item], np.ndarray],
    distance: float,
    count: int,
) -> list[Item]:
    """The `count` best items of which no two have all landmarks (L, 3) within `distance` [m] of each other."""
    ranked = sorted(items, key=score, reverse=True)
    if not ranked:
        return []
    chosen = np.empty(len(ranked), dtype=np.int64)
    some = choose_distinct(np.array([points(item) for item in ranked]), distance**2, count, chosen)
    return [ranked[k] for k in chosen[:some].tolist()]


@jit
def choose_distinct(points, square, count, chosen):  # type: ignore[no-untyped-def]
    """Fill chosen (N,) with the first of N sets of landmarks, points (N, L, 3), of which no two have all landmarks
    within the root of `square` of each other, at most `count`; returns how many."""
    some = 0
    for n in range(points.shape[0]):
        if some == count:
            break
        new = True
        for k in chosen[:some]:
            farthest = 0.0
            for i in range(points.shape[1]):
                away = 0.0
                for c in range(3):
                    away += (points[n, i, c] - points[k, i, c]) ** 2
                farthest = max(farthest, away)
            if not farthest > square:
                new = False
                break
        if new:
            chosen[some] = n
            some += 1
    return some


def bhattacharyya(
    body: Body, q0: np.ndarray, covariance0: np.ndarray, q1: np.ndarray, covariance1: np.ndarray
) -> float:
    """Bhattacharyya distance of two Gaussians on the manifold, in the tangent space at q0 (CSS Figure 6, step 5).

    Standard form, with the 1/8 and the mean covariance that the printed step lost. A small isotropic variance keeps
    directions held by active limits comparable.
    """
    floor = 1e-6 * np.eye(body.nv)
    a, b = covariance0 + floor, covariance1 + floor
    mean = 0.5 * (a + b)
    d = body.difference(q0, q1)
    log_det = np.linalg.slogdet(mean)[1] - 0.5 * (np.linalg.slogdet(a)[1] + np.linalg.slogdet(b)[1])
    return float(d @ np.linalg.solve(mean, d) / 8.0 + 0.5 * log_det)
