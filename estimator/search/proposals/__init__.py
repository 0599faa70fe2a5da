"""Where to look for modes: distributions of starts about a known one.

The family's contract is `Proposal`. `LimbProposal` is the exception: it moves a few joints of any configuration and has
no density over all of them.
"""

from estimator.search.proposals.contract import Proposal
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
