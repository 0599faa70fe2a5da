"""What a tracker says of one frame: the hand-off from trackers to run files, exports and pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.filtering.origin import Origins


@dataclass(frozen=True)
class FrameResult:
    """K hypotheses for one frame, best first.

    index: number of the frame in the clip. time: seconds since the clip's start.
    status: "tracked"; "hard": the best mode did not converge, overlaps itself or explains few of the keypoints;
        "unobserved": too little was seen to search, the hypotheses are carried on (none before the first usable frame).
    q (K, nq), weight (K,), energy (K,), covariance (K, nv, nv): the modes.
    parent (K,) int: index of each mode's parent in the previous frame, -1 if none.
    kkt_residual (K,), penetration (K,) [m]: certificates of each mode, see `Mode`.
    association (K): see `Mode`. velocity (K, nv): see `Mode`; None in runs made before it was kept.
    origins: where the modes came from and what they paid; None where nothing was observed, and in such runs.
    """

    index: int
    time: float
    status: str
    q: np.ndarray
    weight: np.ndarray
    energy: np.ndarray
    covariance: np.ndarray
    parent: np.ndarray
    kkt_residual: np.ndarray
    penetration: np.ndarray
    association: tuple[str, ...]
    velocity: np.ndarray | None = None
    origins: Origins | None = None
