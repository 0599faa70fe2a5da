"""Gaussian and Student t proposals, shaped by the covariance of a mode or spherical."""

from __future__ import annotations

import math

import numpy as np

from humanoid.kinematics.body import Body

HELD_STD = 1e-3
"""Standard deviation [rad or m] of a proposal in directions that active limits hold, at any scale.

It is next to nothing, but not zero: densities of all modes are then per volume of the same, full dimension and can be
added in a mixture.
"""


class CovarianceScaledProposal:
    """A mode's covariance, rescaled, on the manifold, clamped into the limits (CSS section 4.2, Figure 6 steps 1, 2.2).

    Parameters
    ----------
    body: whose configurations are drawn.
    q (nq,): the mode. covariance (nv, nv): in the tangent space at q, zero rows and columns where limits are active
        (see `estimator.energy.descent.covariance.mode_covariance`), positive definite on the rest.
    scale: multiplies standard deviations; the s of CSS Figure 6, which multiplies the covariance, is scale^2.
    degrees_of_freedom: of a multivariate Student t distribution, heavier in the tails the fewer they are; infinite for
        a Gaussian. The scale is that of the t's core: its covariance, where it has one, is larger by n / (n - 2).

    """

    def __init__(
        self, body: Body, q: np.ndarray, covariance: np.ndarray, scale: float, degrees_of_freedom: float = math.inf
    ) -> None:
        self._body, self._q, self._tail = body, q, degrees_of_freedom
        free = free_directions(covariance)
        shape = np.diag(np.full(body.nv, HELD_STD**2))
        shape[np.ix_(free, free)] = scale**2 * covariance[np.ix_(free, free)]
        self._factor = np.linalg.cholesky(shape)
        self._log_constant = log_density_at_centre(body.nv, degrees_of_freedom) - float(
            np.log(np.diag(self._factor)).sum()
        )

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `estimator.search.proposals.Proposal`."""
        step = self._factor @ rng.standard_normal(self._body.nv)
        if math.isfinite(self._tail):
            step /= math.sqrt(rng.chisquare(self._tail) / self._tail)
        return self._body.integrate(self._q, step)

    def log_density(self, q: np.ndarray) -> float:
        """See `estimator.search.proposals.Proposal`."""
        whitened = np.linalg.solve(self._factor, self._body.difference(self._q, q))
        distance, n = float(whitened @ whitened), self._tail
        if math.isfinite(n):
            return self._log_constant - 0.5 * (n + self._body.nv) * math.log1p(distance / n)
        return self._log_constant - 0.5 * distance


class SphericalProposal(CovarianceScaledProposal):
    """The same standard deviation in every direction, of the volume that the rescaled covariance's ellipsoid has.

    The rival of covariance scaling in CSS section 7: what inflated dynamical noise does. The standard deviation is
    scale times the geometric mean of the covariance's own. A radian counts as much as a metre. Directions fixed by
    active limits belong to neither volume. Parameters are those of `CovarianceScaledProposal`.
    """

    def __init__(
        self, body: Body, q: np.ndarray, covariance: np.ndarray, scale: float, degrees_of_freedom: float = math.inf
    ) -> None:
        free = free_directions(covariance)
        sphere = np.zeros_like(covariance)
        sphere[free, free] = geometric_mean_variance(covariance)
        super().__init__(body, q, sphere, scale, degrees_of_freedom)


def free_directions(covariance: np.ndarray) -> np.ndarray:
    """Indices of the degrees of freedom that a covariance (nv, nv) leaves free."""
    return np.flatnonzero(np.diag(covariance) > 0.0)


def geometric_mean_variance(covariance: np.ndarray) -> float:
    """The variance of a sphere with the volume of the covariance's ellipsoid, over the free directions."""
    free = free_directions(covariance)
    if len(free) == 0:
        return 0.0
    return math.exp(float(np.linalg.slogdet(covariance[np.ix_(free, free)])[1]) / len(free))


def log_density_at_centre(n: int, tail: float) -> float:
    """Log-density at the centre of a standard Gaussian or t distribution of n dimensions."""
    if not math.isfinite(tail):
        return -0.5 * n * math.log(2.0 * math.pi)
    return math.lgamma(0.5 * (tail + n)) - math.lgamma(0.5 * tail) - 0.5 * n * math.log(tail * math.pi)
