"""Covariance scaled sampling (Sminchisescu and Triggs 2003, section 4.2 and Figure 6)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.descent.solution import StepCounts
from estimator.inference.mixture import Mixture, bhattacharyya, mixture_of
from estimator.inference.origin import Family
from estimator.search.cost_model import detected_share
from estimator.search.examples.person_seen import can_look_up
from estimator.search.first_pose import start_modes
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Candidate
from estimator.search.mode_search import ModeSearch
from estimator.search.proposals import LimbProposal
from estimator.trackers.base import Initialisation
from estimator.trackers.css.frame_proposals import Proposals
from estimator.trackers.css.settings import PAPER, REFINE_ALL, UNUSED, CssSettings, Source, allocated
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import (
    ENOUGH,
    CarriesMixture,
    MixtureState,
    agreement,
    classify_frame,
    predict_unobserved,
    search_counts,
)
from estimator.trackers.spec import FROM_A_PAPER, Spec, by_search

_OTHERS = (Family.START, Family.EXAMPLE, Family.LIMBS, Family.PARTICLES)
_FAMILIES = tuple(family for family in Family if family not in _OTHERS)


class CovarianceScaledSampling(Initialisation, CarriesMixture):
    """The recipe: numbers in comments are the steps of Figure 6.

    For every searched frame but the first it reports `searches`, `searches_FAMILY` and steps (see `search_counts`).
    """

    def __init__(self, search: ModeSearch, settings: CssSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or CssSettings()
        self._limb_proposal = LimbProposal(self.body)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        if self.search.settings.index:
            self.search.examples.check(observation)  # now, not when the person is lost
        return classify_frame(self.search, observation, start_modes(self.search, rng, observation, self.settings.modes))

    def step(
        self, rng: np.random.Generator, state: MixtureState, observation: Observation
    ) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        elapsed, by_index = observation.time - state.time, bool(self.search.settings.index)
        if not observation.is_observed:
            after, result = predict_unobserved(self.search, state.mixture, elapsed, observation)
            return replace(after, unseen=state.unseen + elapsed if by_index else 0.0), result
        prior = state.mixture
        likelihood = self.search.likelihood(observation, prior.modes[0].q)
        associations = self.search.associations(observation, prior.modes[0].q)
        case = FrameProblem(associations, elapsed + state.unseen, likelihood)
        proposals = Proposals(self.search, self._limb_proposal, self.settings.proposals, rng, prior, case, observation)
        before = self.search.steps
        candidates = self.search.explored(proposals.parent_poses(), case) if self.settings.keep else []
        looks_up = by_index and can_look_up(observation, self.search.evidence)
        lost = looks_up and (state.unseen > 0.0 or self._lost(candidates, case, observation))
        doubt = 1.0 if lost else 1.0 - float(prior.weights[0])
        left = self.settings.budget.left(len(candidates), _rise(candidates, prior), doubt)
        sources = self._sources(proposals, observation)
        if looks_up:
            share = self.settings.lost_examples if lost else self.settings.examples
            sources.insert(0, Source(share, proposals.examples))
        candidates += self.search.explored(allocated(left, sources), case)  # 1, 2
        every = self.settings.refine == REFINE_ALL
        mixture = self.search.best_of(candidates, case, self.settings.modes, rng, every=every)  # 3, 4
        if not self.settings.transition:
            mixture = self._matched(prior, mixture)  # 5, 6; with a transition the parent is known
        diagnostics = self._searches(candidates, StepCounts.between(before, self.search.steps))
        return classify_frame(self.search, observation, mixture, diagnostics)

    def _sources(self, proposals: Proposals, observation: Observation) -> list[Source]:
        s = self.settings
        seen = detected_share(observation)
        lost = 1.0 - 0.75 * seen if observation.cues else 0.0
        return [
            Source(s.swapped_readings, proposals.other_associations),
            Source(s.jumps, proposals.kinematic_jumps),
            Source(lost * s.limb_searches, partial(proposals.limbs, looks=round(lost * s.limb_samples))),
            Source(lost * s.exchanges, proposals.limb_exchanges),
            Source(s.samples, proposals.samples),
        ]

    def _lost(self, candidates: Sequence[Candidate], case: FrameProblem, observation: Observation) -> bool:
        """Whether the best of the parents' continuations explains too little of what is seen."""
        if not candidates:
            return False
        best = max(candidates, key=lambda c: c.score)
        name = case.associations[best.hypothesis.association].name
        return agreement(self.search, observation, best.q, name) < ENOUGH

    def _searches(self, candidates: Sequence[Candidate], steps: StepCounts) -> dict[str, np.ndarray]:
        counted = Counter(c.hypothesis.origin.family for c in candidates)
        families = (*_FAMILIES, *([Family.EXAMPLE] if self.search.settings.index else []))
        return search_counts({family: counted[family] for family in families}, steps)

    def _matched(self, prior: Mixture, posterior: Mixture) -> Mixture:
        """Multiply each new mode's weight with that of the closest prior mode, which is then used up (5)."""
        left = list(range(len(prior.modes)))
        modes, scores = [], []
        for mode, score in zip(posterior.modes, posterior.log_scores, strict=True):
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


def _rise(candidates: Sequence[Candidate], prior: Mixture) -> float:
    """Rise of the energy from the parent in the frame before to its best continuation in this frame."""
    if not candidates:
        return 0.0
    best = max(candidates, key=lambda c: c.score)
    return best.energy - prior.modes[best.hypothesis.parent].energy


def _spec(name: str, sentence: str, settings: CssSettings, defaults: Mapping[str, Any]) -> Spec:
    return Spec(
        name=name,
        sentence=sentence,
        make=by_search(CovarianceScaledSampling),
        group="css",
        settings=settings,
        defaults=defaults,
        unused=UNUSED,
        may_look_up=lambda own: own.examples > 0 or own.lost_examples > 0,
    )


SPECS = (
    _spec("css", "covariance scaled sampling with transitions and exchanged readings", CssSettings(), {}),
    _spec("css-paper", "covariance scaled sampling as printed (CSS Figure 6)", PAPER, FROM_A_PAPER),
    _spec(
        "spherical",
        "the same with spherical samples of equal volume (CSS section 7)",
        replace(PAPER, shape="spherical"),
        FROM_A_PAPER,
    ),
)
