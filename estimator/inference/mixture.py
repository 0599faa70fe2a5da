"""Modes and mixtures on the configuration manifold (CSS section 3.3)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from estimator.data.formats.checked_arrays import Field
from estimator.inference.origin import Origin

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
