"""Loose-limbed people: limbs as nodes of a graph in space and time, by non-parametric belief propagation (Sigal,
Bhatia, Roth, Black and Isard, CVPR 2004), and its beliefs put onto the tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np

from estimator.imaging.observation import Observation
from estimator.inference.beliefs.propagation import BeliefSettings, Propagated, propagate_batch
from estimator.limbs.potential_choice import potentials_for
from estimator.limbs.potentials import LimbPotentials
from estimator.limbs.window import Beliefs, Past, window
from estimator.modes.mixture import Mixture
from estimator.search.assembly import AssemblySettings, assembled
from estimator.search.mode_search import ModeSearch
from estimator.trackers.defaults import ONLY_FILTERS
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.limb_instant import InstantReader, SeenSettings, ShoutSettings
from estimator.trackers.limb_state import LimbState, belief_arrays
from estimator.trackers.mixture_state import carried, judged
from estimator.trackers.spec import Spec, by_search
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph
from humanoid.limbs.merging import RULES, Detail
from humanoid.support.settings import check, setting


@dataclass(frozen=True)
class LooseLimbedSettings:
    """The loose-limbed tracker.

    detail: which bodies are limbs of their own, "paper" or "fine" (`humanoid.limbs`). limbs: a TOML file with changes
    to that. potentials: a file of learned potentials; without one the shipped ones where they are of these limbs, else
    such as the joints allow. outlier: lambda0, share of the potentials' outlier process. propagation: of a frame with
    a past. start_kernels, start_samples, start_iterations, start_proposal_factor: instead of
    `propagation`'s in the first frame, and in the first after so many without the person that the past says nothing.
    seen: what limbs are seen by. shout: who says bottom-up where limbs may be. modes: hypotheses kept. assembly:
    how they are made of the limbs.
    """

    detail: str = setting("paper", one_of=tuple(RULES))
    limbs: str = ""
    potentials: str = ""
    outlier: float = setting(0.01, above=0, below=1)
    propagation: BeliefSettings = field(default_factory=BeliefSettings)
    start_kernels: int = setting(200, at_least=2)
    start_samples: int = setting(200, at_least=1)
    start_iterations: int = setting(30, at_least=1)
    start_proposal_factor: float = setting(0.9, at_least=0, at_most=1)
    seen: SeenSettings = field(default_factory=SeenSettings)
    shout: ShoutSettings = field(default_factory=ShoutSettings)
    modes: int = setting(5, at_least=1)
    assembly: AssemblySettings = field(default_factory=AssemblySettings)

    def __post_init__(self) -> None:
        check(self)


class LooseLimbed:
    """The recipe: what is believed of the frame before stays, and this frame and the next are inferred together.

    Start, track and recovery are one: what is believed of the past is one more message, if there is any.

    Of every searched frame it tells limb_points (L, N, 7), limb_weights (L, N) and limb_status (L), see
    `estimator.trackers.limb_state.belief_arrays`, and limb_names (L).
    """

    frames_ahead = 1
    needs_keypoints = False

    def __init__(self, search: ModeSearch, settings: LooseLimbedSettings | None = None) -> None:
        self._search = search  # its energy is not that of the hypotheses, which limbs have drawn: no `HasEnergy`
        self.body: Body = search.body
        self.settings = settings or LooseLimbedSettings()

    @cached_property
    def graph(self) -> LimbGraph:
        """The limbs."""
        detail = cast(Detail, self.settings.detail)
        return limb_graph(self.body, detail, self.settings.limbs or None)

    @cached_property
    def potentials(self) -> LimbPotentials:
        """What limbs say of each other."""
        speed = self._search.model.transition_std(1.0)
        return potentials_for(self.graph, self.body, speed, self.settings.potentials)

    @cached_property
    def _instants(self) -> InstantReader:
        s = self.settings
        return InstantReader(self._search.model, self.graph, s.seen, s.shout)

    def can_start(self, observation: Observation) -> bool:
        """Whether the person is seen: by keypoints, or in the foreground of a picture."""
        return self._instants.shows_person(observation)

    def init(
        self, rng: np.random.Generator, observation: Observation, following: Sequence[Observation] = ()
    ) -> tuple[LimbState, FrameResult]:
        """See `estimator.trackers.capabilities.LooksAhead`."""
        return self._searched(rng, None, observation, following)

    def step(
        self,
        rng: np.random.Generator,
        state: LimbState,
        observation: Observation,
        following: Sequence[Observation] = (),
    ) -> tuple[LimbState, FrameResult]:
        """See `estimator.trackers.capabilities.LooksAhead`."""
        if not self.can_start(observation):
            after, result = carried(self._search, state.mixture, observation.time - state.time, observation)
            return LimbState(state.beliefs, after.mixture, after.time, state.seen), result
        return self._searched(rng, state, observation, following)

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> LimbState:
        """See `estimator.trackers.base.Tracker`."""
        return LimbState.from_arrays(arrays, self.body, len(self.graph.limbs))

    def _searched(
        self,
        rng: np.random.Generator,
        state: LimbState | None,
        observation: Observation,
        following: Sequence[Observation],
    ) -> tuple[LimbState, FrameResult]:
        past = self._past(state, observation.time)
        beliefs = self._inferred(rng, past, observation, following).beliefs[: len(self.graph.limbs)]
        mixture = self._assembled(rng, beliefs, state, observation)
        told = {"limb_names": np.array(self.graph.names, dtype=np.str_), **belief_arrays(beliefs)}
        after, result = judged(self._search, observation, mixture, told)
        return LimbState(beliefs, mixture, after.time, after.time), result

    def _past(self, state: LimbState | None, time: float) -> Past | None:
        """What was believed, unless that is longer ago than the potentials know of."""
        if state is None or time - state.seen > self.potentials.longest:
            return None
        return Past(state.seen, state.beliefs)

    def _inferred(
        self, rng: np.random.Generator, past: Past | None, observation: Observation, following: Sequence[Observation]
    ) -> Propagated:
        reader = self._instants
        shown = [observation, *(o for o in following[: self.frames_ahead] if reader.shows_person(o))]
        instants = [reader.instant(rng, o, anew=past is None) for o in shown]
        graph = window(self.potentials, self.settings.outlier, instants, past)
        return propagate_batch(rng, graph, self._propagation(past is None))

    def _propagation(self, anew: bool) -> BeliefSettings:
        s = self.settings
        if not anew:
            return s.propagation
        return replace(
            s.propagation,
            kernels=s.start_kernels,
            samples=s.start_samples,
            iterations=s.start_iterations,
            proposal_factor=s.start_proposal_factor,
        )

    def _assembled(
        self, rng: np.random.Generator, beliefs: Beliefs, state: LimbState | None, observation: Observation
    ) -> Mixture:
        before, elapsed = (None, 0.0) if state is None else (state.mixture, observation.time - state.time)
        pictures, s = self._instants.pictures(observation), self.settings
        return assembled(
            self._search, self.graph, beliefs, observation, pictures, before, elapsed,
            count=s.modes, settings=s.assembly, rng=rng,
        )  # fmt: skip


SPEC = Spec(
    name="loose-limbed",
    sentence="limbs as nodes of a graph, by non-parametric belief propagation (Sigal et al. 2004)",
    make=by_search(LooseLimbed),
    group="loose_limbed",
    settings=LooseLimbedSettings(),
    defaults=ONLY_FILTERS,
)
