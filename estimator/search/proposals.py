"""Where to look for modes: covariance-scaled samples."""

from __future__ import annotations

import numpy as np

from humanoid.body import Body


def covariance_scaled_sample(
    rng: np.random.Generator, body: Body, q: np.ndarray, covariance: np.ndarray, scale: float
) -> np.ndarray:
    """One sample (nq,) of N(q, scale^2 covariance) on the manifold, clamped into the limits (CSS Figure 6, step 2.2).

    `scale` multiplies standard deviations; the s of CSS Figure 6, which multiplies the covariance, is scale^2.
    """
    values, vectors = np.linalg.eigh(covariance)
    v = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(body.nv))
    return body.integrate(q, scale * v)
