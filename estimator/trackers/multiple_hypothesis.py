"""The multiple-hypothesis tracker of Cham and Rehg 1999, in the 3D form of CSS section 6.

Modes are carried on at constant velocity; samples are drawn within their covariance, and the same dynamical noise is
added in every direction, however well the image holds it; each sample descends. What CSS changes is the sampling: it
scales the covariance instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.imaging.observation import Observation
from estimator.modes.mixture import Mixture, Mode
from estimator.modes.origin import Family, Origin, PreviousPose
from estimator.search.first_pose import start_modes
from estimator.search.frame_search import FrameCase
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import TrackState, carried, judged, observable
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.single_mode import without_limits


@dataclass(frozen=True)
class MultipleHypothesisSettings:
    """The multiple-hypothesis tracker.

    modes: hypotheses kept, ten in CSS section 6. starts: searches a frame. noise: of the dynamics, as a share of the
    energy's turn_speed, root_turn_speed and root_slide_speed. momentum: share of its velocity that carries a mode on,
    1 for constant velocity. limits: keep to the joint limits; without, every frame but the first may leave them.
    """

    modes: int = 10
    starts: int = 70
    noise: float = 0.3
    momentum: float = 1.0
    limits: bool = True


class MultipleHypothesis:
    """A mode's weight is its parent's times what the posterior has at the mode; keypoints are read as detected."""

    def __init__(self, search: ModeSearch, settings: MultipleHypothesisSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or MultipleHypothesisSettings()
        self._tracking = search if self.settings.limits else without_limits(search)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[TrackState, FrameResult]:
        """See `estimator.trackers.base.Tracker`."""
        return judged(self.search, observation, start_modes(self.search, rng, observation, self.settings.modes))

    def step(
        self, rng: np.random.Generator, state: TrackState, observation: Observation
    ) -> tuple[TrackState, FrameResult]:
        """See `estimator.trackers.base.Tracker`."""
        search, dt = self._tracking, observation.time - state.time
        if not observable(observation):
            return carried(search, state, observation)
        evidence = search.evidence(observation, state.mixture.modes[0].q)
        case = FrameCase(search.associations(observation), dt, evidence)
        found = search.best_modes(self._samples(rng, state.mixture, dt), case, self.settings.modes, rng)
        return judged(search, observation, found)

    def _samples(self, rng: np.random.Generator, prior: Mixture, dt: float) -> list[Hypothesis]:
        """Starts; each pays for the change since its parent, and flow is that of its parent's surface."""
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
