"""Modes and mixtures on the configuration manifold (CSS section 3.3)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Mode:
    """One local minimum of the energy.

    q (nq,): configuration.
    covariance (nv, nv): inverse Hessian in the tangent space at q on the free directions, zero along active limits.
    energy: value of the cost at q.
    status: "converged", "stalled" or "iterations" (the budget ended first).
    kkt_residual: largest entry of the projected gradient, recomputed from the problem at q.
    penetration: deepest overlap of two body parts at q [m], 0 if none.
    parent: index of the mode of the previous frame that this one continues, -1 if none.
    association: which reading of the keypoints it explains: "as_detected" or "exchanged" (left and right swapped).
    """

    q: np.ndarray
    covariance: np.ndarray
    energy: float
    status: str
    kkt_residual: float = np.nan
    penetration: float = 0.0
    parent: int = -1
    association: str = "as_detected"


@dataclass(frozen=True)
class Mixture:
    """Weighted modes, best first; `weights` (K,) sum to one.

    log_scores (K,): unnormalised log-weights carried from frame to frame.
    """

    modes: tuple[Mode, ...]
    weights: np.ndarray
    log_scores: np.ndarray = field(default_factory=lambda: np.zeros(0))
