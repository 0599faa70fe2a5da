"""Probability around modes, beside their height, which turns energies at modes into weights.

A mode's weight is the integral of exp(-energy) over its surroundings. CSS Figure 6 takes the height alone (step 3); a
broad mode then counts as little as a needle of the same height.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator.energy.cost import Cost, QuadraticModel
from estimator.energy.descent.solution import MAX_STD, free_mask
from estimator.search.proposals import log_density_at_centre
from humanoid.kinematics.body import Body

TAIL = 5.0  # degrees of freedom of the importance density: heavier than the posterior, so that no weight runs away


class Surroundings:
    """A density about a mode: Student's t in the directions that no active limit holds, falling exponentially away from
    the limits in the others, like the posterior there. A weak prior of standard deviation `MAX_STD` bounds what nothing
    observes, as in `mode_covariance`.

    Raises numpy.linalg.LinAlgError where the Hessian is not that of a minimum.
    """

    def __init__(self, body: Body, at: QuadraticModel) -> None:
        self._body, self._q = body, at.posed.q
        free = free_mask(body, at.posed.q, at.gradient)
        self._free, self._held = np.flatnonzero(free), np.flatnonzero(~free)
        precision = at.hessian[np.ix_(self._free, self._free)] + np.eye(len(self._free)) / MAX_STD**2
        self._root = np.linalg.cholesky(precision)  # precision = root root'
        self._log_determinant = 2.0 * float(np.log(np.diag(self._root)).sum())
        self._rate = np.maximum(np.abs(at.gradient[self._held]), 1.0 / MAX_STD)
        self._inward = np.sign(at.gradient[self._held])  # the energy rises into the admissible side

    @property
    def log_volume(self) -> float:
        """Log-volume of exp(-energy) relative to its height, by the second-order model (Laplace's approximation)."""
        gaussian = 0.5 * (len(self._free) * math.log(2.0 * math.pi) - self._log_determinant)
        return gaussian - float(np.log(self._rate).sum())

    def sample(self, rng: np.random.Generator) -> np.ndarray | None:
        """A configuration (nq,); None where the draw is beyond a limit."""
        step = np.zeros(self._body.nv)
        normal = np.linalg.solve(self._root.T, rng.standard_normal(len(self._free)))
        step[self._free] = normal / math.sqrt(rng.chisquare(TAIL) / TAIL)
        step[self._held] = self._inward * rng.exponential(size=len(self._held)) / self._rate
        q = self._body.integrate(self._q, step)
        return q if np.allclose(self._body.difference(self._q, q), step, atol=1e-9) else None

    def log_density(self, q: np.ndarray) -> float:
        """Log-density at q (nq,), per unit of tangent space at the mode."""
        step = self._body.difference(self._q, q)
        depth = self._inward * step[self._held]
        if (depth < -1e-12).any():
            return -math.inf
        n, whitened = len(self._free), self._root.T @ step[self._free]
        core = (
            log_density_at_centre(n, TAIL)
            + 0.5 * self._log_determinant
            - 0.5 * (TAIL + n) * math.log1p(float(whitened @ whitened) / TAIL)
        )
        return core + float((np.log(self._rate) - self._rate * depth).sum())


def importance_log_volumes(
    rng: np.random.Generator, body: Body, modes: Sequence[tuple[QuadraticModel, Cost]], count: int
) -> np.ndarray:
    """Log-volumes (K,) of modes, relative to their heights, by importance sampling (CSS section 8).

    modes (K): second-order model and energy of each. count: samples about each. They are weighted by the density of
    all surroundings together, and what a sample finds belongs to the modes in proportion to their densities there, so
    that modes that overlap share their surroundings instead of counting them twice.
    """
    densities = [Surroundings(body, at) for at, _ in modes]
    total = np.full(len(modes), -math.inf)
    for (_, cost), surroundings in zip(modes, densities, strict=True):
        for _ in range(count):
            q = surroundings.sample(rng)
            if q is None:
                continue
            each = np.array([d.log_density(q) for d in densities])
            log_sum = float(np.logaddexp.reduce(each))
            log_weight = -cost.value_at(q) - (log_sum - math.log(len(modes)))
            total = np.logaddexp(total, log_weight + each - log_sum)
    return total - math.log(count * len(modes)) + np.array([at.value for at, _ in modes])
