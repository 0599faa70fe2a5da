"""What a tracker says of one frame: the hand-off from trackers to run files, exports and pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.modes.origin import Origins

TRACKED = "tracked"
STATUS_MEANINGS = {
    TRACKED: "the best pose explains at least half of what was seen",
    "hard": "the best pose leaves half of the keypoints or of the outline unexplained, overlaps itself, moved"
    " faster than any body, or its search ended early: look at these frames with `kinemode explain`, and at their"
    " keypoints",
    "unobserved": "too few keypoints and no pictures: poses are carried on from the frame before; give keypoints there,"
    " or pictures to look at (--cues)",
}
"""What the statuses of a frame mean, and what to do: one line each, for wherever a status is printed."""


@dataclass(frozen=True)
class FrameResult:
    """K hypotheses for one frame, best first.

    index: number of the frame in the clip. time: seconds since the clip's start.
    status: see STATUS_MEANINGS; before the first usable frame an "unobserved" one has no hypotheses.
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
