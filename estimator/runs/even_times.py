"""A motion at even times, for formats with a single rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.runs.filtering import evenly_spaced, frame_rate
from humanoid.kinematics.body import Body

LONGEST = 0.25  # s between frames over which a pose counts as seen
_SAME = 1e-6  # s by which a frame may be off an even time and stands for it


class EvenMotion(NamedTuple):
    """time (K,) [s]: evenly spaced. q (K, nq): NaN where there is no pose. seen (K,) bool: frames of it on both sides
    were observed, and are at most `LONGEST` apart."""

    time: np.ndarray
    q: np.ndarray
    seen: np.ndarray


def even_motion(body: Body, q: np.ndarray, time: np.ndarray, seen: np.ndarray) -> EvenMotion:
    """Configurations q (T, nq) at rising time (T,) [s] at the usual rate of the frames, over the same span: unchanged
    where the frames are evenly spaced, else between neighbouring ones along the shortest way on the configuration
    manifold. seen (T,) bool: which frames were observed."""
    if len(time) < 3 or evenly_spaced(time):
        return EvenMotion(time, q, seen)
    rate = frame_rate(time)
    times = time[0] + np.arange(int((time[-1] - time[0]) * rate + _SAME * rate) + 1) / rate
    before = np.clip(np.searchsorted(time, times, side="right") - 1, 0, len(time) - 2)
    nearer = before + (times - time[before] > time[before + 1] - times)
    alone = np.abs(times - time[nearer]) < _SAME
    first, last = np.where(alone, nearer, before), np.where(alone, nearer, before + 1)
    step = time[last] - time[first]
    share = np.where(alone, 0.0, (times - time[first]) / np.where(alone, 1.0, step))
    there = np.isfinite(q).all(axis=1)
    known = there[first] & there[last]
    out = np.full((len(times), q.shape[1]), np.nan)
    out[known] = body.interpolated(q[first[known]], q[last[known]], share[known])
    return EvenMotion(times, out, known & seen[first] & seen[last] & (step <= LONGEST))
