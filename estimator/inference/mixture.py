"""Modes and mixtures on the configuration manifold (CSS section 3.3): which are the same, and which prior mode one
continues.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from estimator.data.formats.checked_arrays import Field
from estimator.inference.origin import Origin
from humanoid.kinematics.body import Body
from humanoid.support.compiled import jit

MODE_FIELDS = {
    "q": Field("f", ("K", "nq")),
    "covariance": Field("f", ("K", "nv", "nv")),
    "energy": Field("f", ("K",), finite=False),
    "status": Field("U", ("K",)),
    "velocity": Field("f", ("K", "nv")),
    "kkt_residual": Field("f", ("K",), finite=False),
    "penetration": Field("f", ("K",), finite=False),
    "parent": Field("i", ("K",)),
    "association": Field("U", ("K",)),
}
"""Arrays of K modes, one for every field of `Mode` except its origin (see `estimator.inference.origin`). States,
results, run files and `Run` use this table."""


@dataclass(frozen=True)
class Mode:
    """One local minimum of the energy.

    q (nq,): configuration.
    covariance (nv, nv): inverse Hessian in the tangent space at q on the free directions, zero along active limits.
    energy: value of the cost at q.
    status: how the search ended, see `estimator.energy.descent.solution`: "converged", "stalled", "iterations" (the
        budget ended), "separated" (parts that overlapped were parted, and the search ended before its residual was
        small: nothing to do) or "sampled" (a mean of particles, no minimum).
    kkt_residual: largest entry of the projected gradient, recomputed from the problem at q.
    penetration: deepest overlap of two body parts at q [m], 0 if none.
    parent: index of the mode of the previous frame that this one continues, -1 if none.
    velocity (nv,): tangent to q from where the body was before, per second: from the parent's configuration; of a jump
        from the pose that it jumped to, as a jump is not motion. Zero where there is none (see `Origin.previous`).
    association: how the keypoints that it explains are assigned to landmarks: "as_detected" or "exchanged" (left and
        right swapped).
    origin: where it came from and its penalties; None where that is not known, as of modes predicted through a frame
        that was not observed.
    """

    q: np.ndarray
    covariance: np.ndarray
    energy: float
    status: str
    velocity: np.ndarray
    kkt_residual: float = np.nan
    penetration: float = 0.0
    parent: int = -1
    association: str = "as_detected"
    origin: Origin | None = None


@dataclass(frozen=True)
class Mixture:
    """Weighted modes, best first; `weights` (K,) sum to one.

    log_scores (K,): unnormalised log-weights that pass from frame to frame.
    """

    modes: tuple[Mode, ...]
    weights: np.ndarray
    log_scores: np.ndarray


def mixture_of(modes: tuple[Mode, ...], log_scores: np.ndarray) -> Mixture:
    """Mixture with weights in proportion to exp(log_scores), best first; scores are shifted so that the best is 0."""
    order = np.argsort(-log_scores, kind="stable")
    scores = log_scores[order] - np.max(log_scores, initial=-np.inf)
    weights = np.exp(scores)
    return Mixture(tuple(modes[k] for k in order), weights / weights.sum(), scores)


def mode_arrays(modes: Iterable[Mode]) -> dict[str, np.ndarray]:
    """K modes as the arrays of `MODE_FIELDS`."""
    listed = list(modes)
    return {name: field.array([getattr(m, name) for m in listed]) for name, field in MODE_FIELDS.items()}


def modes_of(arrays: Mapping[str, np.ndarray]) -> tuple[Mode, ...]:
    """The modes whose `mode_arrays` are among the arrays, without origins."""
    columns = [a if a.ndim > 1 else a.tolist() for a in (arrays[name] for name in MODE_FIELDS)]
    return tuple(Mode(**dict(zip(MODE_FIELDS, row, strict=True))) for row in zip(*columns, strict=True))


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
