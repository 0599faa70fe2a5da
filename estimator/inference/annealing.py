"""Weighted samples of any state: resampling, the bootstrap step, and annealing through powers of the likelihood
(Deutscher, Blake and Reid 2000).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

_PREFIX = "particle_"


@dataclass(frozen=True)
class Particles:
    """A weighted set that passes from frame to frame.

    states (N, S): a row each, as the filter lays it out. weights (N,): sum to one.
    owner (N,) int: the hypothesis of its frame that each belongs to.
    """

    states: np.ndarray
    weights: np.ndarray
    owner: np.ndarray

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything as plain arrays, exact to the last bit; `from_arrays` is the inverse."""
        return {_PREFIX + f.name: getattr(self, f.name) for f in fields(self)}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> Particles:
        """Rebuild a set from `arrays`, among others."""
        return Particles(**{f.name: arrays[_PREFIX + f.name] for f in fields(Particles)})


def normalised(log_weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights (N,) that sum to one from their logarithms, and the logarithm of their mean before.

    With log-likelihoods of an evenly weighted set the latter estimates the log-evidence of the observation.
    """
    highest = float(np.max(log_weights))
    weights = np.exp(log_weights - highest)
    total = float(weights.sum())
    return weights / total, highest + float(np.log(total / len(weights)))


def effective_count(weights: np.ndarray) -> float:
    """1 / sum w^2: how many evenly weighted particles are worth as much, from 1 to N."""
    return 1.0 / float(np.sum(np.square(weights)))


def systematic(rng: np.random.Generator, weights: np.ndarray, count: int) -> np.ndarray:
    """Indices (count,) drawn in proportion to weights (N,) that sum to one, in ascending order.

    One random number places a comb of `count` evenly spaced teeth on the cumulative weights, so that particle i is
    taken floor(count w_i) or ceil(count w_i) times (Kitagawa 1996; Arulampalam et al. 2002, algorithm 2).
    """
    cumulative = np.cumsum(weights)
    teeth = (rng.random() + np.arange(count)) / count * cumulative[-1]
    return np.minimum(np.searchsorted(cumulative, teeth, side="right"), len(weights) - 1)


def bootstrap_step(
    rng: np.random.Generator,
    states: np.ndarray,
    weights: np.ndarray,
    move: Callable[[np.ndarray], np.ndarray],
    log_likelihood: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Select, predict, measure: one step of CONDENSATION (Isard and Blake 1998, figure 6).

    Parameters
    ----------
    states (N, S), weights (N,): the set after the frame before.
    move: states (N, S) -> states one step later, noise and all.
    log_likelihood: moved states (N, S) and where each came from (N,) int -> (N,).

    Returns the new states (N, S), their weights (N,), the index (N,) of each one's ancestor and the log-evidence.
    """
    ancestor = systematic(rng, weights, len(weights))
    moved = move(states[ancestor])
    after, log_evidence = normalised(log_likelihood(moved, ancestor))
    return moved, after, ancestor, log_evidence


@dataclass(frozen=True)
class Annealing:
    """Settings of the annealing of a frame.

    layers: how many. survival: share of the particles that each lets live, see `annealing_power`. diffusion: noise
    before every layer but the first, as a share of the dynamics' noise, while the set has not shrunk.
    """

    layers: int
    survival: float
    diffusion: float


class Layers(NamedTuple):
    """Diagnostics of the layers of a frame. power (layers,): of the likelihood. effective_count (layers,): see
    `effective_count`, after weighing by that power."""

    power: np.ndarray
    effective_count: np.ndarray


def anneal(
    rng: np.random.Generator,
    particles: Particles,
    annealing: Annealing,
    disperse: Callable[[np.ndarray, np.ndarray | float], np.ndarray],
    energies: Callable[[np.ndarray, np.ndarray], np.ndarray],
    spread: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[Particles, Layers]:
    """One frame: select, disperse and weigh, layer by layer, with a power of the likelihood that each layer chooses.

    The noise shrinks with the set, in every dimension separately (Deutscher, Davison and Reid 2001), so that what the
    image constrains is settled first. It never exceeds that of the dynamics: in many dimensions half of the particles
    fill nearly as wide a range as all of them, and noise in proportion to the set alone would blow it up.

    Parameters
    ----------
    particles: the set after the frame before.
    disperse: states (N, S) and a scale, of the dynamics' noise in each dimension (D,) or in all -> states.
    energies: states (N, S) and their owners (N,) -> (N,).
    spread: states (N, S), weights (N,) -> standard deviation in each dimension (D,).

    The weights returned are those of the last layer's power, so they order the particles but are not a posterior.
    """
    scale: np.ndarray | float = 1.0
    first: np.ndarray | None = None
    powers, counts = np.zeros(annealing.layers), np.zeros(annealing.layers)
    for layer in range(annealing.layers):
        chosen = systematic(rng, particles.weights, len(particles.weights))
        states, owner = disperse(particles.states[chosen], scale), particles.owner[chosen]
        if first is None:
            first = np.maximum(spread(states, np.full(len(states), 1.0 / len(states))), 1e-12)
        values = energies(states, owner)
        powers[layer] = power = annealing_power(values, annealing.survival)
        weights = normalised(-power * values)[0]
        counts[layer] = effective_count(weights)
        particles = Particles(states, weights, owner)
        scale = annealing.diffusion * np.minimum(1.0, spread(states, weights) / first)
    return particles, Layers(powers, counts)


def annealing_power(energies: np.ndarray, survival: float, halvings: int = 50) -> float:
    """The power beta for which weights exp(-beta E) leave a given share of the particles alive.

    energies (N,). survival: alpha, effective count over N, below 1 (Deutscher, Blake and Reid 2000, section 4). A very
    large one where too many particles share the lowest energy for any power. halvings: of the interval that the power
    is searched for in.
    """
    excess = energies - np.min(energies)
    spread = float(np.mean(excess))
    if spread <= 0.0:
        return 1.0  # all are alike: any power does
    wanted = survival * len(energies)

    def alive(power: float) -> float:
        weights = np.exp(-power * excess)  # the largest is 1: no need of `normalised`, which would search for it
        weights /= np.add.reduce(weights)
        return effective_count(weights)

    high = 1.0 / spread
    while alive(high) > wanted and high * spread < 1e9:
        high *= 2.0
    low = 0.0
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if alive(middle) > wanted else (low, middle)
    return high
