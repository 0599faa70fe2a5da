"""From samples of a prediction to samples of the posterior, through powers of the likelihood, with moves.

A sequential Monte Carlo sampler (Del Moral, Doucet and Jasra 2006) along the path of annealed importance sampling (Neal
2001): between two powers samples are weighted and selected, and at each they are moved by kernels that leave the
density of that power invariant. So it ends in samples of the posterior, unlike `estimator.inference.annealing`. A state
may be anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from estimator.inference.particles import effective_count, normalised, systematic
from estimator.trackers.dual_chain.walk import SampleBox, Samples, SampleTarget, Walk
from humanoid.support.settings import CheckedSettings, setting

_BISECTIONS = 30


@dataclass(frozen=True)
class TemperingSettings(CheckedSettings):
    """Settings of tempering, by which a likelihood is let in. powers: largest number of powers, 1 for all of it at
    once. survival: effective samples left by each, as a share of all. moves: of every sample at each power, 0 for none.
    Raises InputError where a value is outside its range."""

    powers: int = setting(12, at_least=1)
    survival: float = setting(0.15, above=0, below=1)
    moves: int = setting(3, at_least=0)


class Tempered(NamedTuple):
    """x (N, D): even samples. log_evidence: logarithm of the mean likelihood under what was expected. effective: the
    least effective count there was. powers: how many there were. accepted: share of the moves."""

    x: np.ndarray
    log_evidence: float
    effective: float
    powers: int
    accepted: float


def tempered(
    rng: np.random.Generator,
    x: np.ndarray,
    log_weight: np.ndarray,
    target: SampleTarget[Any],
    box: SampleBox,
    settings: TemperingSettings,
    least_power: float = 0.0,
) -> Tempered | None:
    """Samples of the target, from samples x (N, D) with log_weight (N,) of it without the likelihood.

    Each power is the highest that leaves `settings.survival` of the samples. least_power: the least that the
    first is, where samples were chosen by something like a power of the likelihood. None where no sample can be.
    """
    likelihood = target.likelihood(target.prepared(x))
    log_weight = np.where(np.isfinite(likelihood), log_weight, -np.inf)
    if not np.isfinite(log_weight).any():
        return None
    moves = settings.moves if settings.powers > 1 else 0
    walk = Walk(rng, target, box)
    samples = (
        walk.initial_samples(x, likelihood)
        if moves
        else Samples(x, np.zeros((len(x), 0)), np.zeros(len(x)), likelihood)
    )
    power, log_evidence, effective, accepted, count = 0.0, 0.0, float(len(x)), 0.0, 0
    while power < 1.0:
        lowest = 0.0 if count else least_power
        step = _next_step(
            log_weight, samples.likelihood, (lowest, 1.0 - power), settings.powers - count, settings.survival
        )
        power = min(power + step, 1.0) if count + 1 < settings.powers else 1.0
        weights, log_mean = normalised(_added(log_weight, step, samples.likelihood))
        log_evidence += log_mean
        effective = min(effective, effective_count(weights))
        samples, log_weight = samples.of(systematic(rng, weights, len(x))), np.zeros(len(x))
        count += 1
        for _ in range(moves):
            samples, share = walk.moved(samples, power)
            accepted += share
    return Tempered(samples.x, log_evidence, effective, count, accepted / max(count * moves, 1))


def _next_step(
    log_weight: np.ndarray, log_likelihood: np.ndarray, within: tuple[float, float], powers: int, survival: float
) -> float:
    """The longest step to a higher power, `within` the smallest allowed and the remainder to 1, that leaves enough
    effective samples; never so short that the `powers` that are left do not reach it."""
    low, left = within
    least = survival * len(log_weight)

    def effective(step: float) -> float:
        return effective_count(normalised(_added(log_weight, step, log_likelihood))[0])

    if powers <= 1 or effective(left) >= least:
        return left
    high = left
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= least else (low, middle)
    return max(low, left / powers**2)


def _added(log_weight: np.ndarray, power: float, log_likelihood: np.ndarray) -> np.ndarray:
    """Log weights (N,) with a power of the likelihood; minus infinity is kept."""
    possible = np.isfinite(log_weight) & np.isfinite(log_likelihood)
    return np.where(possible, log_weight + power * np.where(possible, log_likelihood, 0.0), -np.inf)
