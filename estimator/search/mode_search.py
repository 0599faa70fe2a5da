"""From hypotheses to modes: explore every start a little, keep the distinct best, refine those to convergence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from estimator.cost.image.evidence import Evidence, Past
from estimator.cost.model import CostModel
from estimator.cost.reprojection import Reprojection
from estimator.cost.term import Cost, Term
from estimator.filtering.merge import best_distinct, body_size
from estimator.filtering.mixture import Mixture, Mode, mixture_of
from estimator.imaging.observation import Observation
from estimator.search.contact import ContactSettings, separate
from estimator.search.covariance import mode_covariance
from estimator.search.flips import Flips
from estimator.search.seek import Found, Seeker, SeekSettings
from estimator.search.volumes import Surroundings, importance_log_volumes
from humanoid.clearance import Clearance
from humanoid.errors import InputError
from humanoid.landmarks import mirror_index

AS_DETECTED, EXCHANGED = "as_detected", "exchanged"
BY_HEIGHT, BY_VOLUME, BY_IMPORTANCE = WEIGHINGS = ("height", "volume", "importance")


@dataclass(frozen=True)
class ModeSearchSettings:
    """How modes are found.

    explore: search given to every start. follow: before it, on keypoints and flow alone, where there are pictures.
    refine: search given to those kept. spare: how many more than asked for are refined, since refined modes may
    coincide. settled: features of the pictures are assigned anew until a search moves no joint by more [rad or m].
    distinct: two modes differ if some landmark is further apart than this fraction of the body's size.
    exchange: also read every frame with left and right swapped (detectors do swap them).
    contact: what is done with modes whose parts overlap.
    weigh: what a mode's weight is: "height", its probability density (CSS Figure 6, step 3); "volume", its probability
    by the second-order model; "importance", the same by `weigh_samples` importance samples about each mode (CSS
    section 8). Raises InputError for another word.
    """

    explore: SeekSettings = field(default_factory=lambda: SeekSettings(max_iterations=8, decrease_tolerance=0.05))
    refine: SeekSettings = field(default_factory=SeekSettings)
    follow: SeekSettings = field(default_factory=lambda: SeekSettings(max_iterations=5, decrease_tolerance=0.1))
    spare: int = 3
    distinct: float = 0.03
    settled: float = 0.01
    exchange: bool = True
    contact: ContactSettings = field(default_factory=ContactSettings)
    weigh: str = BY_HEIGHT
    weigh_samples: int = 60

    def __post_init__(self) -> None:
        if self.weigh not in WEIGHINGS:
            raise InputError("search settings", f"weigh is {self.weigh!r}", remedy="one of " + ", ".join(WEIGHINGS))


class Reading(NamedTuple):
    """One association of the frame's keypoints with landmarks, its term and what choosing it costs."""

    name: str
    term: Reprojection
    penalty: float


class FrameCase(NamedTuple):
    """What the hypotheses of one frame are searched in: the readings of its keypoints, the seconds since the parents,
    and what the pictures say; their features are assigned anew to every hypothesis, several times during its search."""

    readings: Sequence[Reading]
    dt: float = 0.0
    evidence: Evidence | None = None


class Hypothesis(NamedTuple):
    """A start: configuration (nq,), index of the reading, parent mode (-1 none) and its log-score; if the change since
    the parent is to be paid for, the parent's configuration, and where its velocity takes it."""

    q: np.ndarray
    reading: int
    parent: int = -1
    prior_score: float = 0.0
    q_previous: np.ndarray | None = None
    q_predicted: np.ndarray | None = None


class Candidate(NamedTuple):
    """A hypothesis after a search. energy: with the price of its reading. score: log-weight, up to a constant."""

    found: Found
    base: Cost  # without the pictures' assigned features
    assigned: list[Term]
    hypothesis: Hypothesis
    energy: float
    penetration: float = 0.0  # known once refined

    @property
    def score(self) -> float:
        """Log-weight by the energy's height alone, with what the parent hands on."""
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
        hypotheses = list(hypotheses)
        flows = self._flows(hypotheses, case.evidence)
        costs: dict[tuple[int, bytes], Cost] = {}
        candidates = []
        for h in hypotheses:
            past, reading = _past(h), case.readings[h.reading]
            if (h.reading, past) not in costs:
                costs[h.reading, past] = self.model.cost(reading.term, h.q_previous, case.dt, flows.get(past, []))
            base = costs[h.reading, past]
            q = h.q if case.evidence is None else self._followed(h, base)
            found, assigned = self._seek(base, q, self.settings.explore, case.evidence)
            candidates.append(Candidate(found, base, assigned, h, found.quadratic.value + reading.penalty))
        return candidates

    def best_of(
        self, explored: Sequence[Candidate], case: FrameCase, count: int, rng: np.random.Generator | None = None
    ) -> Mixture:
        """The `count` best distinct modes, searched to convergence, as a mixture. rng: for weights by importance
        sampling (`ModeSearchSettings.weigh`), which count by volume without it."""
        kept = self._distinct(explored, count + self.settings.spare)
        refined = [self._refine(c, case) for c in kept]
        best = self._distinct(self._apart(refined), count)
        modes = tuple(self._mode(c, case) for c in best)
        scores = np.array([c.score for c in best]) + self._log_volumes(best, rng)
        return mixture_of(modes, scores)

    def screened(
        self, hypotheses: Sequence[Hypothesis], case: FrameCase, count: int, pictures: bool = True
    ) -> list[Hypothesis]:
        """The `count` hypotheses of lowest energy as they are, the pictures' included or not: many cheap looks before a
        few searches."""
        scores = []
        for h in hypotheses:
            posed, reading = self.body.at(h.q), case.readings[h.reading]
            assigned = case.evidence.assigned(posed) if pictures and case.evidence is not None else []
            cost = self.model.cost(reading.term, h.q_previous, case.dt, assigned)
            scores.append(h.prior_score - cost.of(posed).value - reading.penalty)
        return [hypotheses[k] for k in np.argsort(-np.array(scores), kind="stable")[:count]]

    def _log_volumes(self, best: Sequence[Candidate], rng: np.random.Generator | None) -> np.ndarray:
        """What each mode's weight gains by the probability around it, (K,); see `ModeSearchSettings.weigh`."""
        if self.settings.weigh == BY_HEIGHT or not best:
            return np.zeros(len(best))
        costs = [c.base.plus(c.assigned) for c in best]
        modes = [(cost.of(c.found.quadratic.posed), cost) for c, cost in zip(best, costs, strict=True)]
        if self.settings.weigh == BY_IMPORTANCE and rng is not None:
            return importance_log_volumes(rng, self.body, modes, self.settings.weigh_samples)
        return np.array([Surroundings(self.body, at).log_volume for at, _ in modes])

    def _followed(self, h: Hypothesis, base: Cost) -> np.ndarray:
        """Where keypoints and flow take a hypothesis that stays with its parent, (nq,): pictures are only looked at near
        it. It begins where the parent was or where its velocity has taken it, whichever these like better."""
        if h.q is not h.q_previous:
            return h.q
        start = h.q
        if h.q_predicted is not None and base.at(h.q_predicted).value < base.at(h.q).value:
            start = h.q_predicted
        return self.seeker.seek(base, start, self.settings.follow).q

    def _flows(self, hypotheses: Sequence[Hypothesis], evidence: Evidence | None) -> dict[bytes, list[Term]]:
        """Flow of the surface from where each hypothesis' parent had it, by `_past`; looked for also where the
        prediction puts it."""
        if evidence is None:
            return {}
        pasts: dict[bytes, Past] = {}
        for h in hypotheses:
            if h.q_previous is not None and _past(h) not in pasts:
                predicted = None if h.q_predicted is None else self.body.at(h.q_predicted)
                pasts[_past(h)] = Past(self.body.at(h.q_previous), predicted)
        return dict(zip(pasts, evidence.followed_each(list(pasts.values())), strict=True))

    def _seek(
        self, base: Cost, q: np.ndarray, settings: SeekSettings, evidence: Evidence | None
    ) -> tuple[Found, list[Term]]:
        """Search `base` and what the pictures say around q (nq,); the result and the features it was found with."""
        assigned = [] if evidence is None else evidence.assigned(self.body.at(q))
        return self.seeker.seek(base.plus(assigned), q, settings), assigned

    def _refine(self, c: Candidate, case: FrameCase) -> Candidate:
        found, assigned = self._settled(c, case.evidence)
        penetration = 0.0
        if self.clearance is not None:
            cost = c.base.plus(assigned)
            found = separate(self.seeker, self.clearance, cost, found, self.settings.contact)
            penetration = self.clearance.penetration(found.quadratic.posed)
        energy = found.quadratic.value + case.readings[c.hypothesis.reading].penalty
        return Candidate(found, c.base, assigned, c.hypothesis, energy, penetration)

    def _settled(self, c: Candidate, evidence: Evidence | None) -> tuple[Found, list[Term]]:
        """Search to convergence; features are assigned anew until that moves the pose no more, or `rounds` times."""
        q = c.found.q
        for _ in range(self.model.settings.image.rounds - 1 if evidence is not None else 0):
            found, _ = self._seek(c.base, q, self.settings.explore, evidence)
            moved = float(np.abs(self.body.difference(q, found.q)).max())
            q = found.q
            if moved < self.settings.settled:
                break
        return self._seek(c.base, q, self.settings.refine, evidence)

    def _apart(self, candidates: list[Candidate]) -> list[Candidate]:
        """Those whose parts could be kept apart; all of them if that is none."""
        return [c for c in candidates if c.penetration <= self.settings.contact.limit] or candidates

    def _distinct(self, candidates: Sequence[Candidate], count: int) -> list[Candidate]:
        return best_distinct(
            candidates,
            lambda c: c.score,
            lambda c: self.body.landmarks(c.found.quadratic.posed),
            self._distance,
            count,
        )

    def _mode(self, c: Candidate, case: FrameCase) -> Mode:
        reading = case.readings[c.hypothesis.reading]
        posed = c.found.quadratic.posed
        # what one frame and the priors know: sampling by it must not be narrowed by the temporal term (CSS footnote 5)
        static = self.model.cost(reading.term, image_terms=c.assigned).of(posed)
        before = c.hypothesis.q_previous
        return Mode(
            q=posed.q,
            velocity=np.zeros(self.body.nv)
            if before is None
            else self.body.difference(before, posed.q) / max(case.dt, 1e-3),
            covariance=mode_covariance(self.body, posed.q, c.found.quadratic.gradient, static.hessian),
            energy=c.energy,
            status=c.found.status,
            kkt_residual=c.found.kkt_residual,
            penetration=c.penetration,
            parent=c.hypothesis.parent,
            association=reading.name,
        )


def _past(h: Hypothesis) -> bytes:
    """What tells the pasts of hypotheses apart."""
    return b"" if h.q_previous is None else h.q_previous.tobytes()
