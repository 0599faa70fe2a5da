"""How fast a belt moves from frame to frame, where it starts, stops or changes its speed: the path through a grid of
speeds that most feet move with and that changes least (Viterbi)."""

from __future__ import annotations

import numpy as np

from estimator.numerics.stretches import stretches

_MOST, _COUNT = 2.0, 41  # of the steady speed, and how many speeds are compared
_WIDTH = 0.15  # m/s: standard deviation of the velocity of what stands
_OTHERWISE = 0.05  # likelihood of a frame in which no foot moves with the belt
_CORRELATION = 0.05  # s: frames nearer than that are correlated
_ACCELERATION = 0.25  # of the steady speed: standard deviation of a change in a second, growing with the root of time
_CHANGE, _SHARE = 0.2, 0.2  # m/s, and share of the steady speed: what differs by more is another speed
_LASTS = 0.5  # s, where it lasts
_SMOOTH = 0.15  # s to either side, over which steps of the grid are smoothed


def speeds_over_time(velocity: np.ndarray, time: np.ndarray, steady: np.ndarray) -> np.ndarray:
    """Speeds (T,) [m/s] of a belt along its steady velocity (3,), the steady speed in all frames unless another lasts.

    velocity (T, 2, K, 3) [m/s]: of points of both feet, NaN where missing, at times (T,) [s].
    """
    speed = float(np.linalg.norm(steady))
    levels = np.linspace(0.0, _MOST, _COUNT) * speed
    gaps = np.diff(time)
    weight = np.minimum(1.0, np.gradient(time) / _CORRELATION)
    log = weight[:, None] * np.log(_OTHERWISE + _support(velocity, levels[:, None] * (steady / speed)))
    path = levels[_likeliest_path(log, levels / (_ACCELERATION * speed), gaps)]
    changed = np.abs(path - speed) > max(_CHANGE, _SHARE * speed)
    if all(time[end - 1] - time[first] < _LASTS for first, end in stretches(changed)):
        return np.full(len(time), speed)
    return _smoothed(path, time)


def _support(velocity: np.ndarray, belts: np.ndarray) -> np.ndarray:
    """How well the feet move with each belt (S, 3): (T, S), the mean of both feet's best points."""
    apart = np.stack([np.linalg.norm(velocity - belt, axis=3) for belt in belts], axis=1)
    nearest = np.where(np.isfinite(apart), apart, np.inf).min(axis=3)
    return np.asarray(np.exp(-0.5 * np.square(nearest / _WIDTH)).mean(axis=2))


def _likeliest_path(log: np.ndarray, levels: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Numbers (T,) of levels (S,) that change by one in a second, by log likelihoods (T, S) of frames `gaps` (T - 1,)
    [s] apart."""
    steps = 0.5 * np.square(levels[:, None] - levels)
    best, before = log[0], np.zeros(log.shape, dtype=int)
    for t, gap in enumerate(gaps, start=1):
        reached = best[:, None] - steps / gap
        before[t] = reached.argmax(axis=0)
        best = reached.max(axis=0) + log[t]
    path = np.zeros(len(log), dtype=int)
    path[-1] = best.argmax()
    for t in range(len(log) - 1, 0, -1):
        path[t - 1] = before[t, path[t]]
    return path


def _smoothed(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Means (T,) over the frames about each."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    first = np.searchsorted(time, time - _SMOOTH)
    end = np.searchsorted(time, time + _SMOOTH, side="right")
    return np.asarray((total[end] - total[first]) / (end - first))
