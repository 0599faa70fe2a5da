"""The best trajectory through what a tracker found: over a whole clip, or some frames behind a live one.

A filter has only the past to hold on to, and one camera sees depth so badly that single poses scatter along it. Here a
backward pass over the modes of all frames finds the trajectory that fits them and a motion prior best, and its poses
together minimise the sum of the frames' own energies and of that prior (CSS footnote 2).
"""

from estimator.tracking.smoothing.clip import smooth_track
from estimator.tracking.smoothing.fixed_lag import FixedLag
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.smoothed import Smoothed, smooth

__all__ = ["FixedLag", "SmoothSettings", "Smoothed", "smooth", "smooth_track"]
