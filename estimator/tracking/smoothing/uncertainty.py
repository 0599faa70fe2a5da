"""How sure a smoothed trajectory is of every pose, all frames together, and of which modes it goes through."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from estimator.energy.cost import Cost
from estimator.inference.best_path import path_weights
from estimator.inference.motion import MotionPrior, frame_shares
from estimator.tracking.smoothing.chain import FrameChain
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.ties import Ties
from humanoid.kinematics.body import SHORTEST_STEP

_MOVEMENT = 0.06  # s for which a movement counts among modes: accelerations of captured motion hang together
_MARGIN = 30  # frames beyond some by which these are computed


class TrajectoryUncertainty:
    """Of trajectories through frames at times (T,) [s], rising.

    prior: energy that does not depend on observations. The evidence of frames is correlated for `settings.lasting`.
    """

    def __init__(self, prior: Cost, times: np.ndarray, motion: MotionPrior, settings: SmoothSettings) -> None:
        self._prior, self._body, self._times, self._settings = prior, prior.body, times, settings
        self._motion = motion

    def covariances(self, costs: Sequence[Cost], ties: Sequence[Ties], q: np.ndarray) -> Iterator[np.ndarray]:
        """(nv, nv) of each of the poses q (T, nq), see `FrameChain.covariances`. costs (T): energy of each frame. ties
        (T): of each frame to the one before.

        Raises
        ------
        numpy.linalg.LinAlgError: nothing holds a pose.
        """
        window, count = self._settings.window, len(q)
        for first in range(0, count, window):
            last = min(count, first + window)
            low, high = max(0, first - _MARGIN), min(count, last + _MARGIN)
            chain = FrameChain(
                self._body, costs[low:high], self._times[low:high], self._motion.frames(low, high),
                self._settings.tolerance, ties[low + 1 : high],
            )  # fmt: skip
            prior = np.array([self._prior.at(pose).hessian for pose in q[low:high]])
            yield from chain.covariances(q[low:high], self._settings.lasting, prior)[first - low : last - low]

    def weights(
        self, q: Sequence[np.ndarray], energies: Sequence[np.ndarray], between: MotionPrior
    ) -> list[np.ndarray]:
        """See `path_weights`: of modes q (T) of (K, nq) with energies (T) of (K,); between: the prior between them."""
        dt = np.maximum(np.diff(self._times), SHORTEST_STEP)
        shares = frame_shares(dt, self._settings.lasting)
        counted = [share * energy for share, energy in zip(shares, energies, strict=True)]
        between = between._replace(correlation=max(between.correlation, _MOVEMENT))
        return path_weights(self._body, q, counted, self._times, between)
