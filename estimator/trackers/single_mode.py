"""Robust single-mode tracker with limits (Sminchisescu and Triggs 2003, section 6): descent from the last pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.frame_result import FrameResult
from estimator.imaging.observation import Observation
from estimator.search.mode_search import Hypothesis, ModeSearch
from estimator.start import start_modes
from estimator.trackers.tracker import TrackState, carried, judged, observable


@dataclass(frozen=True)
class SingleModeSettings:
    """transition: pay for the change since the last frame."""

    transition: bool = True


class SingleMode:
    """One hypothesis, searched from its pose in the last frame, keypoints read as detected."""

    def __init__(self, search: ModeSearch, settings: SingleModeSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or SingleModeSettings()

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[TrackState, FrameResult]:
        """See `estimator.trackers.tracker.Tracker`."""
        return judged(self.search, observation, start_modes(self.search, rng, observation, 1))

    def step(
        self, rng: np.random.Generator, state: TrackState, observation: Observation
    ) -> tuple[TrackState, FrameResult]:
        """See `estimator.trackers.tracker.Tracker`."""
        if not observable(observation):
            return carried(self.search, state, observation)
        q = state.mixture.modes[0].q
        hypothesis = Hypothesis(q, 0, 0, 0.0, q if self.settings.transition else None)
        readings = self.search.readings(observation)
        evidence = self.search.evidence(observation, q)
        found = self.search.best_modes([hypothesis], readings, 1, observation.time - state.time, evidence)
        return judged(self.search, observation, found)
