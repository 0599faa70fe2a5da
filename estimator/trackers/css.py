"""Covariance scaled sampling (Sminchisescu and Triggs 2003, section 4.2 and Figure 6)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.filtering.merge import bhattacharyya
from estimator.filtering.mixture import Mixture, mixture_of
from estimator.frame_result import FrameResult
from estimator.imaging.observation import Observation
from estimator.search.flips import only_camera
from estimator.search.mode_search import Hypothesis, ModeSearch
from estimator.search.proposals import CovarianceScaledProposal, LimbProposal
from estimator.start import start_modes
from estimator.trackers.tracker import TrackState, carried, judged, observable


@dataclass(frozen=True)
class CssSettings:
    """The search of each frame.

    modes: hypotheses kept (7 for the body, 3 for the arm in CSS section 6). samples: samples a frame. scale: factor on
    the standard deviations of the proposals, the square root of the s of Figure 6 (4 to 14 there). forgetting: power
    of a parent's weight that is handed on, 1 in Figure 6; less keeps an early mistake from deciding for ever.
    transition: pay for the change since the parent; off in the paper, whose search is static (footnote 5). keep:
    search from the parents' own poses too, in every reading of the keypoints, not from samples alone. flips: hypotheses
    a frame in which one limb jumps to another depth along its rays (one camera only); flip_penalty: energy of a jump,
    paid once instead of the transition's price. momentum: share of its velocity that carries a parent to where pictures
    are looked at too. limb_samples: poses a frame with one limb elsewhere that are looked at where there are pictures,
    the best limb_searches of them are searched from, at the price limb_penalty. exchanges: hypotheses a frame in
    which two limbs change places in the image, at the same price.
    """

    modes: int = 7
    samples: int = 14
    scale: float = 3.0
    forgetting: float = 0.95
    transition: bool = True
    keep: bool = True
    flips: int = 5
    flip_penalty: float = 6.0
    momentum: float = 0.8
    limb_penalty: float = 8.0
    limb_samples: int = 40
    limb_searches: int = 5
    exchanges: int = 4


PAPER = CssSettings(samples=70, flips=0, scale=8.0**0.5, forgetting=1.0, transition=False, keep=False)
"""Figure 6 as printed: samples alone, static energies, parents by Bhattacharyya distance."""


class CovarianceScaledSampling:
    """The recipe: numbers in comments are the steps of Figure 6."""

    def __init__(self, search: ModeSearch, settings: CssSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or CssSettings()
        self._limb_proposal = LimbProposal(self.body)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[TrackState, FrameResult]:
        """See `estimator.trackers.tracker.Tracker`."""
        return judged(self.search, observation, start_modes(self.search, rng, observation, self.settings.modes))

    def step(
        self, rng: np.random.Generator, state: TrackState, observation: Observation
    ) -> tuple[TrackState, FrameResult]:
        """See `estimator.trackers.tracker.Tracker`."""
        if not observable(observation):
            return carried(self.search, state, observation)
        readings = self.search.readings(observation)
        evidence = self.search.evidence(observation, state.mixture.modes[0].q)
        dt = observation.time - state.time
        hypotheses = self._kept(state.mixture, len(readings), dt) if self.settings.keep else []
        hypotheses += self._predicted(state.mixture, dt) if evidence is not None else []
        names = [r.name for r in readings]
        hypotheses += self._samples(rng, state.mixture, names, dt)
        hypotheses += self._flips(rng, state.mixture, names, observation, dt)
        if evidence is not None:
            limbs = self._limbs(rng, state.mixture, names, dt)
            hypotheses += self.search.screened(limbs, readings, self.settings.limb_searches, dt, evidence)
            hypotheses += self._exchanged(rng, state.mixture, names, observation, dt)
        found = self.search.best_modes(hypotheses, readings, self.settings.modes, dt, evidence)  # 2-4
        if not self.settings.transition:
            found = self._matched(state.mixture, found)  # 5, 6; with a transition the parent is known
        return judged(self.search, observation, found)

    def _hypothesis(self, prior: Mixture, i: int, q: np.ndarray, reading: int, dt: float) -> Hypothesis:
        if not self.settings.transition:
            return Hypothesis(q, reading, i)
        m = prior.modes[i]
        predicted = self.body.integrate(m.q, self.settings.momentum * dt * m.velocity)
        return Hypothesis(q, reading, i, self.settings.forgetting * prior.log_scores[i], m.q, predicted)

    def _kept(self, prior: Mixture, readings: int, dt: float) -> list[Hypothesis]:
        return [self._hypothesis(prior, i, m.q, r, dt) for i, m in enumerate(prior.modes) for r in range(readings)]

    def _predicted(self, prior: Mixture, dt: float) -> list[Hypothesis]:
        """Every parent carried on by its velocity: pictures, unlike keypoints, are only looked at near a hypothesis."""
        kept = [self._hypothesis(prior, i, m.q, 0, dt) for i, m in enumerate(prior.modes)]
        return [h._replace(q=h.q_predicted) for h in kept if h.q_predicted is not None]

    def _samples(self, rng: np.random.Generator, prior: Mixture, readings: list[str], dt: float) -> list[Hypothesis]:
        parents = rng.choice(len(prior.modes), size=self.settings.samples, p=prior.weights)  # 2.1
        hypotheses = []
        for i in np.unique(parents):
            mode = prior.modes[i]
            proposal = CovarianceScaledProposal(self.body, mode.q, mode.covariance, self.settings.scale)  # 1
            for _ in range(np.count_nonzero(parents == i)):
                q = proposal.sample(rng)  # 2.2
                hypotheses.append(self._hypothesis(prior, int(i), q, _reading(readings, mode.association), dt))
        return hypotheses

    def _limbs(self, rng: np.random.Generator, prior: Mixture, readings: list[str], dt: float) -> list[Hypothesis]:
        hypotheses = []
        for i in rng.choice(len(prior.modes), size=self.settings.limb_samples, p=prior.weights):
            mode = prior.modes[i]
            q = self._limb_proposal.sample(rng, mode.q)
            h = self._hypothesis(prior, int(i), q, _reading(readings, mode.association), dt)
            hypotheses.append(_jumped(h, self.settings.limb_penalty))
        return hypotheses

    def _exchanged(
        self, rng: np.random.Generator, prior: Mixture, readings: list[str], observation: Observation, dt: float
    ) -> list[Hypothesis]:
        camera = only_camera(observation)
        if camera is None:
            return []
        hypotheses = []
        for i in rng.choice(len(prior.modes), size=self.settings.exchanges, p=prior.weights):
            mode = prior.modes[i]
            q = self.search.flips.exchange(rng, mode.q, camera)
            if q is not None:
                h = self._hypothesis(prior, int(i), q, _reading(readings, mode.association), dt)
                hypotheses.append(_jumped(h, self.settings.limb_penalty))
        return hypotheses

    def _flips(
        self, rng: np.random.Generator, prior: Mixture, readings: list[str], observation: Observation, dt: float
    ) -> list[Hypothesis]:
        camera = only_camera(observation)
        if camera is None or self.settings.flips == 0 or not self.search.flips.limbs:
            return []
        hypotheses = []
        for i in rng.choice(len(prior.modes), size=self.settings.flips, p=prior.weights):
            mode = prior.modes[i]
            q = self.search.flips.draw(rng, mode.q, camera)
            if q is not None:
                h = self._hypothesis(prior, int(i), q, _reading(readings, mode.association), dt)
                hypotheses.append(_jumped(h, self.settings.flip_penalty))
        return hypotheses

    def _matched(self, prior: Mixture, found: Mixture) -> Mixture:
        """Multiply each new mode's weight with that of the closest prior mode, which is then used up (5)."""
        left = list(range(len(prior.modes)))
        modes, scores = [], []
        for mode, score in zip(found.modes, found.log_scores, strict=True):
            parent = -1
            if left:
                distances = [
                    bhattacharyya(self.body, prior.modes[i].q, prior.modes[i].covariance, mode.q, mode.covariance)
                    for i in left
                ]
                parent = left.pop(int(np.argmin(distances)))
            modes.append(replace(mode, parent=parent))
            handed_on = prior.log_scores[parent] if parent >= 0 else prior.log_scores.min()
            scores.append(score + self.settings.forgetting * handed_on)
        return mixture_of(tuple(modes), np.array(scores))  # 6


def _reading(readings: list[str], association: str) -> int:
    """Place of a parent's reading; the first where the frame has no such reading."""
    return readings.index(association) if association in readings else 0


def _jumped(h: Hypothesis, penalty: float) -> Hypothesis:
    """A hypothesis whose parent was wrong too: it pays a flat price instead of the transition's, and no flow leads to
    it from where the parent was."""
    if h.q_previous is None:
        return h
    return h._replace(prior_score=h.prior_score - penalty, q_previous=h.q, q_predicted=None)
