"""Annealing a weighted set through powers of the likelihood (Deutscher, Blake and Reid 2000)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.inference.particles import Particles, effective_count, normalised, systematic


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
    `estimator.inference.particles.effective_count`, after weighing by that power."""

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
    is looked for in.
    """
    excess = energies - np.min(energies)
    spread = float(np.mean(excess))
    if spread <= 0.0:
        return 1.0  # all are alike: any power does
    wanted = survival * len(energies)

    def alive(power: float) -> float:
        weights = np.exp(-power * excess)  # the largest is 1: no need of `normalised`, which would look for it
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
