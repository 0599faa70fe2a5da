"""How uncertain loads are: by samples of what they are computed from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from estimator.dynamics.contact_forces import ContactLoads, Disturbance, InverseDynamics, Support
from estimator.dynamics.motion import Motion, near_mean
from humanoid.kinematics.body import Body
from humanoid.support.settings import CheckedSettings, setting

_WAVES = 24
_JITTER = 1e-12


def smooth_noise(rng: np.random.Generator, time: np.ndarray, count: int, correlation: float) -> np.ndarray:
    """Random curves (T, count) of unit variance with a correlation of exp(-1/2 (dt / correlation)^2), at times (T,)
    [s], as sums of waves (A. Rahimi, B. Recht, Random features for large-scale kernel machines, NIPS 2007)."""
    frequency = rng.normal(size=(count, _WAVES)) / correlation
    phase = rng.uniform(0.0, 2.0 * np.pi, (count, _WAVES))
    return np.asarray(np.sqrt(2.0 / _WAVES) * np.cos(time[:, None, None] * frequency + phase).sum(axis=2))


@dataclass(frozen=True)
class UncertaintySettings(CheckedSettings):
    """What loads are uncertain by.

    samples: how many. correlation [s]: how much longer an error of a smoothed pose lasts than those of frames; its
        covariance is the run's. overconfidence: errors of movements by keypoints and pictures over the deviations that
        smoothing gives them, by `python -m benchmarks captured_forces`. lost: standard deviation of the force that a
        motion lacks, as smoothing flattens peaks and flesh moves on its own, over the size of the force that
        accelerates the centre of mass in that direction; leak: of a level force, over its size in all directions; burst
        [s]: how long that lasts. strike [s]: standard deviation of when a foot begins and ceases to stand. sway [s]:
        how long a foot's force stays beside its pivot.

    lost and leak are those of `python -m benchmarks forces --learn`, widened for the long tails of such errors until
    90 % intervals hold about that many.
    """

    samples: int = setting(16, at_least=2)
    correlation: float = setting(0.15, above=0)
    overconfidence: float = setting(1.5, at_least=0)
    lost: float = setting(0.22, at_least=0)
    leak: float = setting(0.1, at_least=0)
    burst: float = setting(0.06, above=0)
    strike: float = setting(0.02, at_least=0)
    sway: float = setting(0.2, above=0)


def poses_off(
    rng: np.random.Generator, body: Body, time: np.ndarray, q: np.ndarray, covariance: np.ndarray, correlation: float
) -> np.ndarray:
    """Poses (T, nq) that are off q (T, nq) by smooth curves with covariances (T, nv, nv) of their tangents and a
    correlation [s], at times (T,) [s]; those that are not known stay so."""
    known = np.isfinite(q).all(axis=1)
    factors = np.linalg.cholesky(np.nan_to_num(covariance[known]) + _JITTER * np.eye(body.nv))
    noise = smooth_noise(rng, time, body.nv, correlation)[known]
    moved = q.copy()
    moved[known] = body.integrated(q[known], np.einsum("tij,tj->ti", factors, noise))
    return moved


def samples_of(
    rng: np.random.Generator,
    dynamics: InverseDynamics,
    motion: Motion,
    others: Iterable[Motion],
    support: Support | None,
    settings: UncertaintySettings,
) -> Iterator[ContactLoads]:
    """Loads that may be instead of those of a motion: of other motions, by feet that stand sooner and later, and by
    disturbances."""
    std = lacking(accelerating(dynamics, motion, settings.burst), settings)
    for other in others:
        force = std * smooth_noise(rng, motion.time, 3, settings.burst)
        sway = dynamics.settings.aim * smooth_noise(rng, motion.time, 4, settings.sway).reshape(-1, 2, 2)
        shifted = None if support is None else _shifted(rng, motion.time, support, settings.strike)
        yield dynamics.loads(other, shifted, Disturbance(force, sway))


def accelerating(dynamics: InverseDynamics, motion: Motion, span: float) -> np.ndarray:
    """Size (T, 3), in units of the weight, of the force that accelerates the centre of mass: its root mean square over
    frames within about `span` [s]; 0 of a fixed base."""
    if not dynamics.body.has_free_root:
        return np.zeros((len(motion.time), 3))
    square = np.nan_to_num(np.square(dynamics.force_of_acceleration(motion) / dynamics.weight))
    known = np.maximum(near_mean(motion.time, motion.known.astype(float), 2.0 * span), _JITTER)
    return np.sqrt(near_mean(motion.time, square, 2.0 * span) / known[:, None])


def lacking(size: np.ndarray, settings: UncertaintySettings) -> np.ndarray:
    """Standard deviations (T, 3) of the force that a motion lacks, by the size (T, 3) of that which accelerates, both
    in units of the weight."""
    whole = np.linalg.norm(size, axis=1, keepdims=True)
    return np.hypot(settings.lost * size, settings.leak * whole * np.array([1.0, 1.0, 0.0]))


def _shifted(rng: np.random.Generator, time: np.ndarray, support: Support, std: float) -> Support:
    """The support with each point that stands sooner or later, by a normal time."""
    shifted = [np.interp(time - rng.normal(0.0, std), time, column) for column in support.standing.T]
    return support._replace(standing=np.stack(shifted, axis=1))
