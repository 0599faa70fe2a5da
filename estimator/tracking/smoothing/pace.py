"""A person's pace about each frame: accelerations come in bursts, over the joints of a limb together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.energy.cost import Cost
from estimator.inference.motion import MotionPrior
from estimator.tracking.smoothing.chain import FrameChain, windows
from estimator.tracking.smoothing.settings import SmoothSettings
from estimator.tracking.smoothing.ties import Ties
from humanoid.kinematics.body import ROOT_PLACE_V, SHORTEST_STEP, Body

_DRAWN = 24  # random movements, whose spread shows how much of an acceleration the frames determine
_SEED = 0
_FEWEST = 4  # frames
_LEAST_TOLD = 0.02
_SLOWEST, _QUICKEST = 0.3, 5.0
_FAR = 3.0  # standard deviations: frames farther away do not count
_TRUNK, _LEGS, _ARMS, _HEIGHT = range(4)
_LEG = ("knee", "ankle", "heel", "toe")


def pace_of(
    body: Body,
    costs: Sequence[Cost],
    times: np.ndarray,
    q: np.ndarray,
    motion: MotionPrior,
    settings: SmoothSettings,
    *,
    ties: Sequence[Ties] | None = None,
) -> np.ndarray:
    """The pace (T, nv) that explains a smoothed trajectory q (T, nq) best, of trunk, legs, arms and the root's height
    each.

    The accelerations' variance is common to a limb's joints and to the frames within `pace_span`, and is inverse gamma
    beforehand with `pace_count` as many degrees of freedom. Smoothing shrinks accelerations, the more the less the
    frames determine them, so each counts by the share that they determine: D. J. C. MacKay, Bayesian interpolation,
    Neural Computation 4(3), 1992. The shares are those at the prior's pace, so this and the smoothing are repeated a
    few times. costs (T), times (T,) [s], ties (T): see `smooth`.
    """
    pace = np.ones((len(q), body.nv)) if motion.pace is None else motion.pace
    if len(q) < _FEWEST:
        return pace
    square, share = np.zeros_like(pace), np.zeros_like(pace)
    for first, last, low, high in windows(len(q), settings.window):
        tied = None if ties is None else ties[low + 1 : high]
        own = motion.frames(low, high)
        chain = FrameChain(body, costs[low:high], times[low:high], own, settings.tolerance, tied)
        try:
            evidence = _evidence(body, chain, times[low:high], q[low:high], own)
        except np.linalg.LinAlgError:  # the uncertainty of the poses is not determined
            return pace
        square[first:last], share[first:last] = (part[first - low : last - low] for part in evidence)
    return _shared(body, times, square, share, settings)


def _evidence(
    body: Body, chain: FrameChain, times: np.ndarray, q: np.ndarray, motion: MotionPrior
) -> tuple[np.ndarray, np.ndarray]:
    """Squared innovations (T, nv) of the accelerations over their variance, with tails drawn in, and the share (T, nv)
    of each that the frames determine; 0 for the first frame and the last, which have none."""
    square, share = np.zeros((len(q), body.nv)), np.zeros((len(q), body.nv))
    dt = np.maximum(np.diff(times), SHORTEST_STEP)
    v = np.array([body.velocity(a, b, d) for a, b, d in zip(q[:-1], q[1:], dt, strict=True)])
    new = np.square(motion.news(v, dt) / motion.acceleration_std)
    pace = 1.0 if motion.pace is None else np.square(motion.pace[1:-1])
    slope = 1.0 / (1.0 + new / pace / motion.nu)
    samples = chain.draw(q, _DRAWN, np.random.default_rng(_SEED))
    away = np.diff(samples, axis=0) / dt[:, None, None]
    left = np.square(motion.news(away, dt)).mean(axis=2) / np.square(motion.acceleration_std)
    square[1:-1] = slope * new
    share[1:-1] = np.clip(1.0 - slope * left / pace, _LEAST_TOLD, 1.0)
    return square, share


def _shared(
    body: Body, times: np.ndarray, square: np.ndarray, share: np.ndarray, settings: SmoothSettings
) -> np.ndarray:
    """Pace (T, nv) from squares and shares (T, nv), see `_evidence`."""
    pace, limbs = np.ones_like(square), limbs_of(body)
    masks = [limbs == limb for limb in np.unique(limbs)]
    squares, shares = (np.stack([part[:, m].sum(axis=1) for m in masks], axis=1) for part in (square, share))
    for t, time in enumerate(times):
        low, high = np.searchsorted(times, (time - _FAR * settings.pace_span, time + _FAR * settings.pace_span))
        near = np.exp(-0.5 * np.square((times[low:high] - time) / settings.pace_span))
        count = settings.pace_count
        variance = (count + near @ squares[low:high]) / (count + near @ shares[low:high])
        for mask, of_limb in zip(masks, np.clip(np.sqrt(variance), _SLOWEST, _QUICKEST), strict=True):
            pace[t, mask] = of_limb
    return pace


def limbs_of(body: Body) -> np.ndarray:
    """Which limb each degree of freedom (nv,) belongs to: what moves landmarks of one side alone is of the legs or the
    arms, the rest of the trunk; but how a root slides along its z is a limb of its own, as people who hardly turn
    their trunks rise and fall with every step."""
    limbs = np.full(body.nv, _TRUNK)
    for d in range(body.nv):
        moved = [n for n, j in zip(body.landmark_names, body.landmark_joint, strict=True) if body.column_support[j, d]]
        if moved and any(all(name.startswith(side) for name in moved) for side in ("left_", "right_")):
            limbs[d] = _LEGS if any(name.endswith(_LEG) for name in moved) else _ARMS
    if body.has_free_root:
        limbs[ROOT_PLACE_V][-1:] = _HEIGHT
    return limbs
