"""From hypotheses to modes: explore every start a little, keep the distinct best or all, refine them to convergence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TypeVar

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.descent.compiled_seek import CompiledSeeker
from estimator.energy.descent.solution import StepCounts
from estimator.energy.reprojection import Reprojection
from estimator.inference.mixture import Mixture, best_distinct, body_size, mixture_of
from estimator.search.cost_model import CostModel
from estimator.search.examples.index import REMEDY, ExampleIndex, load_index
from estimator.search.examples.limbs import LimbBank
from estimator.search.examples.lookup import Lookup, Votes, check_elevation, either_way, lookups, turned_away
from estimator.search.examples.person_seen import CUES, PersonEvidence, persons
from estimator.search.frame_search import FrameProblem, FrameSearch
from estimator.search.hypothesis import AS_DETECTED, EXCHANGED, Association, Candidate, Hypothesis, Refined
from estimator.search.jumps import KinematicJumps
from estimator.search.jumps.anatomy import TwoSegmentLimb
from estimator.search.jumps.readings import (
    ACROSS,
    AWAY,
    TOWARDS,
    has_both,
    reading_shifts,
    readings_of_points,
    trunk_readings,
)
from estimator.search.settings import BY_HEIGHT, BY_IMPORTANCE, ModeSearchSettings
from estimator.search.volumes import importance_log_volumes
from estimator.vision.cues.image_likelihood import ImageLikelihood
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.shape.surface import Surface
from humanoid.subject.landmarks import mirror_index
from humanoid.support.errors import InputError

Scored = TypeVar("Scored", Candidate, Refined)
_EITHER_WAY = 4  # times as many examples are compared where both facings are needed


class ModeSearch:
    """Finds the modes of frames of one body under one cost model.

    steps: of all searches so far.
    distinct_by [m]: poses with all landmarks nearer than that count as one.
    """

    def __init__(self, model: CostModel, settings: ModeSearchSettings | None = None) -> None:
        self.model = model
        self.body = model.body
        self.settings = settings or ModeSearchSettings()
        self.seeker = CompiledSeeker(self.body, self.settings.refine, self.settings.step_solver)
        self.self_collision: SelfCollision | None = model.self_collision
        self.mirror = mirror_index(self.body.landmark_names)
        self.jumps = KinematicJumps(self.body)
        self.steps = StepCounts()
        self.distinct_by = self.settings.distinct * body_size(self.body)
        self._frame: FrameSearch | None = None
        self._last_terms: tuple[Observation, dict[str, Reprojection]] | None = None

    @cached_property
    def evidence(self) -> PersonEvidence:
        """The cue by which a person is looked up: depth where that is used; the height is that of the landmarks at
        rest."""
        cue = next((name for name in CUES if name in self.model.cues.used), CUES[0])
        return PersonEvidence(cue, float(np.ptp(self.body.landmarks(self.body.at(self.body.neutral))[:, 2])))

    @cached_property
    def examples(self) -> Examples:
        """The examples of the index, read on first access; raises InputError where there is none."""
        if not self.settings.index:
            raise InputError("search.index", "no index of examples is named", remedy=REMEDY)
        return Examples(load_index(self.settings.index, self.body), self.body, self.evidence)

    def associated(self, observation: Observation, association: str) -> Observation:
        """A frame's keypoints, each at the landmark that an association (its name, see `Mode`) assigns it to."""
        return observation.exchanged(self.mirror) if association == EXCHANGED else observation

    def term(self, observation: Observation, association: str) -> Reprojection:
        """The keypoint term of a frame in one association; made once for a frame."""
        if self._last_terms is None or self._last_terms[0] is not observation:
            self._last_terms = observation, {}
        terms = self._last_terms[1]
        if association not in terms:
            terms[association] = self.model.observation_term(self.associated(observation, association))
        return terms[association]

    def likelihood(self, observation: Observation, q: np.ndarray) -> ImageLikelihood:
        """The frame's image likelihood; q (nq,): about where the body is."""
        return self.model.likelihood(observation, self.body.at(q))

    def associations(self, observation: Observation, near: np.ndarray | None = None) -> tuple[Association, ...]:
        """The associations of a frame: as detected, and with left and right exchanged where the body has sides.

        near (nq,): about where the body is. Where several cameras see it, sides are exchanged only if that brings some
        camera's keypoints nearer to it: together they distinguish front from back, so that an exchange which all of
        them contradict leads to no useful mode.
        """
        detected = Association(AS_DETECTED, self.term(observation, AS_DETECTED), 0.0)
        exchangeable = observation.count > 0 and not observation.given
        if not self.settings.exchange or not exchangeable or np.all(self.mirror == np.arange(len(self.mirror))):
            return (detected,)
        exchanged = self.term(observation, EXCHANGED)
        if near is not None and len(observation.cameras) > 1:
            posed = self.body.at(near)
            gains = exchanged.values_of_cameras(posed) < detected.term.values_of_cameras(posed)
            if not gains.any():
                return (detected,)
        return detected, Association(EXCHANGED, exchanged, self.model.settings.exchange_penalty)

    def best_modes(
        self,
        hypotheses: Iterable[Hypothesis],
        case: FrameProblem,
        count: int,
        rng: np.random.Generator | None = None,
        *,
        every: bool = False,
    ) -> Mixture:
        """The `count` best distinct modes reached from the hypotheses, as a mixture, see `best_of`."""
        return self.best_of(self.explored(hypotheses, case), case, count, rng, every=every)

    def explored(self, hypotheses: Iterable[Hypothesis], case: FrameProblem) -> list[Candidate]:
        """Every hypothesis after a short search."""
        frame, hypotheses = self.frame(case), list(hypotheses)
        frame.follow([h.origin.previous for h in hypotheses if h.origin.previous is not None])
        return self._counted([frame.explore(h) for h in hypotheses])

    def best_of(
        self,
        explored: Sequence[Candidate],
        case: FrameProblem,
        count: int,
        rng: np.random.Generator | None = None,
        *,
        every: bool = False,
    ) -> Mixture:
        """The `count` best distinct modes, searched to convergence, as a mixture.

        rng: for weights by importance sampling (`ModeSearchSettings.weigh`), which count by volume without it. every:
        search all candidates to convergence, not only the best distinct ones.
        """
        kept = explored if every else self.best_of_readings(explored, case, count + self.settings.spare)
        return self.mixture(self.refined(kept, case), case, count, rng)

    def mixture(
        self, refined: Sequence[Refined], case: FrameProblem, count: int, rng: np.random.Generator | None = None
    ) -> Mixture:
        """The `count` best distinct modes of those that were searched to convergence, see `best_of`."""
        best = self.best_of_readings(self.apart(list(refined)), case, count)
        scores = np.array([r.score for r in best]) + self.log_volumes(best, case, rng)
        energy = np.array([r.mode.energy for r in best])
        shifts = self.reading_shifts(np.array([r.mode.q for r in best]), energy, case.only_camera)
        return mixture_of(tuple(r.mode for r in best), scores - shifts)

    def refined(self, candidates: Sequence[Candidate], case: FrameProblem) -> list[Refined]:
        """Every candidate after a search to convergence."""
        frame = self.frame(case)
        return self._counted([frame.refine(c) for c in candidates])

    def screened(
        self, hypotheses: Sequence[Hypothesis], case: FrameProblem, count: int, pictures: bool = True
    ) -> list[Hypothesis]:
        """The `count` unsearched hypotheses of lowest energy, with or without the pictures': many cheap evaluations
        before a few searches."""
        frame = self.frame(case)
        scores = [frame.score(h) for h in hypotheses] if pictures else frame.score_keypoints(hypotheses)
        return [hypotheses[k] for k in np.argsort(-np.array(scores), kind="stable")[:count]]

    def frame(self, case: FrameProblem) -> FrameSearch:
        """The searches of a case; what they share is kept until the next one."""
        if self._frame is None or self._frame.case is not case:
            self._frame = FrameSearch(self.model, self.seeker, self.settings, case)
        return self._frame

    def log_volumes(
        self, best: Sequence[Refined], case: FrameProblem, rng: np.random.Generator | None = None
    ) -> np.ndarray:
        """Log-volumes (K,) of the modes, added to their weights; see `ModeSearchSettings.weigh`."""
        frame = self.frame(case)
        if self.settings.weigh == BY_HEIGHT:
            return np.zeros(len(best))
        if self.settings.weigh == BY_IMPORTANCE and rng is not None:
            modes = [frame.surroundings(r) for r in best]
            return importance_log_volumes(rng, self.body, modes, self.settings.weigh_samples)
        return np.array([frame.log_volume(r) for r in best])

    def _counted(self, searched: list[Scored]) -> list[Scored]:
        """The same; their steps are counted."""
        for each in searched:
            self.steps = self.steps.plus(each.steps)
        return searched

    def apart(self, refined: list[Refined]) -> list[Refined]:
        """Those whose parts could be separated; all of them if there are none."""
        return [r for r in refined if r.mode.penetration <= self.settings.contact.limit] or refined

    def best_of_readings(self, searched: Sequence[Scored], case: FrameProblem, count: int) -> list[Scored]:
        """The `count` best distinct ones, both readings of the trunk among them where there are any (see
        `ModeSearchSettings.readings`): in place of the worst."""
        best: list[Scored] = self.distinct(searched, count)
        camera = case.only_camera
        if not self.settings.readings or camera is None or not 2 <= count <= len(best):
            return best
        readings = readings_of_points(self.body, np.array([c.landmarks for c in searched]), camera)
        there = readings_of_points(self.body, np.array([c.landmarks for c in best]), camera)
        missing = [r for r in (TOWARDS, AWAY) if r not in there]
        if there[0] == ACROSS or len(missing) != 1:
            return best
        return self.with_one_of(best, [c for c, r in zip(searched, readings, strict=True) if r == missing[0]], count)

    def with_one_of(self, best: list[Scored], others: Sequence[Scored], count: int) -> list[Scored]:
        """The best, at most `count` of them, with the best of others among them, in place of the worst if need be; as
        they are where there are no others."""
        return best[: count - 1] + (self.distinct(others, 1) or best[count - 1 :])

    def readings(self, q: np.ndarray, camera: Camera | None) -> np.ndarray:
        """The reading (K,) of the trunk in each of some configurations (K, nq) that one camera sees, see
        `trunk_readings`; "" where several do, or readings are not distinguished."""
        if not self.settings.readings or camera is None:
            return np.full(len(q), "", dtype="U7")
        return trunk_readings(self.body, q, camera)

    def reading_shifts(self, q: np.ndarray, energy: np.ndarray, camera: Camera | None) -> np.ndarray:
        """See `estimator.search.jumps.readings.reading_shifts`, of modes q (K, nq) of energies (K,) that one camera
        sees; zero where several do."""
        readings = self.readings(q, camera)
        if not has_both(readings):
            return np.zeros(len(q))
        return reading_shifts(readings, energy, self.model.rest_energies(q), self.settings.readings_rest)

    def distinct(self, searched: Sequence[Scored], count: int) -> list[Scored]:
        """The `count` best of which no two are the same pose (see `ModeSearchSettings.distinct`)."""
        return best_distinct(searched, lambda c: c.score, lambda c: c.landmarks, self.distinct_by, count)


class Examples:
    """The examples of one index for one body, whose person is seen by `evidence`."""

    def __init__(self, index: ExampleIndex, body: Body, evidence: PersonEvidence) -> None:
        self.index, self.evidence, self._body = index, evidence, body
        self._banks: dict[int, LimbBank] = {}

    def lookups(self, observation: Observation, count: int, together: bool = True) -> list[Lookup]:
        """The keys of a frame's pictures, and the `count` most similar examples: chosen by all cameras together, or as
        many by each."""
        return lookups(self.index, observation, count, self.evidence, self._votes if together else None)

    def lookup_without_prior(self, observation: Observation, count: int, together: bool = True) -> list[Lookup]:
        """The same for a frame without a past. Where only one camera sees the person, which hardly distinguishes front
        from back, half of the examples face it and half turn away, whichever are slightly more similar to the
        picture."""
        lookups = self.lookups(observation, _EITHER_WAY * count, together)
        if len(lookups) != 1:
            return self.lookups(observation, count, together)
        (lookup,) = lookups
        away = turned_away(self._body, self._body.placed(lookup.q), lookup.frame) > 90.0
        return [either_way(lookup, away, count)]

    def check(self, observation: Observation) -> None:
        """Raise InputError where the cameras that see the person look down otherwise than the examples' does: what
        they see would look like none of them."""
        check_elevation(self.index, observation, {c: frame for c, frame, _ in persons(observation, self.evidence)})

    def limbs(self, surface: Surface, limbs: tuple[TwoSegmentLimb, ...], count: int) -> LimbBank:
        """The limbs of `count` of the examples, always the same ones; made once."""
        if count not in self._banks:
            q = self.index.q
            chosen = np.random.default_rng(0).choice(len(q), min(count, len(q)), replace=False)
            self._banks[count] = LimbBank(self._body, surface, limbs, q[np.sort(chosen)].astype(np.float64))
        return self._banks[count]

    @cached_property
    def _votes(self) -> Votes:
        return Votes(self.index, self._body)
