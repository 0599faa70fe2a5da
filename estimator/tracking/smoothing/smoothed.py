"""A trajectory that was smoothed over a whole clip, and how its poses are moved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.sequence import Progress
from estimator.energy.cost import Cost
from estimator.inference.ground import Ground
from estimator.inference.motion import MotionPrior
from estimator.tracking.smoothing.chain import FrameChain, windows
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.ties import Ties
from humanoid.kinematics.body import Body
from humanoid.support.spilled import SpilledList

Matrices = np.ndarray | SpilledList[np.ndarray]
"""(T) of (nv, nv): an array, or those of a long clip, which are read on access."""


class Smoothed(NamedTuple):
    """q (T, nq): the trajectory, NaN where a frame has no hypothesis. floor: the one that it is above, given or found;
    None without one. covariance (T) of (nv, nv): of each pose given all frames, in the tangent space at it, NaN without
    one; None where it was not determined. mode (T,): which mode of each frame the trajectory goes through, -1 without
    one. weight (T, K): of the modes of each frame given all frames, NaN where there are fewer. draws (T, S, nv):
    movements to trajectories that may be instead (`TrajectoryUncertainty`), NaN without a pose; None where they are not
    determined."""

    q: np.ndarray
    floor: Ground | None = None
    covariance: Matrices | None = None
    mode: np.ndarray | None = None
    weight: np.ndarray | None = None
    draws: np.ndarray | None = None

    def frames(self, rows: Sequence[int]) -> Smoothed:
        """These frames alone."""
        mode, weight, draws = (None if part is None else part[rows] for part in (self.mode, self.weight, self.draws))
        covariance = None if self.covariance is None else np.array([self.covariance[t] for t in rows])
        return Smoothed(self.q[rows], self.floor, covariance, mode, weight, draws)


def smooth(
    body: Body,
    costs: Sequence[Cost],
    times: np.ndarray,
    q: np.ndarray,
    motion: MotionPrior,
    settings: SmoothSettings | None = None,
    progress: Progress | None = None,
    *,
    ties: Sequence[Ties] | None = None,
) -> np.ndarray:
    """Smoothed configurations (T, nq), within the limits; the total energy is never higher than at `q`.

    costs (T): static energy of each frame. times (T,) [s], rising. q (T, nq): the path. ties (T): of each frame to the
    one before.
    """
    settings = settings or SmoothSettings()
    q = np.array([body.clamp(x) for x in q])
    for first, last, low, high in windows(len(q), settings.window):
        held = np.ones(high - low, dtype=bool)
        held[first - low : last - low] = False
        tied = None if ties is None else ties[low + 1 : high]
        own = motion.frames(low, high)
        chain = FrameChain(body, costs[low:high], times[low:high], own, settings.tolerance, tied)
        q[low:high] = chain.descend(q[low:high], held, settings.iterations)
        if progress is not None:
            progress(last, len(q))
    return q
