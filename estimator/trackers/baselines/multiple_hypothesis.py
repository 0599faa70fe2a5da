"""The multiple-hypothesis tracker of Cham and Rehg 1999, in the 3D form of CSS section 6.

Modes are predicted at constant velocity; samples are drawn within their covariance, and the same dynamical noise is
added in every direction, however well the image constrains it; each sample descends. What CSS changes is the sampling:
it scales the covariance instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.descent.solution import StepCounts
from estimator.inference.mixture import Mixture, Mode
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.first_pose import start_modes
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import Initialisation
from estimator.trackers.baselines.single_mode import without_limits
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import (
    CarriesMixture,
    MixtureState,
    classify_frame,
    predict_unobserved,
    search_counts,
)
from estimator.trackers.spec import FROM_A_PAPER, LEAST_SQUARES, ONLY_TO_BEGIN, OVERLAPPING, Spec, by_search, together
from humanoid.support.settings import setting, unused_where


@dataclass(frozen=True)
class MultipleHypothesisSettings:
    """The multiple-hypothesis tracker.

    modes: hypotheses kept, ten in CSS section 6. starts: searches a frame. noise: of the dynamics, as a share of the
    energy's turn_speed, root_turn_speed and root_slide_speed. momentum: share of its velocity that carries a mode on,
    1 for constant velocity. limits: keep to the joint limits; without, every frame but the first may leave them.
    """

    modes: int = setting(10, at_least=1)
    starts: int = setting(70, at_least=1)
    noise: float = setting(0.3, above=0)
    momentum: float = setting(1.0, at_least=0)
    limits: bool = True


class MultipleHypothesis(Initialisation, CarriesMixture):
    """A mode's weight is its parent's times the posterior at the mode. Keypoints are read as detected.

    For every searched frame but the first it reports `searches`, `searches_sample` and steps (see `search_counts`).
    """

    def __init__(self, search: ModeSearch, settings: MultipleHypothesisSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or MultipleHypothesisSettings()
        self._tracking = search if self.settings.limits else without_limits(search)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return classify_frame(self.search, observation, start_modes(self.search, rng, observation, self.settings.modes))

    def step(
        self, rng: np.random.Generator, state: MixtureState, observation: Observation
    ) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        search, dt = self._tracking, observation.time - state.time
        if not observation.is_observed:
            return predict_unobserved(search, state.mixture, dt, observation)
        likelihood = search.likelihood(observation, state.mixture.modes[0].q)
        case = FrameProblem(search.associations(observation), dt, likelihood)
        before = search.steps
        mixture = search.best_modes(self._samples(rng, state.mixture, dt), case, self.settings.modes, rng)
        steps = StepCounts.between(before, search.steps)
        return classify_frame(search, observation, mixture, search_counts({Family.SAMPLE: self.settings.starts}, steps))

    def _samples(self, rng: np.random.Generator, prior: Mixture, dt: float) -> list[Hypothesis]:
        """Starts; each has the penalty of the change since its parent, and flow is that of its parent's surface."""
        drawn = np.sort(rng.choice(len(prior.modes), size=self.settings.starts, p=prior.weights))
        factors = {int(k): self._factor(prior.modes[k], dt) for k in np.unique(drawn)}
        return [self._sample(rng, prior, int(k), factors[int(k)], dt) for k in drawn]

    def _factor(self, mode: Mode, dt: float) -> np.ndarray:
        """Factor (nv, nv) of the predicted covariance: the mode's and the noise's."""
        noise = self.settings.noise * self._tracking.model.transition_std(dt)
        return np.linalg.cholesky(mode.covariance + np.diag(np.square(noise)))

    def _sample(self, rng: np.random.Generator, prior: Mixture, k: int, factor: np.ndarray, dt: float) -> Hypothesis:
        mode, body = prior.modes[k], self._tracking.body
        step = self.settings.momentum * dt * mode.velocity + factor @ rng.standard_normal(body.nv)
        origin = Origin(Family.SAMPLE, PreviousPose(mode.q))
        return Hypothesis(body.integrate(mode.q, step), 0, origin, k, prior.log_scores[k])


def _within_limits(own: MultipleHypothesisSettings) -> bool:
    """Poses stay there; and there alone the work is shared, since the other processes have the body with its limits."""
    return own.limits


def _spec(name: str, sentence: str, settings: MultipleHypothesisSettings, defaults: Mapping[str, Any]) -> Spec:
    return Spec(
        name=name,
        sentence=sentence,
        make=by_search(MultipleHypothesis),
        group="multiple_hypothesis",
        settings=settings,
        defaults=defaults,
        unused=(ONLY_TO_BEGIN, unused_where("search.follow", "no search begins where its parent was")),
        keeps_limits=_within_limits,
    )


SPECS = (
    _spec(
        "multiple-hypothesis",
        "multiple hypotheses, robust, with constraints (Cham and Rehg 1999, CSS section 6)",
        MultipleHypothesisSettings(),
        FROM_A_PAPER,
    ),
    _spec(
        "gaussian-multiple-hypothesis",
        "the same with Gaussian potentials and no physical constraints",
        MultipleHypothesisSettings(limits=False),
        together(FROM_A_PAPER, LEAST_SQUARES, OVERLAPPING),
    ),
)
