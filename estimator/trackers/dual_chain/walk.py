"""Metropolis' moves of many samples at once, which learn the size and the direction of steps from each other.

From samples of a prediction to samples of the posterior, through powers of the likelihood, with moves.

A sequential Monte Carlo sampler (Del Moral, Doucet and Jasra 2006) along the path of annealed importance sampling (Neal
2001): between two powers samples are weighted and selected, and at each they are moved by kernels that leave the
density of that power invariant. So it ends in samples of the posterior, unlike `estimator.inference.annealing`. A state
may be anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from estimator.inference.annealing import effective_count, normalised, systematic
from humanoid.support.settings import CheckedSettings, setting

_SHORTEST, _LONGEST = 0.2, 1.2  # of a step along the difference of two others; 2.4 / sqrt(2 D) is best for normal ones
_WHOLE = 0.1  # share of steps that are the whole difference: from one mode to another
_NOISE = 0.05  # of a step, in `SampleBox.std`


P = TypeVar("P", bound="Prepared")


class Prepared(Protocol):
    """Intermediate results of a target for N samples."""

    def of(self: P, rows: np.ndarray) -> P:
        """The values of some rows."""
        ...


class SampleTarget(Protocol[P]):
    """A density of samples x (N, D), as logarithms: the prediction of each group of dimensions by itself, the messages
    about whole samples, which count from the start, and the likelihood that is let in by powers."""

    def prepared(self, x: np.ndarray) -> P:
        """Input of the last two."""
        ...

    def of_group(self, x: np.ndarray, group: int) -> np.ndarray:
        """Log-density (N,) of the prediction of one group."""
        ...

    def log_message(self, samples: P) -> np.ndarray:
        """Log-densities (N,) of the messages at them."""
        ...

    def likelihood(self, samples: P) -> np.ndarray:
        """Log-likelihood (N,) that is let in by powers."""
        ...


@dataclass(frozen=True, eq=False)
class SampleBox:
    """Box in which samples of D dimensions can be moved. groups: dimensions that are moved at once. std (D,): the size
    of the noise that is added to equal samples. lower, upper (D,): of the box they stay in."""

    groups: Sequence[np.ndarray]
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class Samples(NamedTuple):
    """x (N, D), and their values by a target: by_group (N, G), log_message (N,), likelihood (N,)."""

    x: np.ndarray
    by_group: np.ndarray
    log_message: np.ndarray
    likelihood: np.ndarray

    def of(self, rows: np.ndarray) -> Samples:
        """Some of them, in a new order."""
        return Samples(*(values[rows] for values in self))


@dataclass(frozen=True, eq=False)
class Walk:
    """Moves in two halves: each half steps along differences of the other's samples (ter Braak 2006), so that steps
    have the size and the direction of the density, and trades groups with it.

    A move is accepted by prediction and messages first, and only then by the likelihood, which costs most (Christen and
    Fox 2005): both leave the density invariant.
    """

    rng: np.random.Generator
    target: SampleTarget[Any]
    box: SampleBox

    def initial_samples(self, x: np.ndarray, likelihood: np.ndarray) -> Samples:
        """Samples x (N, D) whose likelihood (N,) is known."""
        by_group = [self.target.of_group(x, g) for g in range(len(self.box.groups))]
        return Samples(x, np.stack(by_group, axis=1), self.target.log_message(self.target.prepared(x)), likelihood)

    def moved(self, samples: Samples, power: float) -> tuple[Samples, float]:
        """Samples after a step and a trade each, by a power of the likelihood, and the share that was accepted."""
        after = samples.of(self.rng.permutation(len(samples.x)))
        half = len(after.x) // 2
        lower, upper = np.arange(half), np.arange(half, 2 * half)
        accepted = sum(self._stepped(after, *rows, power) for rows in ((lower, upper), (upper, lower)))
        if len(self.box.groups) == 1:
            return after, accepted / max(2 * half, 1)
        return after, (accepted + self._traded(after, lower, upper, power)) / max(4 * half, 1)

    def _stepped(self, samples: Samples, rows: np.ndarray, others: np.ndarray, power: float) -> int:
        """Move one group of each of some rows along the difference of two of the others, in place; how many."""
        rng, count = self.rng, len(rows)
        group = rng.integers(len(self.box.groups), size=count)
        a, b = others[rng.integers(len(others), size=(2, count))]
        length = np.exp(rng.uniform(np.log(_SHORTEST), np.log(_LONGEST), size=(count, 1)))
        length[rng.random(count) < _WHOLE] = 1.0
        step = length * (samples.x[a] - samples.x[b])
        step += _NOISE * self.box.std * rng.standard_normal(step.shape)
        x = samples.x[rows] + np.where(self._of_group(group), step, 0.0)
        by_group = samples.by_group[rows].copy()
        inside = ((x >= self.box.lower) & (x <= self.box.upper)).all(axis=1)
        by_group[~inside] = -np.inf
        for g in range(len(self.box.groups)):
            own = np.flatnonzero(inside & (group == g))
            by_group[own, g] = self.target.of_group(x[own], g)
        return self._taken(samples, rows, x, by_group, power, 1)

    def _traded(self, samples: Samples, left: np.ndarray, right: np.ndarray, power: float) -> int:
        """Exchange one group of each pair, in place: what is expected of groups goes with them; how many were."""
        group = self.rng.integers(len(self.box.groups), size=len(left))
        mask = self._of_group(group)
        own = np.arange(len(self.box.groups)) == group[:, None]
        a, b = samples.of(left), samples.of(right)
        x = np.vstack([np.where(mask, b.x, a.x), np.where(mask, a.x, b.x)])
        by_group = np.vstack([np.where(own, b.by_group, a.by_group), np.where(own, a.by_group, b.by_group)])
        return self._taken(samples, np.concatenate([left, right]), x, by_group, power, 2)

    def _taken(
        self, samples: Samples, rows: np.ndarray, x: np.ndarray, by_group: np.ndarray, power: float, together: int
    ) -> int:
        """Replace rows by new x (R, D) where they are accepted, in place; `together` 2 where the first half is accepted
        with the second, each with its own, or not at all."""
        old, expected = samples.of(rows), by_group.sum(axis=1)
        possible = np.flatnonzero(self._all(np.isfinite(expected), together))
        log_message = np.full(len(rows), -np.inf)
        prepared = self.target.prepared(x[possible])
        log_message[possible] = self.target.log_message(prepared)
        gain = np.full(len(rows), -np.inf)
        gain[possible] = (expected + log_message)[possible] - (old.by_group.sum(axis=1) + old.log_message)[possible]
        before, possible = possible, self._accepted(gain, together)
        likelihood, gain = np.full(len(rows), -np.inf), np.full(len(rows), -np.inf)
        likelihood[possible] = self.target.likelihood(prepared.of(np.searchsorted(before, possible)))
        gain[possible] = power * (likelihood - old.likelihood)[possible]
        taken = self._accepted(gain, together)
        for values, new in zip(samples, (x, by_group, log_message, likelihood), strict=True):
            values[rows[taken]] = new[taken]
        return len(taken)

    def _accepted(self, gain: np.ndarray, together: int) -> np.ndarray:
        """The rows that Metropolis' rule accepts, by the gains (R,) of the logarithm."""
        gain = gain.reshape(together, -1).sum(axis=0)
        return np.flatnonzero(np.tile(np.log1p(-self.rng.random(len(gain))) < gain, together))

    @staticmethod
    def _all(good: np.ndarray, together: int) -> np.ndarray:
        """(R,) bool: rows that are good with those that go with them."""
        return np.tile(good.reshape(together, -1).all(axis=0), together)

    def _of_group(self, group: np.ndarray) -> np.ndarray:
        """(N, D) bool: the dimensions of a group (N,) each."""
        member = np.zeros((len(self.box.groups), len(self.box.std)), dtype=bool)
        for g, dims in enumerate(self.box.groups):
            member[g, dims] = True
        return np.asarray(member[group])


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
