"""The pieces of work on one frame. None depends on another, so several processes can share them; what comes out is
small, and all that the next piece needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from estimator.cost.model import CostModel
from estimator.cues.evidence import Evidence, Followed, Past
from estimator.modes.mixture import Mode
from estimator.modes.origin import START, Origin
from estimator.optimise.contact import separate
from estimator.optimise.covariance import mode_covariance
from estimator.optimise.seek import Seeker, SeekSettings
from estimator.optimise.solution import Solution
from estimator.search.settings import ModeSearchSettings
from estimator.search.volumes import Surroundings
from estimator.terms.reprojection import Reprojection
from estimator.terms.term import Cost, QuadraticModel, Term


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
    """A start: configuration (nq,), index of the reading, parent mode (-1 none) and its log-score; where the body was
    before, from where flow is followed, and where its velocity takes it, None where that is not to count; whether the
    change since then is paid for; the flat price that the log-score has paid instead; its family, see `Origin`."""

    q: np.ndarray
    reading: int
    parent: int = -1
    prior_score: float = 0.0
    q_previous: np.ndarray | None = None
    q_predicted: np.ndarray | None = None
    pays: bool = True
    price: float = 0.0
    family: str = START

    @property
    def q_paid(self) -> np.ndarray | None:
        """The configuration (nq,) from which the change is paid for."""
        return self.q_previous if self.pays else None

    @property
    def past(self) -> PastKey:
        """What tells the pasts of hypotheses apart."""
        return tuple(b"" if q is None else q.tobytes() for q in (self.q_previous, self.q_predicted))


PastKey = tuple[bytes, ...]


class Candidate(NamedTuple):
    """A hypothesis after a short search: configuration (nq,), landmarks (L, 3) [m], energy with the price of its
    reading."""

    hypothesis: Hypothesis
    q: np.ndarray
    landmarks: np.ndarray
    energy: float

    @property
    def score(self) -> float:
        """Log-weight by the energy's height alone, with what the parent hands on, up to a constant."""
        return self.hypothesis.prior_score - self.energy


class Refined(NamedTuple):
    """A hypothesis searched to convergence. landmarks (L, 3) [m]: the mode's. q_assigned (nq,): the pose at which the
    pictures' features were assigned last."""

    hypothesis: Hypothesis
    mode: Mode
    landmarks: np.ndarray
    q_assigned: np.ndarray

    @property
    def score(self) -> float:
        """See `Candidate.score`."""
        return self.hypothesis.prior_score - self.mode.energy


class FrameSearch:
    """One frame's searches: every method that is a piece of work takes one thing and returns one, and gives the same
    bits whatever was done before."""

    def __init__(self, model: CostModel, seeker: Seeker, settings: ModeSearchSettings, case: FrameCase) -> None:
        self.case = case
        self.flows: dict[PastKey, list[Followed]] = {}
        self._model, self._body, self._seeker, self._settings = model, model.body, seeker, settings
        self._bases: dict[tuple[int, bool, PastKey], Cost] = {}

    def follow(self, pasts: Sequence[tuple[np.ndarray, np.ndarray | None]]) -> list[list[Followed]]:
        """Work: the flow of the surface in every camera since it lay at a q_previous (nq,), looked for also where it
        lies at q_predicted (nq,) if that is known."""
        assert self.case.evidence is not None
        at = self._body.at
        return self.case.evidence.follow([Past(at(q), None if ahead is None else at(ahead)) for q, ahead in pasts])

    def learn(self, followed: Mapping[PastKey, list[Followed]]) -> None:
        """Take over what `follow` found, wherever that was."""
        self.flows.update(followed)

    def look(self, h: Hypothesis) -> float:
        """Work: log-weight of a hypothesis as it is, by all but the flow."""
        return self._looked(h, self._assigned(h.q))

    def look_at_keypoints(self, h: Hypothesis) -> float:
        """Log-weight of a hypothesis as it is, pictures left out."""
        return self._looked(h, [])

    def explore(self, h: Hypothesis) -> Candidate:
        """Work: a short search."""
        base = self._base(h)
        q = h.q if self.case.evidence is None else self._followed(h, base)
        found = self._seeker.seek(base.plus(self._assigned(q)), q, self._settings.explore)
        energy = found.quadratic.value + self.case.readings[h.reading].penalty
        return Candidate(h, found.q, self._body.landmarks(found.quadratic.posed), energy)

    def refine(self, c: Candidate) -> Refined:
        """Work: a search to convergence, parts kept apart."""
        base, (model, settings) = self._base(c.hypothesis), (self._model, self._settings)
        q = self._settled(base, c.q)
        assigned = self._assigned(q)
        cost = base.plus(assigned)
        found, penetration = self._seeker.seek(cost, q, settings.refine), 0.0
        if model.clearance is not None:
            found = separate(self._seeker, model.clearance, cost, found, settings.contact)
            penetration = model.clearance.penetration(found.quadratic.posed)
        mode = self._mode(c.hypothesis, found, assigned, penetration, q)
        return Refined(c.hypothesis, mode, self._body.landmarks(found.quadratic.posed), q)

    def log_volume(self, refined: Refined) -> float:
        """Work: what a mode's weight gains by the probability around it, by the second-order model."""
        return Surroundings(self._body, self.surroundings(refined)[0]).log_volume

    def surroundings(self, refined: Refined) -> tuple[QuadraticModel, Cost]:
        """The energy that a mode is a minimum of, and its second-order model there."""
        cost = self._base(refined.hypothesis).plus(self._assigned(refined.q_assigned))
        return cost.at(refined.mode.q), cost

    def _base(self, h: Hypothesis) -> Cost:
        """The energy without the pictures' assigned features."""
        key = h.reading, h.pays, h.past
        if key not in self._bases:
            term, followed, evidence = self.case.readings[h.reading].term, self.flows.get(h.past), self.case.evidence
            flow = [] if followed is None or evidence is None else evidence.flow_terms(followed)
            self._bases[key] = self._model.cost(term, h.q_paid, self.case.dt, flow)
        return self._bases[key]

    def _assigned(self, q: np.ndarray) -> list[Term]:
        """What the pictures say around q (nq,)."""
        return [] if self.case.evidence is None else self.case.evidence.assigned(self._body.at(q))

    def _looked(self, h: Hypothesis, assigned: Sequence[Term]) -> float:
        reading = self.case.readings[h.reading]
        cost = self._model.cost(reading.term, h.q_paid, self.case.dt, assigned)
        return h.prior_score - cost.at(h.q).value - reading.penalty

    def _followed(self, h: Hypothesis, base: Cost) -> np.ndarray:
        """Where keypoints and flow take a hypothesis that stays with its parent, (nq,): pictures are only looked at
        near it. It begins where the parent was or where its velocity has taken it, whichever these like better."""
        if h.q_previous is None or not np.array_equal(h.q, h.q_previous):
            return h.q
        start = h.q
        if h.q_predicted is not None and base.at(h.q_predicted).value < base.at(h.q).value:
            start = h.q_predicted
        return self._seeker.seek(base, start, self._settings.follow).q

    def _settled(self, base: Cost, q: np.ndarray) -> np.ndarray:
        """Where the last search begins, (nq,): features are assigned anew until that moves the pose no more, or
        `rounds` times."""
        for _ in range(self._model.settings.image.rounds - 1 if self.case.evidence is not None else 0):
            before, explore = q, self._settings.explore
            q = self._seek(base, before, explore).q
            if float(np.abs(self._body.difference(before, q)).max()) < self._settings.settled:
                break
        return q

    def _seek(self, base: Cost, q: np.ndarray, settings: SeekSettings) -> Solution:
        """Search `base` and what the pictures say around q (nq,)."""
        return self._seeker.seek(base.plus(self._assigned(q)), q, settings)

    def _mode(
        self, h: Hypothesis, found: Solution, assigned: Sequence[Term], penetration: float, q_assigned: np.ndarray
    ) -> Mode:
        reading, dt, body = self.case.readings[h.reading], self.case.dt, self._body
        posed, before = found.quadratic.posed, h.q_previous
        # what one frame and the priors know: sampling by it must not be narrowed by the temporal term (CSS footnote 5)
        static = self._model.cost(reading.term, image_terms=assigned).of(posed)
        return Mode(
            q=posed.q,
            velocity=np.zeros(body.nv) if before is None else body.difference(before, posed.q) / max(dt, 1e-3),
            covariance=mode_covariance(body, posed.q, found.quadratic.gradient, static.hessian),
            energy=found.quadratic.value + reading.penalty,
            status=found.status,
            kkt_residual=found.kkt_residual,
            penetration=penetration,
            parent=h.parent,
            association=reading.name,
            origin=self._origin(h, q_assigned),
        )

    def _origin(self, h: Hypothesis, q_assigned: np.ndarray) -> Origin:
        paid, evidence = h.q_paid is not None, self.case.evidence
        if evidence is None:
            return Origin(h.family, h.q_previous, paid, h.price)
        extent = tuple(camera.extent for camera in evidence.cameras)
        return Origin(h.family, h.q_previous, paid, h.price, h.q_predicted, q_assigned, extent)
