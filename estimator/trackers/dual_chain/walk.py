"""Metropolis' moves of many samples at once, which learn the size and the direction of steps from each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

_SHORTEST, _LONGEST = 0.2, 1.2  # of a step along the difference of two others; 2.4 / sqrt(2 D) is best for normal ones
_WHOLE = 0.1  # share of steps that are the whole difference: from one mode to another
_NOISE = 0.05  # of a step, in `SampleBox.std`


P = TypeVar("P", bound="Prepared")


class Prepared(Protocol):
    """Intermediate results of a target for N samples."""

    def of(self: P, rows: np.ndarray) -> P:
        """Those of some rows."""
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
