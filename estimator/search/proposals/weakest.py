"""Regular starts along the few directions that the image constrains least."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator.search.proposals.elliptical import CovarianceScaledProposal
from humanoid.kinematics.body import Body


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
        """See `estimator.search.proposals.Proposal`."""
        return self._about[int(rng.integers(len(self._about)))].sample(rng)

    def log_density(self, q: np.ndarray) -> float:
        """See `estimator.search.proposals.Proposal`; the tangent space is that at each point of the pattern."""
        return float(np.logaddexp.reduce([p.log_density(q) for p in self._about])) - math.log(len(self._about))
