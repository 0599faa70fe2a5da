"""Where to look for modes: covariance-scaled samples."""

from __future__ import annotations

import numpy as np

from humanoid.body import Body


class CovarianceScaledProposal:
    """N(q, scale^2 covariance) on the manifold, clamped into the limits (CSS Figure 6, steps 1 and 2.2).

    q (nq,), covariance (nv, nv). `scale` multiplies standard deviations; the s of CSS Figure 6, which multiplies the
    covariance, is scale^2.
    """

    def __init__(self, body: Body, q: np.ndarray, covariance: np.ndarray, scale: float) -> None:
        self._body, self._q = body, q
        # directions held by active limits have no variance; a hair of it makes the matrix one that factors
        self._factor = scale * np.linalg.cholesky(covariance + 1e-12 * np.eye(body.nv))

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """One configuration (nq,)."""
        return self._body.integrate(self._q, self._factor @ rng.standard_normal(self._body.nv))
