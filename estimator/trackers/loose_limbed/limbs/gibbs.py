"""Maximum entropy: the least committed density of several quantised measurements that has given joint marginals.

p(f) = exp(sum_i <weights_i, xi_i(f)>) / Z, where xi_i selects the entry of one joint marginal, as a one-hot vector
(Zhu, Wu, Mumford, IJCV 27(2), 1998; Roth, Sigal, Black, CVPR 2004; the sign is in the weights). Its parameters are
those of greatest likelihood, a convex problem. With a few measurements of a few levels Z is a sum over all states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import prod

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

REGULARISATION = 1e-4  # of the squared weights, beside the mean log-likelihood of an example


@dataclass(frozen=True, eq=False)
class Gibbs:
    """levels (D): of each measurement. marginals (M): pairs (i, j), i < j, of measurements whose joint marginals the
    density has; weights (M): of each, (levels i, levels j)."""

    levels: tuple[int, ...]
    marginals: tuple[tuple[int, int], ...]
    weights: tuple[np.ndarray, ...]

    def log_density(self) -> np.ndarray:
        """Logarithm of the density of every state, (levels 0, ..., levels D - 1); their sum is 1."""
        energy = np.zeros(self.levels)
        for marginal, weight in zip(self.marginals, self.weights, strict=True):
            energy += weight.reshape([n if i in marginal else 1 for i, n in enumerate(self.levels)])
        return np.asarray(energy - logsumexp(energy))


def all_pairs(count: int) -> tuple[tuple[int, int], ...]:
    """Every pair (i, j), i < j, of `count` measurements."""
    return tuple(combinations(range(count), 2))


def log_marginal(log_density: np.ndarray, measurements: Sequence[int]) -> np.ndarray:
    """Logarithm of the density of some of the measurements, in their order, the others summed over."""
    gone = tuple(i for i in range(log_density.ndim) if i not in measurements)
    return np.asarray(logsumexp(log_density, axis=gone) if gone else log_density)


def fitted(
    states: np.ndarray,
    levels: tuple[int, ...],
    marginals: tuple[tuple[int, int], ...],
    regularisation: float = REGULARISATION,
) -> Gibbs:
    """The density of greatest penalised likelihood of examples, states (N, D) int, each below its measurement's levels.

    Without the penalty its joint marginals are the examples' own; the penalty keeps what was never seen possible.
    """
    counted = np.bincount(np.ravel_multi_index(tuple(states.T), levels), minlength=prod(levels)) / len(states)
    shares = counted.reshape(levels)
    wanted = np.concatenate([_marginal(shares, m).ravel() for m in marginals])

    def made(flat: np.ndarray) -> Gibbs:
        sizes = [levels[i] * levels[j] for i, j in marginals]
        parts = np.split(flat, np.cumsum(sizes)[:-1])
        return Gibbs(
            levels,
            marginals,
            tuple(p.reshape(levels[i], levels[j]) for p, (i, j) in zip(parts, marginals, strict=True)),
        )

    def loss(flat: np.ndarray) -> tuple[float, np.ndarray]:
        log_p = made(flat).log_density()
        p = np.exp(log_p)
        had = np.concatenate([_marginal(p, m).ravel() for m in marginals])
        value = -float((shares * log_p).sum()) + 0.5 * regularisation * float(flat @ flat)
        return value, had - wanted + regularisation * flat

    start = np.zeros(len(wanted))
    solution = minimize(
        loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 1000, "ftol": 1e-12, "gtol": 1e-6}
    )
    return made(solution.x)


def _marginal(density: np.ndarray, measurements: tuple[int, int]) -> np.ndarray:
    return np.asarray(density.sum(axis=tuple(i for i in range(density.ndim) if i not in measurements)))
