"""The motion of a run's drawn trajectory, and motions that may be instead.

A spine has more joints than a body's one or three: bent, the chest comes nearer to the pelvis or goes farther from it
than that allows, in squats and landings by centimetres, and half of the body's mass moves with it. Markers show it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimator.dynamics.motion import Motion, motion_of, near_mean
from estimator.dynamics.trunk import Trunk
from estimator.dynamics.uncertainty import UncertaintySettings, poses_off
from estimator.runs.filtering import filtered, frame_rate
from estimator.runs.keypoint_residuals import marker_offsets
from estimator.runs.run_reader import Run
from estimator.tracking.smoothing import SmoothSettings

_CUTOFF = 12.0  # Hz
_FEWEST = 2  # markers
_SPAN = 0.022
"""[s] Standard deviation of the frames over which the trunk's markers are averaged, a low-pass at 6 Hz: skin slides
faster than spines bend."""


def motion_of_run(run: Run) -> Motion:
    """The motion of a run's drawn trajectory, its trunk as long as the markers on it have it."""
    return motion_of(run.body, run.time, run.q, trunk_stretch(run))


def usual_cutoff(time: np.ndarray) -> float:
    """Cut-off [Hz] of the filter that poses at times (T,) [s] usually get before forces, 0 for none, where frames are
    too few.

    The errors of walks, squats and rising by markers are the same from 8 to 20 Hz and without a filter; of a drop jump,
    whose smoothed trajectory has single accelerations of over a hundred m/s2, the peak is nearest to the plates' at 12
    (docs/history/measures.md).
    """
    return _CUTOFF if len(time) > 1 and frame_rate(time) > 2.0 * _CUTOFF else 0.0


def other_motions(rng: np.random.Generator, run: Run, settings: UncertaintySettings) -> Iterator[Motion]:
    """Motions that may be instead of that of the drawn trajectory, filtered as it is: poses are off by errors that last
    and, by keypoints or pictures, movements as the smoothing drew them. Of movements by markers these are two to three
    times as far off as force plates say (docs/history/measures.md), and what a motion lacks is enough."""
    body, covariance, stretch = run.body, _covariance(run), trunk_stretch(run)
    draws = None if run.smoothed is None or run.markers is not None else run.smoothed.draws
    known = np.isfinite(run.q).all(axis=1)
    for k in range(settings.samples):
        q = poses_off(rng, body, run.time, run.q, covariance, settings.correlation + _lasting(run))
        if draws is not None:
            q[known] = body.integrated(q[known], settings.overconfidence * draws[known, k % draws.shape[1]])
        if run.filtering is not None:
            q = filtered(body, q, run.time, run.filtering.cutoff).q
        yield motion_of(body, run.time, q, stretch)


def _covariance(run: Run) -> np.ndarray:
    """Covariances (T, nv, nv) of the drawn trajectory's poses."""
    smoothed = run.smoothed
    if smoothed is None or smoothed.covariance is None:
        return run.covariance
    return np.array([smoothed.covariance[t] for t in range(len(run.time))])


def _lasting(run: Run) -> float:
    """How long errors of the run's frames last [s], as its smoothing has it."""
    smooth = run.header.settings.get("smooth", {})
    return float(smooth.get("lasting", SmoothSettings().lasting))


def trunk_stretch(run: Run) -> np.ndarray | None:
    """How far (T,) [m] the markers on the trunk have moved along it, away from the pelvis, beside their usual places on
    it; None for a run or a body without such markers."""
    trunk, offsets = Trunk.of(run.body), marker_offsets(run)
    if offsets is None or trunk is None:
        return None
    axis = run.body.placed(np.nan_to_num(run.q)).rotations_of(trunk.joint) @ trunk.axis
    along = np.einsum("tni,ti->tn", offsets[:, run.body.marker_joint == trunk.joint], axis)
    along = along[:, np.isfinite(along).any(axis=0)]
    if along.shape[1] < _FEWEST:
        return None
    apart = along - np.nanmean(along, axis=0)
    known = np.isfinite(apart).any(axis=1)
    mean = np.interp(run.time, run.time[known], np.nanmean(apart[known], axis=1))
    return near_mean(run.time, mean, _SPAN)
