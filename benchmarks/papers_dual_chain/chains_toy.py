"""Two random walks that see the same point: chains whose exact inference is known, by formula and on a grid.

S_i moves by N(0, Q), F is S_i + N(0, R) under each chain, and O is F + N(0, NOISE). Both coordinates of the point are
alike and independent, so that a grid of one coordinate is enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.inference.annealing import normalised
from estimator.inference.chains.evidence import Evidence
from estimator.inference.chains.exchange import Message
from estimator.inference.chains.feature_density import FeatureDensity, gaussian, uniform

Q, R, NOISE = 0.25, 0.25, 0.5  # variances
POINT = ("point",)
GRID = np.linspace(-14.0, 14.0, 2801)


@dataclass(frozen=True, eq=False)
class Belief:
    """N(mean (2,), variance) of where a walk is."""

    mean: np.ndarray
    variance: float


@dataclass(frozen=True)
class Walk:
    """A chain that is a random walk, with r more of noise to the point; `informed` is whether it predicts it at all."""

    q: float = Q
    r: float = R
    informed: bool = True

    def predict(self, state: Belief, dt: float) -> Belief:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        return Belief(state.mean, state.variance + self.q * dt)

    def features(self, prior: Belief) -> FeatureDensity:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        if not self.informed:
            return uniform(POINT)
        return gaussian(POINT, prior.mean[None], (prior.variance + self.r) * np.eye(2))

    def update(self, prior: Belief, message: Message) -> tuple[Belief, float]:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        received = message.evidence.collapsed()
        if not received.known.any():
            return prior, float(received.log_weight[0])
        variance = prior.variance + self.r + float(received.covariance[0, 0, 0])
        gain = prior.variance / variance
        off = received.mean[0, 0] - prior.mean
        weight = received.log_weight[0] - 0.5 * off @ off / variance - np.log(2.0 * np.pi * variance)
        return Belief(prior.mean + gain * off, (1.0 - gain) * prior.variance), float(weight)


@dataclass(frozen=True, eq=False)
class WeightedStates:
    """states (N, 2) with weights (N,) that sum to one."""

    states: np.ndarray
    weights: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """(2,)"""
        return np.asarray(self.weights @ self.states)

    @property
    def variance(self) -> np.ndarray:
        """The variance of each coordinate, (2,)."""
        return np.asarray(self.weights @ np.square(self.states - self.mean))


class ParticleWalk:
    """The same walk by weighted samples, each with a sample of the point."""

    def __init__(self, rng: np.random.Generator, q: float = Q, r: float = R) -> None:
        self._rng, self.q, self.r = rng, q, r

    def predict(self, state: WeightedStates, dt: float) -> WeightedStates:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        rows = self._rng.choice(len(state.weights), size=len(state.weights), p=state.weights)
        moved = state.states[rows] + np.sqrt(self.q * dt) * self._rng.standard_normal(state.states.shape)
        return WeightedStates(moved, np.full(len(rows), 1.0 / len(rows)))

    def features(self, prior: WeightedStates) -> FeatureDensity:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        off = prior.states - prior.mean
        return gaussian(POINT, prior.mean[None], (prior.weights[:, None] * off).T @ off + self.r * np.eye(2))

    def update(self, prior: WeightedStates, message: Message) -> tuple[WeightedStates, float]:
        """See `estimator.inference.chains.exchange.FeatureChain`."""
        received = message.evidence
        if not received.known.any():
            return prior, float(received.log_weight[0])
        blurred = FeatureDensity(
            received.names, received.log_weight, received.known, received.mean, received.covariance + self.r * np.eye(2)
        )
        log_weights = np.log(prior.weights) + blurred.log_density(prior.states[:, None])
        weights, log_mean = normalised(log_weights)
        return WeightedStates(prior.states, weights), log_mean + float(np.log(len(weights)))


def seen(point: np.ndarray | None, noise: float = NOISE) -> Evidence:
    """phi(O, F) of a point (2,) that was seen, or of none."""
    if point is None:
        return Evidence(uniform(POINT), np.array([[-1]]))
    return Evidence(gaussian(POINT, np.asarray(point)[None], noise * np.eye(2)), np.array([[0]]))


@dataclass(frozen=True, eq=False)
class Joint:
    """Exact: the normal density of both walks' first coordinates, mean (2,), covariance (2, 2) (eq. 4)."""

    mean: np.ndarray
    covariance: np.ndarray

    def stepped(self, observed: float | None, q: float = Q, r: float = R, noise: float = NOISE) -> Joint:
        """One frame later: the potential of both walks, in which F is integrated out, times what was expected."""
        C = self.covariance + q * np.eye(2)
        precision = np.linalg.inv(C)
        shift = precision @ self.mean
        # F | S1, S2, O: three normal factors of one number
        factors = [1.0 / r, 1.0 / r] + ([] if observed is None else [1.0 / noise])
        total = sum(factors)
        places = np.eye(2) / r
        potential = places - np.outer([1.0 / r, 1.0 / r], [1.0 / r, 1.0 / r]) / total
        pull = np.zeros(2) if observed is None else np.array([1.0 / r, 1.0 / r]) * (observed / noise) / total
        covariance = np.linalg.inv(precision + potential)
        return Joint(covariance @ (shift + pull), covariance)


def on_grid(
    first: np.ndarray, second: np.ndarray, observed: float | None, q: float = Q, r: float = R, noise: float = NOISE
) -> tuple[np.ndarray, np.ndarray]:
    """Eq. 5 (eq. 3 at first) by sums: densities (G,) of both walks on `GRID` after one frame."""
    h = GRID[1] - GRID[0]

    def blurred(density: np.ndarray, variance: float) -> np.ndarray:
        kernel = np.exp(-0.5 * np.square(GRID[:, None] - GRID[None, :]) / variance) / np.sqrt(2 * np.pi * variance)
        return np.asarray(kernel @ density * h)

    prior = [blurred(first, q), blurred(second, q)]
    to_point = [blurred(p, r) for p in prior]
    seen_ = np.ones(len(GRID)) if observed is None else np.exp(-0.5 * np.square(GRID - observed) / noise)
    after = [p * blurred(other * seen_, r) for p, other in zip(prior, to_point[::-1], strict=True)]
    return after[0] / (after[0].sum() * h), after[1] / (after[1].sum() * h)
