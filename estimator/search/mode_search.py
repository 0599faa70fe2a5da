"""From hypotheses to modes: explore every start a little, keep the distinct best, refine those to convergence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from estimator.cost.model import CostModel
from estimator.cues.evidence import Evidence
from estimator.imaging.observation import Observation
from estimator.modes.merge import best_distinct, body_size
from estimator.modes.mixture import Mixture, mixture_of
from estimator.optimise.seek import Seeker
from estimator.search.frame_search import Candidate, FrameCase, FrameSearch, Hypothesis, Reading, Refined
from estimator.search.jumps import Flips
from estimator.search.settings import BY_HEIGHT, BY_IMPORTANCE, ModeSearchSettings
from estimator.search.sharing import Alone, Sharing
from estimator.search.volumes import importance_log_volumes
from estimator.terms.reprojection import Reprojection
from humanoid.collision.clearance import Clearance
from humanoid.subject.landmarks import mirror_index

__all__ = [
    "AS_DETECTED", "EXCHANGED", "Candidate", "FrameCase", "Hypothesis", "ModeSearch", "ModeSearchSettings", "Reading",
]  # fmt: skip

AS_DETECTED, EXCHANGED = "as_detected", "exchanged"

Scored = TypeVar("Scored", Candidate, Refined)


class ModeSearch:
    """Finds the modes of frames of one body under one cost model.

    sharing: who does the pieces of work; this process alone, unless `estimator.search.workers.helped` has it helped.
    What comes out is the same to the last bit.
    """

    def __init__(self, model: CostModel, settings: ModeSearchSettings | None = None) -> None:
        self.model = model
        self.body = model.body
        self.settings = settings or ModeSearchSettings()
        self.seeker = Seeker(self.body, self.settings.refine)
        self.clearance: Clearance | None = model.clearance
        self.mirror = mirror_index(self.body.landmark_names)
        self.flips = Flips(self.body)
        self.sharing: Sharing = Alone()
        self._distance = self.settings.distinct * body_size(self.body)
        self._frame: FrameSearch | None = None

    def read(self, observation: Observation, association: str) -> Observation:
        """A frame's keypoints as an association (see `Mode`) takes them."""
        return observation.exchanged(self.mirror) if association == EXCHANGED else observation

    def term(self, observation: Observation, association: str) -> Reprojection:
        """The keypoint term of a frame in one association."""
        return self.model.observation_term(self.read(observation, association))

    def evidence(self, observation: Observation, q: np.ndarray) -> Evidence | None:
        """What the frame's pictures say, None where there are none; q (nq,): about where the body is."""
        return self.model.evidence(observation, self.body.at(q))

    def readings(self, observation: Observation) -> tuple[Reading, ...]:
        """The readings of a frame: as detected, and with left and right exchanged where the body has sides."""
        found = [Reading(AS_DETECTED, self.term(observation, AS_DETECTED), 0.0)]
        swappable = observation.count > 0 and not observation.given
        if self.settings.exchange and swappable and np.any(self.mirror != np.arange(len(self.mirror))):
            penalty = self.model.settings.exchange_penalty
            found.append(Reading(EXCHANGED, self.term(observation, EXCHANGED), penalty))
        return tuple(found)

    def best_modes(
        self, hypotheses: Iterable[Hypothesis], case: FrameCase, count: int, rng: np.random.Generator | None = None
    ) -> Mixture:
        """The `count` best distinct modes reached from the hypotheses, as a mixture."""
        return self.best_of(self.explored(hypotheses, case), case, count, rng)

    def explored(self, hypotheses: Iterable[Hypothesis], case: FrameCase) -> list[Candidate]:
        """Every hypothesis after a short search."""
        frame, hypotheses = self.frame(case), list(hypotheses)
        self._learn_flows(frame, hypotheses)
        return self.sharing.each(frame, FrameSearch.explore, hypotheses)

    def best_of(
        self, explored: Sequence[Candidate], case: FrameCase, count: int, rng: np.random.Generator | None = None
    ) -> Mixture:
        """The `count` best distinct modes, searched to convergence, as a mixture. rng: for weights by importance
        sampling (`ModeSearchSettings.weigh`), which count by volume without it."""
        frame = self.frame(case)
        kept = self._distinct(explored, count + self.settings.spare)
        refined = self.sharing.each(frame, FrameSearch.refine, kept)
        best = self._distinct(self._apart(refined), count)
        scores = np.array([r.score for r in best]) + self._log_volumes(frame, best, rng)
        return mixture_of(tuple(r.mode for r in best), scores)

    def screened(
        self, hypotheses: Sequence[Hypothesis], case: FrameCase, count: int, pictures: bool = True
    ) -> list[Hypothesis]:
        """The `count` hypotheses of lowest energy as they are, the pictures' included or not: many cheap looks before a
        few searches."""
        frame = self.frame(case)
        if pictures:
            scores = self.sharing.each(frame, FrameSearch.look, hypotheses)
        else:
            scores = [frame.look_at_keypoints(h) for h in hypotheses]  # sharing it would take longer
        return [hypotheses[k] for k in np.argsort(-np.array(scores), kind="stable")[:count]]

    def frame(self, case: FrameCase) -> FrameSearch:
        """The searches of a case; what they share is kept until the next one."""
        if self._frame is None or self._frame.case is not case:
            self._frame = FrameSearch(self.model, self.seeker, self.settings, case)
        return self._frame

    def _learn_flows(self, frame: FrameSearch, hypotheses: Sequence[Hypothesis]) -> None:
        """Flow of the surface from where each hypothesis' parent had it: many pasts at once, since their nodes see the
        same pixels, and known to all who search."""
        if frame.case.evidence is None:
            return
        new = {
            h.past: (h.q_previous, h.q_predicted)
            for h in hypotheses
            if h.q_previous is not None and h.past not in frame.flows
        }
        keys, hands = list(new), self.sharing.hands
        shares = [keys[k::hands] for k in range(hands) if keys[k::hands]]
        found = self.sharing.each(frame, FrameSearch.follow, [[new[key] for key in share] for share in shares])
        for share, followed in zip(shares, found, strict=True):
            self.sharing.everywhere(frame, FrameSearch.learn, dict(zip(share, followed, strict=True)))

    def _log_volumes(self, frame: FrameSearch, best: Sequence[Refined], rng: np.random.Generator | None) -> np.ndarray:
        """What each mode's weight gains by the probability around it, (K,); see `ModeSearchSettings.weigh`."""
        if self.settings.weigh == BY_HEIGHT:
            return np.zeros(len(best))
        if self.settings.weigh == BY_IMPORTANCE and rng is not None:
            modes = [frame.surroundings(r) for r in best]
            return importance_log_volumes(rng, self.body, modes, self.settings.weigh_samples)
        return np.array(self.sharing.each(frame, FrameSearch.log_volume, best))

    def _apart(self, refined: list[Refined]) -> list[Refined]:
        """Those whose parts could be kept apart; all of them if that is none."""
        return [r for r in refined if r.mode.penetration <= self.settings.contact.limit] or refined

    def _distinct(self, found: Sequence[Scored], count: int) -> list[Scored]:
        return best_distinct(found, lambda c: c.score, lambda c: c.landmarks, self._distance, count)
