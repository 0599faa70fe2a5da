"""Checks of what a new term, cue or tracker promises, for its tests, as scikit-learn has them for estimators.

Each raises `ContractError`, an AssertionError, at the first promise that is broken, and names it, with numbers.
"""

from kinemode.testing.calibration import RankStatistics, SimulatedClip, check_calibration, simulated_clips
from kinemode.testing.cues import check_cue
from kinemode.testing.laws import ContractError, slope
from kinemode.testing.terms import check_term
from kinemode.testing.trackers import check_tracker

__all__ = [
    "ContractError", "RankStatistics", "SimulatedClip", "check_calibration", "check_cue", "check_term", "check_tracker",
    "simulated_clips", "slope",
]  # fmt: skip
