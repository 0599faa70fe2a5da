"""Covariance scaled sampling (Sminchisescu and Triggs 2003, section 4.2 and Figure 6)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.descent.solution import StepCounts
from estimator.inference.merge import bhattacharyya
from estimator.inference.mixture import Mixture, mixture_of
from estimator.inference.origin import Family
from estimator.search.cost_model import ALL_DETECTED
from estimator.search.examples.person_seen import can_be_looked_up
from estimator.search.first_pose import start_modes
from estimator.search.frame_search import FrameCase
from estimator.search.hypothesis import Candidate
from estimator.search.mode_search import ModeSearch
from estimator.search.proposals import LimbProposal
from estimator.search.search_pool import search_pool
from estimator.search.settings import BY_KEYPOINTS
from estimator.trackers.beginning import Begins, observable
from estimator.trackers.css.budget import BudgetSettings, Source, allocated
from estimator.trackers.css.frame_proposals import SHAPES, Proposals, ProposalSettings
from estimator.trackers.defaults import FROM_A_PAPER
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import (
    ENOUGH,
    CarriesMixture,
    MixtureState,
    agreement,
    carried,
    judged,
    searches_told,
)
from estimator.trackers.spec import Spec, by_search
from humanoid.support.idle import ONE_CAMERA, PICTURES, idle_where, idle_without
from humanoid.support.settings import check, setting

REFINE_BEST, REFINE_ALL = REFINED = ("best", "all")


@dataclass(frozen=True)
class CssSettings:
    """The search of each frame.

    modes: hypotheses kept (7 for the body, 3 for the arm in CSS section 6). forgetting: power of a parent's weight that
    is handed on, 1 in Figure 6; less, as the same clutter misleads frame after frame, which are not independent.
    transition: penalise the change since the parent; off in the paper, whose search is static (footnote 5). keep:
    search from the parents' own poses too, not from samples alone. momentum: share of its velocity that carries a
    parent to where pictures are looked at too (constant velocity beside driftless dynamics). refine: which searches
    are led to convergence, "all" as printed (Figure 6, step 2.3), or the "best" of those that differ after a short
    search.

    budget: how many searches a frame gets. What the parents leave of it is shared in proportion to:
    samples: about the parents. shape: of their distribution, "covariance" (CSS), "spherical" (of equal volume, the
        rival of CSS section 7) or "weakest" (regular, along the weakest directions, footnote 10). scale: factor on the
        standard deviations, the square root of the s of Figure 6 (4 to 14 there). tail: degrees of freedom of Student's
        t, 0 for a Gaussian.
    other_readings: parents with left and right of the keypoints exchanged.
    jumps: kinematic jumps, a limb or part at another depth along its rays (one camera only). jump_penalty: energy of
        a jump, added once instead of the transition's: flow is followed from where the jump says that the limb was, so
        it does not tell the two depths apart in one frame, and cheap jumps would go to and fro.
    limb_searches: one limb elsewhere, where there are pictures, the best of limb_samples poses looked at, with the
        penalty limb_penalty. exchanges: two limbs change places in the image, with the same penalty. These find limbs
        that have lost their image, so keypoints of the whole person make a quarter of them enough.
    examples: modes reached from examples that look like the picture, where an index is given (`search.index`), with the
        penalty example_penalty. lost_examples: instead, where nothing was seen in the frame before, or the parents' own
        continuations explain less than half of what is seen; then the whole budget is spent. Besides, with an index
        the change that is penalised is that since the person was last seen, not since the frame before.
    """

    modes: int = setting(7, at_least=1)
    budget: BudgetSettings = field(default_factory=BudgetSettings)
    samples: int = setting(14, at_least=0)
    shape: str = setting("covariance", one_of=SHAPES)
    scale: float = setting(3.0, above=0)
    tail: float = setting(0.0, at_least=0)
    forgetting: float = setting(0.8, at_least=0)
    transition: bool = True
    keep: bool = True
    momentum: float = setting(0.8, at_least=0)
    refine: str = setting(REFINE_BEST, one_of=REFINED)
    other_readings: int = setting(7, at_least=0)
    jumps: int = setting(5, at_least=0, formerly=("flips",))
    jump_penalty: float = setting(12.0, at_least=0, formerly=("flip_penalty",))
    limb_penalty: float = setting(8.0, above=0)
    limb_samples: int = setting(40, at_least=0)
    limb_searches: int = setting(5, at_least=0)
    exchanges: int = setting(4, at_least=0)
    examples: int = setting(4, at_least=0)
    lost_examples: int = setting(20, at_least=0)
    example_penalty: float = setting(12.0, at_least=0)

    def __post_init__(self) -> None:
        check(self)

    @property
    def proposals(self) -> ProposalSettings:
        """Those of them that decide where hypotheses are."""
        return ProposalSettings(**{name: getattr(self, name) for name in ProposalSettings._fields})


PAPER = CssSettings(
    budget=BudgetSettings(searches=70, calm=1.0), samples=70, other_readings=0, jumps=0, limb_searches=0, exchanges=0,
    examples=0, lost_examples=0, scale=8.0**0.5, forgetting=1.0, transition=False, keep=False, refine=REFINE_ALL,
)  # fmt: skip
"""Figure 6 as printed: samples alone, static energies, parents by Bhattacharyya distance."""


_OTHERS = (Family.START, Family.EXAMPLE, Family.LIMBS, Family.PARTICLES)
_FAMILIES = tuple(family for family in Family if family not in _OTHERS)


class CovarianceScaledSampling(Begins, CarriesMixture):
    """The recipe: numbers in comments are the steps of Figure 6.

    Of every searched frame but the first it tells `searches`, `searches_FAMILY` and steps (see `searches_told`).
    """

    def __init__(self, search: ModeSearch, settings: CssSettings | None = None) -> None:
        self.search = search
        self.body = search.body
        self.settings = settings or CssSettings()
        self._limb_proposal = LimbProposal(self.body)

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.Tracker`."""
        if self.search.settings.index:
            self.search.examples.check(observation)  # now, not when the person is lost
        return judged(self.search, observation, start_modes(self.search, rng, observation, self.settings.modes))

    def step(
        self, rng: np.random.Generator, state: MixtureState, observation: Observation
    ) -> tuple[MixtureState, FrameResult]:
        """See `estimator.trackers.base.Tracker`."""
        elapsed, by_index = observation.time - state.time, bool(self.search.settings.index)
        if not observable(observation):
            after, result = carried(self.search, state.mixture, elapsed, observation)
            return replace(after, unseen=state.unseen + elapsed if by_index else 0.0), result
        prior = state.mixture
        likelihood = self.search.likelihood(observation, prior.modes[0].q)
        case = FrameCase(self.search.associations(observation), elapsed + state.unseen, likelihood)
        proposals = Proposals(self.search, self._limb_proposal, self.settings.proposals, rng, prior, case, observation)
        before = self.search.steps
        candidates = self.search.explored(proposals.kept(), case) if self.settings.keep else []
        looks_up = by_index and can_be_looked_up(observation, self.search.sight)
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
        told = self._searches(candidates, StepCounts.between(before, self.search.steps))
        return judged(self.search, observation, mixture, told)

    def shared(self, processes: int) -> AbstractContextManager[None]:
        """See `estimator.trackers.capabilities.SharesWork`."""
        return search_pool(self.search, processes)

    def _sources(self, proposals: Proposals, observation: Observation) -> list[Source]:
        s = self.settings
        seen = min(1.0, observation.count / (ALL_DETECTED * len(observation.cameras)))
        lost = 1.0 - 0.75 * seen if observation.cues else 0.0
        return [
            Source(s.other_readings, proposals.other_associations),
            Source(s.jumps, proposals.kinematic_jumps),
            Source(lost * s.limb_searches, partial(proposals.limbs, looks=round(lost * s.limb_samples))),
            Source(lost * s.exchanges, proposals.limb_exchanges),
            Source(s.samples, proposals.samples),
        ]

    def _lost(self, candidates: Sequence[Candidate], case: FrameCase, observation: Observation) -> bool:
        """Whether the best of the parents' continuations explains too little of what is seen."""
        if not candidates:
            return False
        best = max(candidates, key=lambda c: c.score)
        name = case.associations[best.hypothesis.association].name
        return agreement(self.search, observation, best.q, name) < ENOUGH

    def _searches(self, candidates: Sequence[Candidate], steps: StepCounts) -> dict[str, np.ndarray]:
        counted = Counter(c.hypothesis.origin.family for c in candidates)
        families = (*_FAMILIES, *([Family.EXAMPLE] if self.search.settings.index else []))
        return searches_told({family: counted[family] for family in families}, steps)

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
    """How much worse the best continuation explains its frame than its parent did the frame before."""
    if not candidates:
        return 0.0
    best = max(candidates, key=lambda c: c.score)
    return best.energy - prior.modes[best.hypothesis.parent].energy


IDLE = (
    idle_where("css.other_readings", search__exchange=False),
    idle_where(
        "search.follow", css__keep=False, css__other_readings=0, css__jumps=0, css__limb_searches=0, css__exchanges=0,
        css__samples=0,
    ),
    idle_where("cost.transition_potential cost.transition_nu", css__transition=False),
    idle_where("css.jump_penalty css.limb_penalty css.momentum", css__transition=False),
    idle_where("css.jump_penalty", css__jumps=0),
    idle_where("css.limb_samples", css__limb_searches=0),
    idle_where("css.limb_searches", css__limb_samples=0),
    idle_where("css.limb_penalty", css__limb_searches=0, css__exchanges=0),
    idle_where("css.limb_penalty", css__limb_samples=0, css__exchanges=0),
    idle_where("css.shape css.scale css.tail", css__samples=0),
    idle_where("css.tail", because="which is regular", css__shape="weakest"),
    idle_where("css.examples css.lost_examples css.example_penalty", search__index=""),
    idle_where("css.example_penalty", css__examples=0, css__lost_examples=0),
    idle_where("css.example_penalty", css__transition=False),
    idle_where("css.lost_examples", css__keep=False),
    idle_where("search.index", search__start=BY_KEYPOINTS, css__examples=0, css__lost_examples=0),
    idle_where("css.budget.alarm", css__budget__calm=1.0),
    idle_where("css.budget.alarm", css__keep=False),
    idle_without(ONE_CAMERA, "css.jumps css.jump_penalty css.exchanges"),
    idle_without(PICTURES, "css.momentum css.limb_searches css.limb_samples css.limb_penalty css.exchanges"),
)  # fmt: skip
"""What has no effect on it (`estimator.trackers.spec.Spec.idle`)."""


def _spec(name: str, sentence: str, settings: CssSettings, defaults: Mapping[str, Any]) -> Spec:
    return Spec(
        name=name,
        sentence=sentence,
        make=by_search(CovarianceScaledSampling),
        group="css",
        settings=settings,
        defaults=defaults,
        idle=IDLE,
        shares_work=lambda own: True,
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
