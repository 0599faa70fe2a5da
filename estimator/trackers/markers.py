"""A tracker of markers: a descent or two where they constrain the pose, a search from many starts where they do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.descent.solution import StepCounts
from estimator.inference.mixture import Mixture
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.numerics.newton import ITERATIONS
from estimator.search.first_pose import start_modes
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Candidate, Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.search.proposals import CovarianceScaledProposal
from estimator.trackers.base import Initialisation
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import (
    CarriesMixture,
    MixtureState,
    agreement,
    classify_frame,
    predict_unobserved,
    search_counts,
)
from estimator.trackers.spec import NO_CAPTURE, ONLY_TO_BEGIN, Spec, by_search, together
from humanoid.support.settings import setting

_LEAST = 1e-300  # weight of a parent


@dataclass(frozen=True)
class MarkerTrackerSettings:
    """modes: hypotheses kept, where a frame leaves several. sure: share of a frame's markers that a pose has to explain
    for its descent to be the last; seen: share of the body's markers that have to be there. samples: poses that are
    searched besides where one of them is less, drawn about the best by its covariance times `scale`.
    """

    modes: int = setting(4, at_least=1)
    sure: float = setting(0.75, at_least=0, at_most=1)
    seen: float = setting(0.5, at_least=0, at_most=1)
    samples: int = setting(16, at_least=0)
    scale: float = setting(8.0, above=0)


class MarkerTracker(Initialisation, CarriesMixture):
    """Every hypothesis is searched from its pose predicted by constant velocity. Where that explains too few of the
    markers, or too few are seen, it is also searched from its last pose, and so are samples about the best. Reports its
    `searches` and steps (see `search_counts`)."""

    def __init__(self, search: ModeSearch, settings: MarkerTrackerSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or MarkerTrackerSettings()

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        modes = self.settings.modes
        return classify_frame(self.search, observation, start_modes(self.search, rng, observation, modes))

    def step(
        self, rng: np.random.Generator, state: MixtureState, observation: Observation
    ) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        search, elapsed = self.search, observation.time - state.time
        if not observation.is_observed:
            return predict_unobserved(search, state.mixture, elapsed, observation)
        likelihood = search.likelihood(observation, state.mixture.modes[0].q)
        case = FrameProblem(search.associations(observation), elapsed, likelihood)
        before = search.steps
        starts, others = self._starts(state.mixture, elapsed)
        counts = {Family.KEPT: len(starts), Family.SAMPLE: 0}
        refined = search.refined([_as_it_is(h) for h in starts], case)
        mixture = search.mixture(refined, case, self.settings.modes, rng)
        explained = self._explained(observation, mixture)
        if self._doubtful(observation, mixture, explained):
            more = [*others, *self._samples(rng, mixture)]
            counts = {Family.KEPT: len(starts) + len(others), Family.SAMPLE: len(more) - len(others)}
            explored = search.distinct(search.explored(more, case), self.settings.modes + search.settings.spare)
            refined = [*refined, *search.refined(explored, case)]
            mixture = search.mixture(refined, case, self.settings.modes, rng)
            explained = self._explained(observation, mixture)
        steps = StepCounts.between(before, search.steps)
        return classify_frame(search, observation, mixture, search_counts(counts, steps), explained=explained)

    def _starts(self, prior: Mixture, elapsed: float) -> tuple[list[Hypothesis], list[Hypothesis]]:
        """Each mode where its velocity has taken it, and where it was."""
        moved, were = list[Hypothesis](), list[Hypothesis]()
        for k, mode in enumerate(prior.modes):
            origin, score = Origin(Family.KEPT, PreviousPose(mode.q)), float(np.log(max(prior.weights[k], _LEAST)))
            moved.append(Hypothesis(self.body.integrate(mode.q, elapsed * mode.velocity), 0, origin, k, score))
            were.append(moved[-1]._replace(q=mode.q))
        return moved, were

    def _explained(self, observation: Observation, mixture: Mixture) -> float:
        best = mixture.modes[0]
        return agreement(self.search, observation, best.q, best.association)

    def _doubtful(self, observation: Observation, mixture: Mixture, explained: float) -> bool:
        few = len(observation.known_markers) < self.settings.seen * len(self.body.marker_names)
        return few or mixture.modes[0].status == ITERATIONS or explained < self.settings.sure

    def _samples(self, rng: np.random.Generator, mixture: Mixture) -> list[Hypothesis]:
        """About the best mode."""
        best = mixture.modes[0]
        proposal = CovarianceScaledProposal(self.body, best.q, best.covariance, self.settings.scale**0.5)
        origin = Origin(Family.SAMPLE)
        return [Hypothesis(proposal.sample(rng), 0, origin, best.parent) for _ in range(self.settings.samples)]


def _as_it_is(h: Hypothesis) -> Candidate:
    """A hypothesis that was not searched yet."""
    return Candidate(h, h.q, np.zeros((0, 3)), np.nan)


NAME = "markers"
_CLASPED: dict[str, Any] = {"cost": {"hands_apart": False}}
"""Markers are on both of two hands that hold each other."""
_QUICK: dict[str, Any] = {"search": {"refine": {"decrease_tolerance": 1e-6, "exact_below": 3.0}}}
"""Markers constrain the pose enough for the true curvature to be safe early; a descent that promises less energy has
ended."""
_SHORT_LIVED: dict[str, Any] = {"smooth": {"lasting": 0.05}}
"""Errors of markers are correlated for a shorter time than those of a detector. Errors common to all frames, those of
their places, are added (`estimator.runs.lasting_spread`)."""
_SHARP: dict[str, Any] = {"smooth": {"memory": 0.03, "nu": 16.0}}
"""With a shorter memory of accelerations, and tails that allow these to jump less, forces are nearer to
force plates, and angles to captured ones (`python -m benchmarks forces`, `points`)."""
SPEC = Spec(
    name=NAME,
    sentence="points in space: a descent or two a frame, a search of many where they constrain little",
    make=by_search(MarkerTracker),
    group="markers",
    settings=MarkerTrackerSettings(),
    defaults=together(NO_CAPTURE, _CLASPED, _QUICK, _SHORT_LIVED, _SHARP),
    unused=(ONLY_TO_BEGIN,),
)
