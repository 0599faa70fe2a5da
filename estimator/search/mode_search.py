"""From hypotheses to modes: explore every start a little, keep the distinct best, refine those to convergence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from estimator.cost.model import CostModel
from estimator.cost.reprojection import Reprojection
from estimator.cost.term import Cost
from estimator.filtering.merge import best_distinct, body_size
from estimator.filtering.mixture import Mixture, Mode, mixture_of
from estimator.imaging.observation import Observation
from estimator.search.contact import ContactSettings, separate
from estimator.search.covariance import mode_covariance
from estimator.search.flips import Flips
from estimator.search.seek import Found, Seeker, SeekSettings
from humanoid.clearance import Clearance
from humanoid.landmarks import mirror_index

AS_DETECTED, EXCHANGED = "as_detected", "exchanged"


@dataclass(frozen=True)
class ModeSearchSettings:
    """How modes are found.

    explore: search given to every start. refine: search given to those kept. spare: how many more than asked for are
    refined, since refined modes may coincide. distinct: two modes differ if some landmark is further apart than this
    fraction of the body's size. exchange: also read every frame with left and right swapped (detectors do swap them).
    contact: what is done with modes whose parts overlap.
    """

    explore: SeekSettings = field(default_factory=lambda: SeekSettings(max_iterations=8, decrease_tolerance=0.05))
    refine: SeekSettings = field(default_factory=SeekSettings)
    spare: int = 3
    distinct: float = 0.03
    exchange: bool = True
    contact: ContactSettings = field(default_factory=ContactSettings)


class Reading(NamedTuple):
    """One association of the frame's keypoints with landmarks, its term and what choosing it costs."""

    name: str
    term: Reprojection
    penalty: float


class Hypothesis(NamedTuple):
    """A start: configuration (nq,), index of the reading, parent mode (-1 none) and its log-score, and, if the change
    since the parent is to be paid for, the parent's configuration."""

    q: np.ndarray
    reading: int
    parent: int = -1
    prior_score: float = 0.0
    q_previous: np.ndarray | None = None


class _Candidate(NamedTuple):
    found: Found
    cost: Cost
    hypothesis: Hypothesis
    energy: float
    penetration: float = 0.0  # known once refined

    @property
    def score(self) -> float:
        return self.hypothesis.prior_score - self.energy


class ModeSearch:
    """Finds the modes of frames of one body under one cost model."""

    def __init__(self, model: CostModel, settings: ModeSearchSettings | None = None) -> None:
        self.model = model
        self.body = model.body
        self.settings = settings or ModeSearchSettings()
        self.seeker = Seeker(self.body, self.settings.refine)
        self.clearance: Clearance | None = model.clearance
        self.mirror = mirror_index(self.body.landmark_names)
        self.flips = Flips(self.body)
        self._distance = self.settings.distinct * body_size(self.body)

    def read(self, observation: Observation, association: str) -> Observation:
        """A frame's keypoints as an association (see `Mode`) takes them."""
        return observation.exchanged(self.mirror) if association == EXCHANGED else observation

    def term(self, observation: Observation, association: str) -> Reprojection:
        """The keypoint term of a frame in one association."""
        return self.model.observation_term(self.read(observation, association))

    def readings(self, observation: Observation) -> tuple[Reading, ...]:
        """The readings of a frame: as detected, and with left and right exchanged where the body has sides."""
        found = [Reading(AS_DETECTED, self.term(observation, AS_DETECTED), 0.0)]
        if self.settings.exchange and np.any(self.mirror != np.arange(len(self.mirror))):
            penalty = self.model.settings.exchange_penalty
            found.append(Reading(EXCHANGED, self.term(observation, EXCHANGED), penalty))
        return tuple(found)

    def best_modes(
        self, hypotheses: Iterable[Hypothesis], readings: Sequence[Reading], count: int, dt: float = 0.0
    ) -> Mixture:
        """The `count` best distinct modes reached from the hypotheses, as a mixture; `dt` [s] since the parents."""
        explored = self._explore(hypotheses, readings, dt)
        kept = self._distinct(explored, count + self.settings.spare)
        refined = [self._refine(c, readings) for c in kept]
        best = self._distinct(self._apart(refined), count)
        modes = tuple(self._mode(c, readings) for c in best)
        return mixture_of(modes, np.array([c.score for c in best]))

    def _explore(self, hypotheses: Iterable[Hypothesis], readings: Sequence[Reading], dt: float) -> list[_Candidate]:
        costs: dict[tuple[int, bytes], Cost] = {}
        candidates = []
        for h in hypotheses:
            key = (h.reading, b"" if h.q_previous is None else h.q_previous.tobytes())
            if key not in costs:
                costs[key] = self.model.cost(readings[h.reading].term, h.q_previous, dt)
            found = self.seeker.seek(costs[key], h.q, self.settings.explore)
            candidates.append(self._candidate(found, costs[key], h, readings))
        return candidates

    def _refine(self, c: _Candidate, readings: Sequence[Reading]) -> _Candidate:
        found = self.seeker.seek(c.cost, c.found.q, self.settings.refine)
        if self.clearance is None:
            return self._candidate(found, c.cost, c.hypothesis, readings)
        found = separate(self.seeker, self.clearance, c.cost, found, self.settings.contact)
        depth = self.clearance.penetration(found.quadratic.posed)
        return self._candidate(found, c.cost, c.hypothesis, readings)._replace(penetration=depth)

    def _apart(self, candidates: list[_Candidate]) -> list[_Candidate]:
        """Those whose parts could be kept apart; all of them if that is none."""
        return [c for c in candidates if c.penetration <= self.settings.contact.limit] or candidates

    def _candidate(self, found: Found, cost: Cost, h: Hypothesis, readings: Sequence[Reading]) -> _Candidate:
        return _Candidate(found, cost, h, found.quadratic.value + readings[h.reading].penalty)

    def _distinct(self, candidates: Sequence[_Candidate], count: int) -> list[_Candidate]:
        return best_distinct(
            candidates,
            lambda c: c.score,
            lambda c: self.body.landmarks(c.found.quadratic.posed),
            self._distance,
            count,
        )

    def _mode(self, c: _Candidate, readings: Sequence[Reading]) -> Mode:
        reading = readings[c.hypothesis.reading]
        posed = c.found.quadratic.posed
        # what one frame and the priors know: sampling by it must not be narrowed by the temporal term (CSS footnote 5)
        static = self.model.cost(reading.term).of(posed)
        return Mode(
            q=posed.q,
            covariance=mode_covariance(self.body, posed.q, c.found.quadratic.gradient, static.hessian),
            energy=c.energy,
            status=c.found.status,
            kkt_residual=c.found.kkt_residual,
            penetration=c.penetration,
            parent=c.hypothesis.parent,
            association=reading.name,
        )
