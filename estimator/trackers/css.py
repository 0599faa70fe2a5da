"""Covariance scaled sampling (Sminchisescu and Triggs 2003, section 4.2 and Figure 6)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from estimator.filtering.merge import bhattacharyya
from estimator.filtering.mixture import Mixture, mixture_of
from estimator.frame_result import FrameResult
from estimator.imaging.camera import Camera
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


class _Parents(NamedTuple):
    """What a frame's hypotheses come from.

    prior: the mixture of the frame before. readings: how many this frame has. own (K): the reading that continues each
    mode's. predicted (K): where each mode's velocity takes it, None where that is not asked for.
    """

    prior: Mixture
    readings: int
    own: list[int]
    predicted: Sequence[np.ndarray | None]


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
        parents = self._parents(state.mixture, [r.name for r in readings], dt if evidence is not None else None)
        hypotheses = self._kept(parents) if self.settings.keep else []
        hypotheses += self._carried_on(parents)
        hypotheses += self._samples(rng, parents)
        camera = only_camera(observation)
        hypotheses += self._flips(rng, parents, camera)
        if evidence is not None:
            limbs = self._limbs(rng, parents)
            hypotheses += self.search.screened(limbs, readings, self.settings.limb_searches, dt, evidence)
            hypotheses += self._exchanged(rng, parents, camera)
        found = self.search.best_modes(hypotheses, readings, self.settings.modes, dt, evidence)  # 2-4
        if not self.settings.transition:
            found = self._matched(state.mixture, found)  # 5, 6; with a transition the parent is known
        return judged(self.search, observation, found)

    def _parents(self, prior: Mixture, readings: list[str], dt: float | None) -> _Parents:
        """`dt`: seconds since the parents; None where no pictures are looked at, and no prediction is needed."""
        # the first reading where the frame has not that of the parent
        own = [readings.index(m.association) if m.association in readings else 0 for m in prior.modes]
        if dt is None or not self.settings.transition:
            return _Parents(prior, len(readings), own, [None] * len(own))
        step = self.settings.momentum * dt
        return _Parents(prior, len(readings), own, [self.body.integrate(m.q, step * m.velocity) for m in prior.modes])

    def _hypothesis(self, parents: _Parents, i: int, q: np.ndarray, reading: int) -> Hypothesis:
        if not self.settings.transition:
            return Hypothesis(q, reading, i)
        score = self.settings.forgetting * parents.prior.log_scores[i]
        return Hypothesis(q, reading, i, score, parents.prior.modes[i].q, parents.predicted[i])

    def _kept(self, parents: _Parents) -> list[Hypothesis]:
        modes = enumerate(parents.prior.modes)
        return [self._hypothesis(parents, i, m.q, r) for i, m in modes for r in range(parents.readings)]

    def _carried_on(self, parents: _Parents) -> list[Hypothesis]:
        """Every parent carried on by its velocity: pictures, unlike keypoints, are only looked at near a hypothesis."""
        return [self._hypothesis(parents, i, q, 0) for i, q in enumerate(parents.predicted) if q is not None]

    def _samples(self, rng: np.random.Generator, parents: _Parents) -> list[Hypothesis]:
        prior = parents.prior
        drawn = rng.choice(len(prior.modes), size=self.settings.samples, p=prior.weights)  # 2.1
        hypotheses = []
        for i in np.unique(drawn):
            mode = prior.modes[i]
            proposal = CovarianceScaledProposal(self.body, mode.q, mode.covariance, self.settings.scale)  # 1
            for _ in range(np.count_nonzero(drawn == i)):
                hypotheses.append(self._hypothesis(parents, int(i), proposal.sample(rng), parents.own[i]))  # 2.2
        return hypotheses

    def _limbs(self, rng: np.random.Generator, parents: _Parents) -> list[Hypothesis]:
        propose = partial(self._limb_proposal.sample, rng)
        return self._jumps(rng, parents, self.settings.limb_samples, self.settings.limb_penalty, propose)

    def _exchanged(self, rng: np.random.Generator, parents: _Parents, camera: Camera | None) -> list[Hypothesis]:
        if camera is None:
            return []
        propose = partial(self.search.flips.exchange, rng, camera=camera)
        return self._jumps(rng, parents, self.settings.exchanges, self.settings.limb_penalty, propose)

    def _flips(self, rng: np.random.Generator, parents: _Parents, camera: Camera | None) -> list[Hypothesis]:
        if camera is None or self.settings.flips == 0 or not self.search.flips.limbs:
            return []
        propose = partial(self.search.flips.draw, rng, camera=camera)
        return self._jumps(rng, parents, self.settings.flips, self.settings.flip_penalty, propose)

    def _jumps(
        self,
        rng: np.random.Generator,
        parents: _Parents,
        count: int,
        penalty: float,
        propose: Callable[[np.ndarray], np.ndarray | None],
    ) -> list[Hypothesis]:
        """Hypotheses whose parents were wrong too: they pay a flat price instead of the transition's, and no flow leads
        to them from where the parent was."""
        prior, hypotheses = parents.prior, []
        for i in rng.choice(len(prior.modes), size=count, p=prior.weights):
            q = propose(prior.modes[i].q)
            if q is None:
                continue
            h = self._hypothesis(parents, int(i), q, parents.own[i])
            if h.q_previous is not None:
                h = h._replace(prior_score=h.prior_score - penalty, q_previous=q, q_predicted=None)
            hypotheses.append(h)
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
