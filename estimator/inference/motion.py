"""Motion prior of bodies from frame to frame."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class MotionPrior(NamedTuple):
    """Energy of velocities and accelerations in the tangent space, every degree of freedom by itself.

    velocity_std (nv,) [per second], acceleration_std (nv,) [per second squared]: standard deviations. nu: of the
    Lorentzian (`estimator.numerics.robust`): a sudden movement is unlikely but possible. correlation [s]: how long a
    movement lasts; frames that follow sooner count proportionally less, or every frame of a faster camera would count
    as a movement of its own. 0: each counts in full. memory [s]: the time in which an acceleration forgets itself, by a
    factor of e; the innovation of each counts, relative to the remainder of the one before (a first-order
    autoregression). pace (T, nv): how quick a person is about each frame, as a factor of acceleration_std; None: 1.
    """

    velocity_std: np.ndarray
    acceleration_std: np.ndarray
    nu: float = 8.0
    correlation: float = 0.0
    memory: float = 0.0
    pace: np.ndarray | None = None

    def frames(self, low: int, high: int) -> MotionPrior:
        """The prior of the frames from `low` up to `high`."""
        return self if self.pace is None else self._replace(pace=self.pace[low:high])

    def left(self, span: float) -> float:
        """Remaining share of an acceleration after a time [s]."""
        return math.exp(-span / self.memory) if self.memory > 0.0 else 0.0

    def innovation(self, span: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factors (M,) of an acceleration, and of the one `span` (M,) [s] before, whose difference is the innovation,
        with the standard deviation of the accelerations themselves."""
        left = np.array([self.left(s) for s in span.tolist()])
        scale = 1.0 / np.sqrt(1.0 - np.square(left))
        return scale, left * scale

    def news(self, v: np.ndarray, dt: np.ndarray) -> np.ndarray:
        """Innovations of the accelerations (T - 2, nv, ...) between velocities v (T - 1, nv, ...) over dt (T - 1,) [s],
        with the standard deviation of the accelerations themselves."""
        span = 0.5 * (dt[1:] + dt[:-1])
        a = np.diff(v, axis=0) / span.reshape(-1, *[1] * (v.ndim - 1))
        after, before = (factor.reshape(-1, *[1] * (v.ndim - 1)) for factor in self.innovation(span[1:]))
        return np.concatenate([a[:1], after * a[1:] - before * a[:-1]])

    def share(self, dt: float) -> float:
        """Weight of a movement that follows `dt` seconds after another."""
        return min(1.0, dt / self.correlation) if self.correlation > 0.0 else 1.0

    def velocity_energy(self, v: np.ndarray, dt: float) -> np.ndarray:
        """Energy (...) of velocities (..., nv) over `dt` seconds."""
        return self.share(dt) * self._energy(v / self.velocity_std)

    def acceleration_energy(self, a: np.ndarray, dt: float) -> np.ndarray:
        """Energy (...) of accelerations (..., nv) that last `dt` seconds."""
        return self.share(dt) * self._energy(a / self.acceleration_std)

    def _energy(self, e: np.ndarray) -> np.ndarray:
        energy: np.ndarray = 0.5 * self.nu * np.log1p(np.square(e) / self.nu).sum(axis=-1)
        return energy


def frame_shares(dt: np.ndarray, lasting: float) -> np.ndarray:
    """Weights of T frames that are dt (T - 1,) [s] apart, where the evidence of a frame and its errors are correlated
    for `lasting` [s]; 1 each where that is 0."""
    if lasting <= 0.0 or not len(dt):
        return np.ones(len(dt) + 1)
    return np.minimum(1.0, np.convolve(dt, [0.5, 0.5]) / lasting)
