"""Proposals for modes: distributions of starts about a known one: Gaussian or Student t, shaped by the covariance of
the mode or spherical; one limb elsewhere; or regular starts along the few directions that the image constrains least.

The family's contract is `Proposal`. `LimbProposal` is the exception: it moves a few joints of any configuration and has
no density over all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from humanoid.kinematics.body import Body

HELD_STD = 1e-3
"""Standard deviation [rad or m] of a proposal in directions that active limits hold, at any scale.

It is tiny, but not zero: densities of all modes are then per volume of the same, full dimension and can be
added in a mixture.
"""


class Proposal(Protocol):
    """A distribution of configurations about a mode, on the configuration manifold."""

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """One configuration (nq,), within the joint limits."""
        ...

    def log_density(self, q: np.ndarray) -> float:
        """Log-density at q (nq,), per unit of tangent space at the mode (rad, m), as the importance weights of CSS
        section 8 need it.

        It is the density before samples are clamped into the limits: what the clamping piles up on a limit is spread
        over the inadmissible side in this density, so it integrates to 1 over the whole tangent space.
        """
        ...


class CovarianceScaledProposal:
    """A mode's covariance, rescaled, on the manifold, clamped into the limits (CSS section 4.2, Figure 6 steps 1, 2.2).

    Parameters
    ----------
    body: whose configurations are drawn.
    q (nq,): the mode. covariance (nv, nv): in the tangent space at q, zero rows and columns where limits are active
        (see `estimator.energy.descent.solution.mode_covariance`), positive definite on the rest.
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
        """See `Proposal`."""
        step = self._factor @ rng.standard_normal(self._body.nv)
        if math.isfinite(self._tail):
            step /= math.sqrt(rng.chisquare(self._tail) / self._tail)
        return self._body.integrate(self._q, step)

    def log_density(self, q: np.ndarray) -> float:
        """See `Proposal`."""
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


class LimbProposal:
    """Moves the joints from one joint outwards, all others staying where they are.

    Pictures are matched to a hypothesis from nearby, so a limb that has lost its image is found again only by trying it
    elsewhere: one limb at a time, since a sample of all joints at once is nowhere near the image (partitioned sampling,
    MacCormick and Isard 2000).

    least, most [rad]: standard deviation of the joints' change; less than `least` is what a search finds by itself.
    """

    def __init__(self, body: Body, least: float = 0.3, most: float = 1.2) -> None:
        self.body = body
        self._spread = np.log([least, most])  # rad, of the joints' change
        first = range(body.first_joint_dof, body.nv)  # a free root is not a limb
        self._behind = [np.flatnonzero([self._moves(d, e) for e in range(body.nv)]) for d in first]

    def _moves(self, dof: int, other: int) -> bool:
        """Whether `other` is `dof` or lies behind it, or behind a joint that follows it."""
        tree = self.body.tree
        column = int(tree.dof_column[other])
        while column >= 0 and tree.column_dof[column] != dof:
            column = int(tree.column_parent[column])
        return column >= 0

    def sample(self, rng: np.random.Generator, q: np.ndarray) -> np.ndarray:
        """q (nq,) with the joints behind a random one changed by a spread drawn evenly in its logarithm."""
        if not self._behind:
            return q
        dofs = self._behind[int(rng.integers(len(self._behind)))]
        step = np.zeros(self.body.nv)
        step[dofs] = np.exp(rng.uniform(*self._spread)) * rng.standard_normal(len(dofs))
        return self.body.integrate(q, step)


class WeakestDirections:
    """Points on lines through a mode along the eigenvectors of its covariance with the largest variance, both ways (CSS
    footnote 10).

    Parameters
    ----------
    body: whose configurations are drawn.
    q (nq,): the mode. covariance (nv, nv): in the tangent space at q, see `CovarianceScaledProposal`.
    directions: how many eigenvectors.
    radii: how far along each, in standard deviations of the direction.
    blur: samples are a random one of the points and this much of the mode's own standard deviations, so that the family
        has a density; `points` are without.

    """

    def __init__(
        self,
        body: Body,
        q: np.ndarray,
        covariance: np.ndarray,
        directions: int = 4,
        radii: Sequence[float] = (2.0, 4.0, 8.0),
        blur: float = 0.5,
    ) -> None:
        self._body = body
        values, vectors = np.linalg.eigh(covariance)
        weakest = [k for k in range(body.nv - 1, -1, -1)[:directions] if values[k] > 0.0]
        axes = [math.sqrt(values[k]) * vectors[:, k] for k in weakest]
        steps = [sign * r * axis for r in radii for axis in axes for sign in (1.0, -1.0)] or [np.zeros(body.nv)]
        self.points = np.array([body.integrate(q, step) for step in steps])
        """The pattern, (P, nq), within the limits: near ones first, the weakest direction first among them."""
        self._about = [CovarianceScaledProposal(body, point, covariance, blur) for point in self.points]

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """See `Proposal`."""
        return self._about[int(rng.integers(len(self._about)))].sample(rng)

    def log_density(self, q: np.ndarray) -> float:
        """See `Proposal`; the tangent space is that at each point of the pattern."""
        return float(np.logaddexp.reduce([p.log_density(q) for p in self._about])) - math.log(len(self._about))
