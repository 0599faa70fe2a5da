"""Two motions at the same moments: those of the coarser one, the finer one straight between its samples."""

from __future__ import annotations

import numpy as np

_SAME = 1e-6  # [s] what files round times by
_GAP = 1.5  # steps from one sample to the next above which there is nothing between them
_FINER = 0.9  # of the run's step: a reference with a shorter one is finer, not only rounded


def common_times(time: np.ndarray, reference_time: np.ndarray) -> np.ndarray:
    """The moments (M,) [s] to compare at: the reference's, or the run's `time` where the reference is finer."""
    return time if _step(reference_time) < _FINER * _step(time) else reference_time


def values_at(moments: np.ndarray, time: np.ndarray, values: np.ndarray, wraps: bool) -> np.ndarray:
    """Values (T,) of `time` (T,) at `moments` (M,) [s], linear between samples that are neighbours in `time`.

    wraps: whether values are angles [rad] that count the same after a whole turn. NaN before the first sample, after
    the last, and where a neighbouring sample is NaN or missing.
    """
    known = np.isfinite(values)
    order = np.flatnonzero(known)[np.argsort(time[known])]
    if not order.size:
        return np.full(len(moments), np.nan)
    t, v = time[order], np.unwrap(values[order]) if wraps else values[order]
    right = np.clip(np.searchsorted(t, moments), 0, len(t) - 1)
    left = np.maximum(right - 1, 0)
    near = np.where(np.abs(t[left] - moments) < np.abs(t[right] - moments), left, right)
    inside = (t[left] <= moments) & (moments <= t[right]) & (t[right] - t[left] <= _GAP * _step(time))
    between = np.where(inside, np.interp(moments, t, v), np.nan)
    return np.asarray(np.where(np.abs(t[near] - moments) <= _SAME, v[near], between))


def _step(time: np.ndarray) -> float:
    """The usual time between samples [s]; of a single one, infinite."""
    return float(np.median(np.diff(np.sort(time)))) if len(time) > 1 else np.inf
