"""Trajectories through the modes that a tracker kept: the best one, and how probable each mode is, by dynamic
programming over all of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import logsumexp

from estimator.inference.motion import MotionPrior
from humanoid.kinematics.body import Body
from humanoid.support.spilled import Spill, SpilledList

_KEPT = 1000  # arrays of pairs or triples of modes in memory


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
    chosen: list[np.ndarray] = []  # for each frame from the third: which mode came before j and k
    least = np.zeros(0)  # [j, k]: energy of the best beginning that ends in modes j and k of the last two frames
    for t, (moved, bent) in enumerate(_movements(body, q, times, motion), start=1):
        if bent is None:
            least = energy[0][:, None] + energy[1][None, :] + moved
            continue
        total = least[:, :, None] + bent
        chosen.append(np.argmin(total, axis=0))
        least = total.min(axis=0) + moved + energy[t][None, :]
    path = list(np.unravel_index(int(np.argmin(least)), least.shape))
    for before_pair in reversed(chosen):
        path.insert(0, before_pair[path[0], path[1]])
    return np.array(path, dtype=np.int64)


def path_weights(
    body: Body, q: Sequence[np.ndarray], energy: Sequence[np.ndarray], times: np.ndarray, motion: MotionPrior
) -> list[np.ndarray]:
    """Probability of each mode of each frame given all frames, (T) of (K,) that sum to one: the share of all
    trajectories through it, each weighted by its energy (forwards and backwards, Rabiner, Proceedings of the IEEE
    77(2), 1989, over pairs of successive modes). Arguments as of `best_path`."""
    if len(q) == 1:
        return [_shares(-energy[0])]
    spill = Spill(_KEPT)
    # [j, k]: log of all beginnings that end in modes j and k of the last two frames
    forwards: SpilledList[np.ndarray] = spill.list()
    movements = spill.list(_movements(body, q, times, motion))
    for t, (moved, bent) in enumerate(movements, start=1):
        before = -energy[0][:, None] if bent is None else logsumexp(forwards[-1][:, :, None] - bent, axis=0)
        forwards.append(before - moved - energy[t][None, :])
    backwards = np.zeros_like(forwards[-1])  # [j, k]: log of all that may follow these
    weights = [_shares(logsumexp(forwards[-1], axis=0))]
    for t in range(len(q) - 1, 0, -1):
        moved, bent = movements[t - 1]
        weights.insert(0, _shares(logsumexp(forwards[t - 1] + backwards, axis=1)))
        if bent is not None:
            backwards = logsumexp((backwards - moved - energy[t][None, :])[None] - bent, axis=2)
    return weights


def _shares(log: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(log - logsumexp(log)))


def _movements(
    body: Body, q: Sequence[np.ndarray], times: np.ndarray, motion: MotionPrior
) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    """For each frame from the second: energies (J, K) of the velocities from every mode of the frame before, and
    (I, J, K) of the accelerations, with the modes of the one before that; None of the second frame."""
    velocity = np.zeros(0)
    for t in range(1, len(q)):
        dt = float(times[t] - times[t - 1])
        before, velocity = velocity, _velocities(body, q[t - 1], q[t], dt)
        moved = motion.velocity_energy(velocity, dt)
        if t == 1:
            yield moved, None
            continue
        span = float(0.5 * (times[t] - times[t - 2]))
        yield moved, motion.acceleration_energy((velocity[None] - before[:, :, None]) / span, span)


def _velocities(body: Body, before: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
    """Velocities (J, K, nv) [per second] from every mode (J, nq) to every next one (K, nq)."""
    return np.array([[body.velocity(a, b, dt) for b in after] for a in before])
