"""Weighted samples: resampling and the bootstrap step. Independent of what a state is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

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
