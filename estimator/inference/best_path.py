"""The best trajectory through the modes that a tracker kept: dynamic programming backwards over all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.inference.motion import MotionPrior
from humanoid.kinematics.body import Body


def best_path(
    body: Body, q: Sequence[np.ndarray], energy: Sequence[np.ndarray], times: np.ndarray, motion: MotionPrior
) -> np.ndarray:
    """Index (T,) of the mode each frame has on the trajectory of least energy: that of its modes, each by itself, and
    of the motion between them (CSS footnote 2; Viterbi 1967 over pairs of successive modes, so that accelerations
    count).

    q (T) of (K, nq): the modes of each frame, at least one. energy (T) of (K,): of each with its own frame alone.
    times (T,) [s], rising.
    """
    if len(q) == 1:
        return np.array([int(np.argmin(energy[0]))])
    dt = float(times[1] - times[0])
    velocity = _velocities(body, q[0], q[1], dt)
    # least[j, k]: energy of the best beginning that ends in modes j and k of the last two frames
    least = energy[0][:, None] + energy[1][None, :] + motion.velocity_energy(velocity, dt)
    chosen: list[np.ndarray] = []  # for each frame from the third: which mode came before j and k
    for t in range(2, len(q)):
        dt = float(times[t] - times[t - 1])
        before, velocity = velocity, _velocities(body, q[t - 1], q[t], dt)
        span = float(0.5 * (times[t] - times[t - 2]))
        acceleration = (velocity[None] - before[:, :, None]) / span  # (i, j, k, nv)
        total = least[:, :, None] + motion.acceleration_energy(acceleration, span)
        chosen.append(np.argmin(total, axis=0))
        least = total.min(axis=0) + motion.velocity_energy(velocity, dt) + energy[t][None, :]
    path = list(np.unravel_index(int(np.argmin(least)), least.shape))
    for before_pair in reversed(chosen):
        path.insert(0, before_pair[path[0], path[1]])
    return np.array(path, dtype=np.int64)


def _velocities(body: Body, before: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
    """From every mode (J, nq) to every next one (K, nq), (J, K, nv) [per second]."""
    return np.array([[body.velocity(a, b, dt) for b in after] for a in before])
