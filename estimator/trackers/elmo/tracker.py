"""ELMO: the modes of each frame's likelihood, found without the past and weighted by it (Demirdjian, Taycher,
Shakhnarovich, Grauman and Darrell, ICCV 2005); and its parts alone: PSH, the likeliest example, and ICP, one search
from the last pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.energy.descent.solution import SAMPLED, StepCounts
from estimator.inference.mixture import Mixture, Mode, best_distinct, mixture_of
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.cost_model import per_dof
from estimator.search.examples.lookup import Lookup
from estimator.search.examples.person_seen import CUES, can_look_up, sees_person
from estimator.search.first_pose import start_modes
from estimator.search.frame_search import FrameProblem
from estimator.search.from_examples import best_reached, example_starts, shows_silhouette, sides, turned_round
from estimator.search.hypothesis import Candidate, Hypothesis
from estimator.search.jumps.anatomy import Anatomy
from estimator.search.mode_search import ModeSearch
from estimator.search.settings import BY_INDEX, BY_KEYPOINTS, BY_VOLUME
from estimator.trackers.base import Capabilities, Initialisation
from estimator.trackers.elmo.reweighting import diffusion_std, reweighted
from estimator.trackers.elmo.settings import ElmoSettings
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.mixture_state import MixtureState, classify_frame, predict_unobserved, search_counts
from estimator.trackers.spec import FROM_A_PAPER, Spec, by_search, together
from estimator.vision.cues.cue_picture import CuePicture, Dots, PixelLines, dimmed
from estimator.vision.person_view import edges_by_direction, square_transform
from humanoid.kinematics.body import ROOT_JOINT, Body
from humanoid.support.settings import unused_where

_OWN: dict[str, Any] = {
    "search": {"weigh": BY_VOLUME, "explore": {"max_iterations": 5, "decrease_tolerance": 0.5}, "spare": 2},
    "cost": {"stabiliser_weight": 0.25},
    "cues": {"silhouette": {"evidence": 20.0}},
}
"""A mode counts by its probability, not its height (eq. 3); searches are many and short; rest positions, which eq. 2
does not have, only hold what depth does not show. Modes that face the camera and that turn away, which the others do
not search for in every frame, have the same silhouette but for its errors: it counts for less."""
NAME = "examples"


@dataclass(frozen=True)
class ElmoState:
    """mixture: of the last frame. time [s]: of that. seen [s]: of the last frame in which the person was seen."""

    mixture: Mixture
    time: float
    seen: float

    def arrays(self) -> dict[str, np.ndarray]:
        """See `estimator.trackers.base.State`."""
        return {**MixtureState(self.mixture, self.time).arrays(), "seen": np.array(self.seen)}


class Elmo(Initialisation):
    """The recipe; numbers in comments are the paper's equations.

    The person is found by depth or, where that is not used, by the silhouette; the pose by all cues used.

    For every searched frame it reports `searches`, `searches_FAMILY` and steps (see `search_counts`), `looked_at`: the
    number of examples the picture was compared with, and `fell_back`: whether its buckets were empty and it was
    compared with all.
    """

    def __init__(self, search: ModeSearch, settings: ElmoSettings | None = None) -> None:
        self.search = search
        self.body: Body = search.body
        self.settings = settings or ElmoSettings()

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[ElmoState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        if self.needs_keypoints or not self.settings.neighbours:
            mixture = start_modes(self.search, rng, observation, self.settings.modes)
            return self._classify(observation, mixture, None)
        self.search.examples.check(observation)
        return self._searched(observation, None)

    def step(
        self, rng: np.random.Generator, state: ElmoState, observation: Observation
    ) -> tuple[ElmoState, FrameResult]:
        """See `estimator.trackers.base.TrackerProtocol`."""
        if not self._can_search(observation):
            after, result = predict_unobserved(self.search, state.mixture, observation.time - state.time, observation)
            return ElmoState(after.mixture, after.time, state.seen), result
        return self._searched(observation, state)

    def _can_search(self, observation: Observation) -> bool:
        """Whether a frame can be searched: from the last modes if from nothing else."""
        if self.settings.keep and sees_person(observation, self.search.evidence):
            return True
        if self.settings.neighbours:
            return can_look_up(observation, self.search.evidence)
        return observation.has_enough_points

    def state_from(self, arrays: Mapping[str, np.ndarray]) -> ElmoState:
        """See `estimator.trackers.base.TrackerProtocol`."""
        state = MixtureState.from_arrays(arrays, self.body)
        seen = float(arrays["seen"])
        if not seen <= state.time:
            raise ValueError(f"the person was seen at {seen:g} s, after {state.time:g}")
        return ElmoState(state.mixture, state.time, seen)

    @property
    def capabilities(self) -> Capabilities:
        """It always looks up poses, by cues."""
        return replace(super().capabilities, needed_cues=CUES, pictures=self.pictures)

    def pictures(self, observation: Observation, result: FrameResult) -> Mapping[int, CuePicture]:
        """See `Capabilities.pictures`: what was looked up, and the modes that came of it."""
        anatomy, modes = self.search.jumps.anatomy, list(result.q)
        shown: dict[int, CuePicture] = {}
        for lookup in self.lookups(observation):
            cues = observation.cues[lookup.camera]
            shown[lookup.camera] = lookup_picture(
                self.body, anatomy, self.search.examples.index.side, cues, lookup, modes
            )
        return shown

    def lookups(self, observation: Observation) -> list[Lookup]:
        """The keys of a frame's pictures and the examples found; nothing without neighbours."""
        s = self.settings
        return self.search.examples.lookups(observation, s.neighbours, s.votes) if s.neighbours else []

    def _lookup_without_prior(self, observation: Observation) -> list[Lookup]:
        s = self.settings
        return self.search.examples.lookup_without_prior(observation, s.neighbours, s.votes) if s.neighbours else []

    def _searched(self, observation: Observation, state: ElmoState | None) -> tuple[ElmoState, FrameResult]:
        before = self.search.steps
        anew = state is None or state.seen < state.time  # who was hidden may have turned
        lookups = self._lookup_without_prior(observation) if anew else self.lookups(observation)
        starts = self._starts(lookups, state, anew)
        likelihood = self.search.likelihood(observation, starts[0].q)
        case = FrameProblem(self.search.associations(observation), 0.0, likelihood)
        mixture = self._modes(starts, lookups, observation, case, anew)  # 3
        if state is not None:
            mixture = self._weighed(mixture, state, observation)  # 6
            if self.settings.settle:
                mixture = self._refine_with_transition(mixture, state, case._replace(dt=observation.time - state.seen))
            mixture = self._moving(mixture, state, observation.time)
        diagnostics = _diagnostics(lookups, starts, StepCounts.between(before, self.search.steps))
        return self._classify(observation, mixture, diagnostics)

    def _starts(self, lookups: Sequence[Lookup], state: ElmoState | None, anew: bool) -> list[Hypothesis]:
        starts = example_starts(self.body, lookups, self.settings.away if anew else 0.0)
        if state is not None and self.settings.keep:
            starts += [Hypothesis(mode.q, 0, Origin(Family.KEPT)) for mode in state.mixture.modes]
        return starts

    def _modes(
        self,
        starts: Sequence[Hypothesis],
        lookups: Sequence[Lookup],
        observation: Observation,
        case: FrameProblem,
        anew: bool,
    ) -> Mixture:
        """The best distinct modes of the likelihood that are reached from the starts."""
        s, search = self.settings, self.search
        if s.rounds == 0:
            return self._likeliest(starts, case)
        groups = sides(self.body, starts, lookups) if anew else [starts]
        headings = s.headings and not shows_silhouette(observation)
        return best_reached(
            search, groups, lookups, observation, case, s.descent, s.modes, headings=headings, alone=anew
        )

    def _likeliest(self, starts: Sequence[Hypothesis], case: FrameProblem) -> Mixture:
        """The start of lowest energy, unsearched, with the uncertainty of one frame's change."""
        (best,) = self.search.screened(starts, case, 1)
        energy = -self.search.frame(case).score(best)
        covariance = np.diag(np.square(self._floor))
        mode = Mode(best.q, covariance, energy, SAMPLED, np.zeros(self.body.nv), origin=best.origin)
        return mixture_of((mode,), np.zeros(1))

    @cached_property
    def _floor(self) -> np.ndarray:
        s = self.settings
        return per_dof(self.body, s.turn_floor, s.root_turn_floor, s.root_slide_floor)

    def _weighed(self, likely: Mixture, state: ElmoState, observation: Observation) -> Mixture:
        """Modes of the likelihood, weighted by the past (eq. 6)."""
        std = diffusion_std(self.search.model.transition_std(1.0), observation.time - state.seen, self._floor)
        modes, jump = [m.q for m in likely.modes], self.settings.jump
        wide = [m.covariance for m in likely.modes] if self.settings.settle else None
        weighed = reweighted(self.body, modes, self._as_new(likely, state, observation), state.mixture, std, jump, wide)
        continued = [replace(mode, parent=int(p)) for mode, p in zip(likely.modes, weighed.parent, strict=True)]
        walked = np.array([self._walked(mode, state) for mode in continued])
        return mixture_of(tuple(continued), weighed.log_scores + self.settings.forwards * walked)

    def _walked(self, mode: Mode, state: ElmoState) -> float:
        """How far the root has moved forwards since a mode's parent [m], negative backwards; 0 without a parent."""
        if mode.parent < 0 or not self.body.has_free_root:
            return 0.0
        both = self.body.placed(np.array([state.mixture.modes[mode.parent].q, mode.q])).placements[:, ROOT_JOINT]
        return float((both[1, 9:] - both[0, 9:]) @ both[:, :3].mean(axis=0))

    def _as_new(self, likely: Mixture, state: ElmoState, observation: Observation) -> np.ndarray:
        """Log scores (L,) of modes by the new evidence of a frame.

        A silhouette hardly shows which way a person faces, and its errors, which then decide, stay the same for a
        while: by so much less the best mode that faces as before and the best that is turned round differ. Among those
        that face one way nothing changes.
        """
        share = (observation.time - state.seen) / max(self.settings.correlated, 1e-9)
        if share >= 1.0 or not self.body.has_free_root or not shows_silhouette(observation):
            return likely.log_scores
        q, scores = np.array([mode.q for mode in likely.modes]), likely.log_scores
        turned = turned_round(self.body, q, state.mixture.modes[0].q)
        best = np.array([scores[turned == way].max() for way in turned])
        return np.asarray(scores - (1.0 - share) * best)

    def _refine_with_transition(self, weighed: Mixture, state: ElmoState, case: FrameProblem) -> Mixture:
        """The same modes with the transition from their parents, where they have one, in the energy. Those that come to
        one pose are one, of the weight of the likelier."""
        candidates = [self._candidate(mode, state, case) for mode in weighed.modes]
        scored = list(zip(self.search.refined(candidates, case), weighed.log_scores.tolist(), strict=True))
        kept = best_distinct(scored, lambda x: x[1], lambda x: x[0].landmarks, self.search.distinct_by, len(scored))
        return mixture_of(tuple(r.mode for r, _ in kept), np.array([score for _, score in kept]))

    def _candidate(self, mode: Mode, state: ElmoState, case: FrameProblem) -> Candidate:
        previous = None if mode.parent < 0 else PreviousPose(state.mixture.modes[mode.parent].q)
        origin = Origin(mode.origin.family if mode.origin else Family.KEPT, previous)
        association = [a.name for a in case.associations].index(mode.association)
        landmarks = self.body.landmarks(self.body.at(mode.q))
        return Candidate(Hypothesis(mode.q, association, origin, mode.parent), mode.q, landmarks, mode.energy)

    def _moving(self, mixture: Mixture, state: ElmoState, time: float) -> Mixture:
        """The same modes with their velocities since their parents."""
        before, elapsed = state.mixture.modes, time - state.time
        modes = (
            m if m.parent < 0 else replace(m, velocity=self.body.velocity(before[m.parent].q, m.q, elapsed))
            for m in mixture.modes
        )
        return replace(mixture, modes=tuple(modes))

    def _classify(
        self, observation: Observation, mixture: Mixture, diagnostics: Mapping[str, np.ndarray] | None
    ) -> tuple[ElmoState, FrameResult]:
        after, result = classify_frame(self.search, observation, mixture, diagnostics)
        return ElmoState(after.mixture, after.time, after.time), result


def _diagnostics(lookups: Sequence[Lookup], starts: Sequence[Hypothesis], steps: StepCounts) -> dict[str, np.ndarray]:
    counts = {f: sum(h.origin.family is f for h in starts) for f in (Family.EXAMPLE, Family.KEPT)}
    return {
        **search_counts(counts, steps),
        "looked_at": np.array(sum(lookup.neighbours.comparisons for lookup in lookups)),
        "fell_back": np.array(sum(lookup.neighbours.fell_back for lookup in lookups)),
    }


def _spec(name: str, sentence: str, settings: ElmoSettings, start: str = BY_INDEX) -> Spec:
    return Spec(
        name=name,
        sentence=sentence,
        make=by_search(Elmo),
        group="elmo",
        settings=settings,
        defaults=together(FROM_A_PAPER, _OWN, {"search": {"start": start}}),
        unused=(
            unused_where("search.index", search__start=BY_KEYPOINTS, elmo__neighbours=0),
            unused_where("cost.transition_potential cost.transition_nu", elmo__settle=False),
        ),
        looks_up=lambda own: own.neighbours > 0,
    )


SPECS = (
    _spec("elmo", "modes of each frame's likelihood, found through an index of examples (ELMO)", ElmoSettings()),
    _spec(
        "psh",
        "the likeliest of the examples that look like the picture (ELMO section 4)",
        ElmoSettings(modes=1, keep=False, rounds=0, settle=False),
    ),
    _spec(
        "icp",
        "one search from the last pose (ELMO section 4)",
        ElmoSettings(modes=1, neighbours=0, rounds=8, survivors=1, settle=False),
        BY_KEYPOINTS,
    ),
)


def lookup_picture(
    body: Body, anatomy: Anatomy, side: float, cues: ImageCues, lookup: Lookup, modes: Sequence[np.ndarray]
) -> CuePicture:
    """The edges that a person was looked up by, the limbs of the examples, the nearest the strongest, and those of the
    modes that were reached, the likeliest the strongest.

    side [m]: of the square that was cut out. modes (K) of (nq,).
    """
    to_square = square_transform(cues.camera, lookup.frame, side)
    rows, columns = np.nonzero(np.any(edges_by_direction(lookup.square, lookup.where), axis=0))
    edges = (np.stack([columns, rows], axis=1) - to_square[:, 2]) / to_square[0, 0]
    return CuePicture(
        NAME,
        "edges, examples and modes",
        cv2.cvtColor(dimmed(cues.picture), cv2.COLOR_GRAY2BGR),
        [
            Dots(edges, "text", 0.7),
            _limbs(body, anatomy, cues, list(lookup.q), "hypothesis"),
            _limbs(body, anatomy, cues, modes, "good"),
        ],
        [("edges looked up", "text"), ("examples", "hypothesis"), ("modes", "good")],
    )


def _limbs(body: Body, anatomy: Anatomy, cues: ImageCues, poses: Sequence[np.ndarray], colour: str) -> PixelLines:
    """Both segments of every limb of some poses, fainter from one to the next."""
    ends, weight = [], []
    for k, q in enumerate(poses):
        pixels = cues.camera.project(body.landmarks(body.at(q)))
        for limb in anatomy.limbs:
            root, middle, end = pixels[limb.landmarks]
            ends += [(root, middle), (middle, end)]
            weight += [1.0 / (1.0 + k)] * 2
    seen = np.array(ends).reshape(-1, 2, 2)
    inside = np.isfinite(seen).all(axis=(1, 2))
    return PixelLines(seen[inside, 0], seen[inside, 1], colour, np.array(weight)[inside])
