"""Calibration of a tracker's own uncertainties, fitted by `python -m benchmarks calibration --fit`, see there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid.support.errors import InputError

_LOWEST = {"scale_spread": 0.0, "size_std": 0.0, "landmark_std": 0.0, "prior_weight": 1.0}


@dataclass(frozen=True)
class PosteriorCalibration:
    """Calibration of a tracker's hypotheses to a frame's posterior.

    covariance_scale: factor on the covariances. scale_spread: the noise of a clip's keypoints is not known well, so the
    factor on standard deviations is itself log-normal with this standard deviation, which makes tails longer.
    weight_temperature: weights are taken to the power of its inverse, so more than 1 makes them more even.
    prior_weight: how many times as much as in the tracker's energy the prior on rest positions counts in the
    covariances, 1 or more: wide priors are good for finding poses, but poses are less spread than these.
    limit_lean [rad or m]: mean distance from a limit that a mode leans on. size_std: relative standard deviation of the
    body's size, which one camera does not measure. It is an uncertainty of the distance, and counts only where the
    posterior is conditioned on the camera's place. landmark_std [m]: standard deviation of a detector's bias from a
    landmark, the same in all frames, averaged over the landmarks by their spread (`landmark_spread`), for names that
    detectors of people use. No number of frames removes this uncertainty, least of all for a foot, whose keypoints are
    near each other. It is 0 for a detector without such a bias, such as a simulated one. Where the places of keypoints
    were fitted by several cameras, the uncertainty of the fit counts instead.

    Raises
    ------
    InputError: a number that is not positive (`scale_spread` and the last two may be zero), `prior_weight` below 1.
    """

    covariance_scale: float = 1.0
    scale_spread: float = 0.2
    weight_temperature: float = 8.0
    prior_weight: float = 2.0
    limit_lean: float = 0.05
    size_std: float = 0.03
    landmark_std: float = 0.025

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            low = _LOWEST.get(name, 1e-6)
            if not (np.isfinite(value) and value >= low):
                raise InputError("calibration", f"{name} is {value:g}", remedy=f"{low:g} or more")


TRAJECTORY = PosteriorCalibration(covariance_scale=1.05, scale_spread=0.3, prior_weight=1.0, landmark_std=0.04)
"""That of smoothed trajectories, whose covariances count the prior once and the weights the frames by their correlation
(`estimator.tracking.smoothing.clip`); fitted like the other."""
