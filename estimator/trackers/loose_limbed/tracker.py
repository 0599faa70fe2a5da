"""Loose-limbed people: limbs as nodes of a graph in space and time, by non-parametric belief propagation (Sigal,
Bhatia, Roth, Black and Isard, CVPR 2004), and its beliefs put onto the tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import cast

import numpy as np

from estimator.data.observation import Observation
from estimator.inference.annealing import systematic
from estimator.inference.beliefs.graph import Graph
from estimator.inference.beliefs.propagation import BeliefSettings, Propagated, Watch, propagate_batch
from estimator.inference.beliefs.space import PLACEMENTS, points_of
from estimator.inference.mixture import Mixture
from estimator.search.mode_search import ModeSearch
from estimator.trackers.base import Capabilities
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.loose_limbed.assembly import assembled
from estimator.trackers.loose_limbed.instant import InstantReader
from estimator.trackers.loose_limbed.limb_choices import PlacementCluster, outermost
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood, LimbView
from estimator.trackers.loose_limbed.limbs.potential_learning import potentials_for
from estimator.trackers.loose_limbed.limbs.potentials import LimbPotentials
from estimator.trackers.loose_limbed.limbs.window import Beliefs, PastBeliefs, initial_messages, window
from estimator.trackers.loose_limbed.part_detectors.hull import HullSettings, hull_proposals
from estimator.trackers.loose_limbed.settings import LooseLimbedSettings
from estimator.trackers.loose_limbed.state import LimbState, belief_arrays
from estimator.trackers.mixture_state import classify_frame, predict_unobserved
from estimator.trackers.spec import ONLY_FILTERS, Spec, by_search
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.limbs.merging import Detail

_TIED_STD = 0.01, 0.05  # m, rad: how exactly assembled poses place limbs
_OF_LEFT_OVER = {
    "poses": 1500,
    "survivors": 60,
    "count": 6,
}  # of `HullSettings`: it is small
_LEFT_OVER_STD = np.repeat([0.04, 0.3, 1.5], [3, 2, 1])  # m, rad: the turn about an axis is hardly known


class LooseLimbed:
    """The recipe: beliefs of the past stay fixed, and this frame and the next are inferred together. With `smoothing`
    the frame before is inferred with them, and the fixed past is that of the frame before.

    Start, tracking and recovery are one: beliefs of the past are one more message, if there are any.

    For every searched frame it reports limb_points (L, N, 7), limb_weights (L, N) and limb_status (L), see
    `estimator.trackers.loose_limbed.state.belief_arrays`, and limb_names (L).
    """

    needs_keypoints = False

    def __init__(self, search: ModeSearch, settings: LooseLimbedSettings | None = None) -> None:
        self._search = search
        self.body: Body = search.body
        self.settings = settings or LooseLimbedSettings()

    @property
    def capabilities(self) -> Capabilities:
        """It has no energy to give: that of its search is not that of its hypotheses, which limbs have drawn."""
        return Capabilities(frames_ahead=1, frames_behind=int(self.settings.smoothing))

    @cached_property
    def graph(self) -> LimbGraph:
        """The limbs."""
        detail = cast(Detail, self.settings.detail)
        if self.settings.limbs:
            return limb_graph(self.body, detail, self.settings.limbs)
        return _limbs_of(self.body, detail)

    @cached_property
    def potentials(self) -> LimbPotentials:
        """The potentials between limbs."""
        speed = self._search.model.transition_std(1.0)
        if self.settings.potentials or self.settings.limbs:
            return potentials_for(self.graph, self.body, speed, self.settings.potentials)
        return _potentials_of(self.body, self.graph, tuple(speed.tolist()))

    @cached_property
    def instants(self) -> InstantReader:
        """The results of a frame."""
        s = self.settings
        return InstantReader(self._search.model, self.graph, s.seen, s.part_detectors)

    def can_start(self, observation: Observation) -> bool:
        """Whether the person is seen: by keypoints, or in the foreground of a picture."""
        return self.instants.shows_person(observation)

    def init(
        self, rng: np.random.Generator, observation: Observation, following: Sequence[Observation] = ()
    ) -> tuple[LimbState, FrameResult]:
        """See `estimator.trackers.base.Capabilities.frames_ahead`."""
        return self._searched(rng, None, observation, following)

    def step(
        self,
        rng: np.random.Generator,
        state: LimbState,
        observation: Observation,
        following: Sequence[Observation] = (),
        before: Sequence[Observation] = (),
    ) -> tuple[LimbState, FrameResult]:
        """See `estimator.trackers.base.Capabilities.frames_behind`."""
        if not self.can_start(observation):
            after, result = predict_unobserved(self._search, state.mixture, observation.time - state.time, observation)
            return replace(state, mixture=after.mixture, time=after.time), result
        return self._searched(rng, state, observation, following, before)

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> LimbState:
        """See `estimator.trackers.base.TrackerProtocol`."""
        return LimbState.from_arrays(arrays, self.body, len(self.graph.limbs))

    def _searched(
        self,
        rng: np.random.Generator,
        state: LimbState | None,
        observation: Observation,
        following: Sequence[Observation],
        before: Sequence[Observation] = (),
    ) -> tuple[LimbState, FrameResult]:
        behind = self._behind(state, before)
        past = self._past(state, behind[0].time if behind else observation.time)
        graph = self.window(rng, past, observation, following, behind)
        result, mixture = self.inferred(rng, graph, state, observation, anew=past is None, behind=len(behind))
        limbs = len(self.graph.limbs)
        present = result.beliefs[len(behind) * limbs : (len(behind) + 1) * limbs]
        diagnostics = {"limb_names": np.array(self.graph.names, dtype=np.str_), **belief_arrays(present)}
        after, judgement = classify_frame(self._search, observation, mixture, diagnostics)
        if state is not None and behind:
            believed, beliefs = state.seen, self._tied(rng, result.beliefs[:limbs], state.mixture)
        elif state is not None and past is not None and self.settings.smoothing:
            believed, beliefs = state.believed, state.beliefs  # the past of what the next frame looks back at
        else:
            believed, beliefs = after.time, self._tied(rng, present, mixture)
        return LimbState(beliefs, mixture, after.time, after.time, believed), judgement

    def _behind(self, state: LimbState | None, before: Sequence[Observation]) -> list[Observation]:
        """The earlier frames that are inferred again: the last, if the person was seen and its past is known."""
        return [o for o in before if state is not None and state.believed < o.time == state.seen]

    def inferred(
        self,
        rng: np.random.Generator,
        graph: Graph,
        state: LimbState | None,
        observation: Observation,
        *,
        anew: bool,
        behind: int = 0,
        watch: Watch | None = None,
    ) -> tuple[Propagated, Mixture]:
        """Beliefs of the nodes of a window, and the poses assembled from the frame that has so many of the window
        behind it. anew: without a past, in several rounds. watch: see `propagate_batch`, of all rounds."""
        how, limbs = self.propagation(anew=anew), len(self.graph.limbs)
        result = propagate_batch(rng, graph, how, watch=watch)
        mixture = self._assembled(rng, result.beliefs[behind * limbs : (behind + 1) * limbs], state, observation)
        for _ in range(self.settings.start_rounds - 1 if anew else 0):
            again = propagate_batch(rng, graph, how, initial_messages(graph, limbs, self._limbs_in(mixture)), watch)
            other = self._assembled(rng, again.beliefs[:limbs], state, observation)
            if self._at_least_as_good(other, mixture, observation):
                result, mixture = again, other
        return result, mixture

    def _tied(self, rng: np.random.Generator, beliefs: Beliefs, mixture: Mixture) -> Beliefs:
        """Message to the next frame: some of it from the assembled poses, since beliefs of single limbs do not show
        that two of them are in one place."""
        tied = []
        for belief, points in zip(beliefs, self._limbs_in(mixture), strict=True):
            count = round(self.settings.tied * len(belief.points))
            loose = systematic(rng, belief.weights / belief.weights.sum(), len(belief.points) - count)
            chosen = points[rng.choice(len(points), count, p=mixture.weights)]
            near = np.repeat(_TIED_STD, 3) * rng.standard_normal((count, 6))
            both = np.concatenate([belief.points[loose], PLACEMENTS.moved(chosen, near) if count else chosen])
            tied.append(replace(belief, points=both, weights=np.full(len(both), 1.0 / len(both))))
        return tuple(tied)

    def _past(self, state: LimbState | None, time: float) -> PastBeliefs | None:
        """The beliefs before a frame, unless they are older than the potentials' time steps."""
        if state is None or time - state.believed > self.potentials.longest:
            return None
        return PastBeliefs(state.believed, state.beliefs)

    def _limbs_in(self, mixture: Mixture) -> np.ndarray:
        """Points (L, K, 7) of the limbs in the poses of a mixture."""
        t, R = limb_placements(self.graph, self.body, np.array([mode.q for mode in mixture.modes]))
        return np.stack([points_of(t[:, k], R[:, k]) for k in range(len(self.graph.limbs))])

    def _at_least_as_good(self, other: Mixture, mixture: Mixture, observation: Observation) -> bool:
        """Whether the best pose of another mixture is the same, or one whose limbs are likelier to be seen so."""
        best, before = other.modes[0].q, mixture.modes[0].q
        landmarks = [self.body.landmarks(self.body.at(q)) for q in (best, before)]
        if float(np.linalg.norm(landmarks[0] - landmarks[1], axis=1).mean()) < self._search.distinct_by:
            return True
        log_ratio = self.instants.log_ratio(observation)
        if log_ratio is None:
            return True
        t, R = limb_placements(self.graph, self.body, np.array([best, before]))
        seen = np.sum([log_ratio(k, t[:, k], R[:, k]) for k in range(len(self.graph.limbs))], axis=0)
        return bool(seen[0] >= seen[1])

    def window(
        self,
        rng: np.random.Generator,
        past: PastBeliefs | None,
        observation: Observation,
        following: Sequence[Observation],
        behind: Sequence[Observation] = (),
    ) -> Graph:
        """The graph of a frame, of those behind it and of the following ones that are used."""
        reader = self.instants
        ahead = following[: self.capabilities.frames_ahead]
        shown = [*behind, observation, *(o for o in ahead if reader.shows_person(o))]
        instants = [reader.instant(rng, o, anew=past is None) for o in shown]
        return window(self.potentials, self.settings.outlier, instants, past)

    def propagation(self, *, anew: bool) -> BeliefSettings:
        """Settings of the inference of a frame's beliefs. anew: without a past."""
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
        pictures, s = self.instants.pictures(observation), self.settings
        left_over = self.instants.left_over(observation) if s.assembly.left_over > 0.0 else None

        def put_together(received: Mapping[int, Sequence[PlacementCluster]]) -> Mixture:
            return assembled(
                self._search, self.graph, beliefs, observation, pictures, before, elapsed,
                count=s.modes, settings=s.assembly, rng=rng, left_over=left_over, received=received,
            )  # fmt: skip

        mixture = put_together({})
        if left_over is None or pictures is None:
            return mixture
        views = left_over.views(*limb_placements(self.graph, self.body, mixture.modes[0].q))
        received = left_over_places(rng, self.graph, pictures, views, s.part_detectors.hull)
        return put_together(received) if received else mixture


# of a body alone, for those that are tracked again: graphs and drawn potentials take seconds


@lru_cache(maxsize=4)
def _limbs_of(body: Body, detail: Detail) -> LimbGraph:
    return limb_graph(body, detail)


@lru_cache(maxsize=4)
def _potentials_of(body: Body, graph: LimbGraph, speed: tuple[float, ...]) -> LimbPotentials:
    return potentials_for(graph, body, np.array(speed))


def left_over_places(
    rng: np.random.Generator,
    graph: LimbGraph,
    likelihood: LimbLikelihood,
    left: Sequence[LimbView],
    settings: HullSettings,
) -> dict[int, list[PlacementCluster]]:
    """By outermost limb, places in the hull of the person as views show them where what is explained is not known
    (`estimator.trackers.loose_limbed.limbs.left_over.LeftOver.views`), by the likelihood of the whole views."""
    part_proposals = hull_proposals(rng, graph, likelihood, left, replace(settings, **_OF_LEFT_OVER))
    covariance = np.diag(_LEFT_OVER_STD**2)
    places = {
        i: [PlacementCluster(point, covariance, 1.0) for point in part_proposals[i].points] for i in outermost(graph)
    }
    return {i: there for i, there in places.items() if there}


SPEC = Spec(
    name="loose-limbed",
    sentence="limbs as nodes of a graph, by non-parametric belief propagation (Sigal et al. 2004)",
    make=by_search(LooseLimbed),
    group="loose_limbed",
    settings=LooseLimbedSettings(),
    defaults=ONLY_FILTERS,
)
