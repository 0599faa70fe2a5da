"""Proposals for modes: distributions of starts about a known one.

The family's contract is `Proposal`. `LimbProposal` is the exception: it moves a few joints of any configuration and has
no density over all of them.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from estimator.search.proposals.elliptical import (
    HELD_STD,
    CovarianceScaledProposal,
    SphericalProposal,
    log_density_at_centre,
)
from estimator.search.proposals.limb import LimbProposal
from estimator.search.proposals.weakest import WeakestDirections

__all__ = [
    "HELD_STD",
    "CovarianceScaledProposal",
    "LimbProposal",
    "Proposal",
    "SphericalProposal",
    "WeakestDirections",
    "log_density_at_centre",
]


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
