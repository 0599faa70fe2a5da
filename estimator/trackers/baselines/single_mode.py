"""Single-mode trackers (Sminchisescu and Triggs 2003, section 6): descent from the last pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.descent.solution import StepCounts
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.cost_model import CostModel
from estimator.search.first_pose import start_modes
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import Initialisation
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import (
    CarriesMixture,
    MixtureState,
    classify_frame,
    predict_unobserved,
    search_counts,
)
from estimator.trackers.spec import (
    AS_DETECTED,
    LEAST_SQUARES,
    NO_CAPTURE,
    ONLY_FILTERS,
    ONLY_TO_BEGIN,
    OVERLAPPING,
    Spec,
    by_search,
    together,
)
from humanoid.kinematics.body import Body
from humanoid.support.settings import unused_where


@dataclass(frozen=True)
class SingleModeSettings:
    """transition: penalise the change since the last frame. limits: keep to the joint limits; without, every frame but
    the first, where all trackers start alike, may leave them.
    """

    transition: bool = True
    limits: bool = True


class SingleMode(Initialisation, CarriesMixture):
    """One hypothesis, searched from its pose in the last frame. Keypoints are read as detected. It reports its
    `searches` and steps (see `search_counts`)."""

    def __init__(self, search: ModeSearch, settings: SingleModeSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or SingleModeSettings()
        self._tracking = search if self.settings.limits else without_limits(search)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return classify_frame(self.search, observation, start_modes(self.search, rng, observation, 1))

    def step(
        self, rng: np.random.Generator, state: MixtureState, observation: Observation
    ) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        search = self._tracking
        if not observation.is_observed:
            return predict_unobserved(search, state.mixture, observation.time - state.time, observation)
        q = state.mixture.modes[0].q
        origin = Origin(Family.KEPT, PreviousPose(q) if self.settings.transition else None)
        associations, likelihood = search.associations(observation), search.likelihood(observation, q)
        case = FrameProblem(associations, observation.time - state.time, likelihood)
        before = search.steps
        best = search.best_modes([Hypothesis(q, 0, origin, 0)], case, 1)
        steps = StepCounts.between(before, search.steps)
        return classify_frame(search, observation, best, search_counts({Family.KEPT: 1}, steps))


def without_limits(search: ModeSearch) -> ModeSearch:
    """The same search over a body without joint limits: its modes, and the results made of them, may leave them."""
    model = search.model
    return ModeSearch(
        CostModel(unlimited(search.body), model.settings, model.self_collision, model.cues), search.settings
    )


_UNUSED = (
    ONLY_TO_BEGIN,
    unused_where("search.weigh search.weigh_samples", "a single mode has all the weight"),
)


def _spec(name: str, sentence: str, settings: SingleModeSettings, defaults: Mapping[str, Any]) -> Spec:
    return Spec(
        name=name,
        sentence=sentence,
        make=by_search(SingleMode),
        group="single_mode",
        settings=settings,
        defaults=together(ONLY_FILTERS, NO_CAPTURE, defaults),
        unused=_UNUSED,
        keeps_limits=lambda own: own.limits,
    )


SPECS = (
    _spec(
        "gaussian-single-mode",
        "single mode, Gaussian potentials, no physical constraints (CSS section 6)",
        SingleModeSettings(limits=False),
        together(AS_DETECTED, LEAST_SQUARES, OVERLAPPING),
    ),
    _spec(
        "robust-single-mode",
        "robust single mode, no physical constraints (CSS section 6)",
        SingleModeSettings(limits=False),
        together(AS_DETECTED, OVERLAPPING),
    ),
    _spec("single-mode", "robust single mode with joint limits (CSS section 6)", SingleModeSettings(), {}),
)


def unlimited(body: Body) -> Body:
    """The same body without joint limits: for trackers that are to show what the limits are worth (CSS section 6).

    Kinematics, landmarks, stabilisers and rest pose are the same; `lower` and `upper` are infinite, `bounded_v` and
    `bounded_q` empty, so that `clamp` and `integrate` hold nothing back.
    """
    model = body.model.copy()
    model.lowerPositionLimit = np.full(body.nq, -np.inf)
    model.upperPositionLimit = np.full(body.nq, np.inf)
    return Body(body.subject, model)
