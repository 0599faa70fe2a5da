"""Hypotheses, and what becomes of them: a start, after a short search, after a search to convergence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimator.energy.descent.solution import StepCounts
from estimator.energy.reprojection import Reprojection
from estimator.inference.mixture import Mode
from estimator.inference.origin import Family, Origin

_START = Origin(Family.START)


class Hypothesis(NamedTuple):
    """Start of a search.

    q (nq,): configuration. association: index of the frame's association that it is searched under (see
    `FrameProblem`). origin: what kind it is: where it comes from, where it has the body in the frame before, from where
    flow is followed, and its penalty. parent: index of the mode that it comes from, -1 for none. prior_score:
    log-weight passed on by the parent, less a flat penalty. moves_along: whether q is about the pose in the frame
    before, and goes with what keypoints and flow make of that pose; a proposal that has a motion of its own does not.
    pull: index of the pull of its limbs, -1 for none (see `FrameProblem`).
    """

    q: np.ndarray
    association: int
    origin: Origin = _START
    parent: int = -1
    prior_score: float = 0.0
    relative_to_previous: bool = False
    pull: int = -1


class Candidate(NamedTuple):
    """A hypothesis after a short search: configuration (nq,), landmarks (L, 3) [m], energy with the penalty of its
    association. steps: of all that was searched to come here."""

    hypothesis: Hypothesis
    q: np.ndarray
    landmarks: np.ndarray
    energy: float
    steps: StepCounts = StepCounts()

    @property
    def score(self) -> float:
        """Log-weight by the energy's height alone, with what the parent hands on, up to a constant."""
        return self.hypothesis.prior_score - self.energy


class Refined(NamedTuple):
    """A hypothesis searched to convergence. landmarks (L, 3) [m]: the mode's. q_assigned (nq,): the pose at which the
    pictures' features were assigned last. steps: of all that was searched since it was a `Candidate`."""

    hypothesis: Hypothesis
    mode: Mode
    landmarks: np.ndarray
    q_assigned: np.ndarray
    steps: StepCounts = StepCounts()

    @property
    def q(self) -> np.ndarray:
        """The mode's configuration (nq,)."""
        return self.mode.q

    @property
    def score(self) -> float:
        """See `Candidate.score`."""
        return self.hypothesis.prior_score - self.mode.energy


AS_DETECTED, EXCHANGED = "as_detected", "exchanged"


class Association(NamedTuple):
    """One data association of a frame's keypoints with landmarks.

    name: `AS_DETECTED`, or `EXCHANGED` (left and right). term: the keypoints' energy under it. penalty: the energy that
    choosing it costs.
    """

    name: str
    term: Reprojection
    penalty: float
