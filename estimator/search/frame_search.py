"""The searches of one frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.cost import Cost, QuadraticModel
from estimator.energy.descent.contact import separate
from estimator.energy.descent.seek import Seeker
from estimator.energy.descent.solution import Solution, StepCounts, mode_covariance
from estimator.energy.limb_targets import LimbPull, LimbTargets
from estimator.energy.term import Term
from estimator.inference.mixture import Mode
from estimator.inference.origin import Origin, PoseKey, PreviousPose
from estimator.search.cost_model import CostModel
from estimator.search.hypothesis import Association, Candidate, Hypothesis, Refined
from estimator.search.settings import ModeSearchSettings
from estimator.search.volumes import Surroundings
from estimator.vision.cues.base import PastPose
from estimator.vision.cues.image_likelihood import Followed, ImageLikelihood


class FrameProblem(NamedTuple):
    """The problem in which the hypotheses of one frame are searched: the associations of its keypoints, the seconds
    since the parents, and the image likelihood. Image features are assigned to each hypothesis separately, several
    times during its search. pulls: places that limbs are pulled to; a hypothesis has the index of the one it is
    searched under."""

    associations: Sequence[Association]
    dt: float = 0.0
    likelihood: ImageLikelihood = ImageLikelihood()
    pulls: Sequence[LimbPull] = ()

    @property
    def only_camera(self) -> Camera | None:
        """See `Observation`."""
        return self.associations[0].term.observation.only_camera


class FrameSearch:
    """One frame's searches; what they share is made once, and each gives the same bits whatever was searched before."""

    def __init__(self, model: CostModel, seeker: Seeker, settings: ModeSearchSettings, case: FrameProblem) -> None:
        self.case = case
        self.flows: dict[PoseKey, list[Followed]] = {}
        self._model, self._body, self._seeker, self._settings = model, model.body, seeker, settings
        self._bases: dict[tuple[int, int, bool, PoseKey | None], Cost] = {}
        self._statics: dict[int, Cost] = {}
        self._pulls: dict[int, list[Term]] = {}
        self._ties: dict[PoseKey, list[Term]] = {}
        self._warm_starts: dict[tuple[int, bool, PoseKey], Solution] = {}

    def follow(self, previous: Sequence[PreviousPose]) -> None:
        """Follow the flow of the surface in every camera since it lay at each previous pose, searched for also where it
        lies at the predicted one if that is known: of many poses at once, since their nodes see the same pixels."""
        new = {pose.key: pose for pose in previous if pose.key not in self.flows}
        if not new or not self.case.likelihood.cameras:
            return
        at = self._body.at
        pasts = [
            PastPose(at(p.q), *(None if q is None else at(q) for q in (p.q_predicted, p.q_left))) for p in new.values()
        ]
        self.flows.update(zip(new, self.case.likelihood.follow(pasts), strict=True))

    def score(self, h: Hypothesis) -> float:
        """Log-weight of an unsearched hypothesis, by all but the flow."""
        return self._score_assigned(h, self._assigned(h.q, brief=True))

    def score_keypoints(self, hypotheses: Sequence[Hypothesis]) -> list[float]:
        """Log-weights of unsearched hypotheses without pictures; all are placed at once."""
        if not hypotheses:
            return []
        energies, placed = np.empty(len(hypotheses)), self._body.placed(np.array([h.q for h in hypotheses]))
        for k, pull in sorted({(h.association, h.pull) for h in hypotheses}):
            own = np.array([(h.association, h.pull) == (k, pull) for h in hypotheses])
            cost = self._static(k).plus(self._pulled(pull))
            energies[own] = cost.values(placed.of(own))
        for n, h in enumerate(hypotheses):
            if h.origin.transition_from is not None:
                observed = self.case.associations[h.association].term
                for term in self._model.since(h.origin.transition_from, self.case.dt, observed):
                    energies[n] += term.values(placed.of(slice(n, n + 1)))[0]
        penalties = (self.case.associations[h.association].penalty for h in hypotheses)
        return [h.prior_score - float(e) - p for h, e, p in zip(hypotheses, energies, penalties, strict=True)]

    def explore(self, h: Hypothesis) -> Candidate:
        """A short search."""
        base = self._base(h)
        q, steps = self._followed(h) if self.case.likelihood.cameras else (h.q, StepCounts())
        solution = self._seeker.seek(base.plus(self._assigned(q, brief=True)), q, self._settings.explore)
        energy = solution.quadratic.value + self.case.associations[h.association].penalty
        landmarks = self._body.landmarks(solution.quadratic.posed)
        return Candidate(h, solution.q, landmarks, energy, steps.plus(solution.steps))

    def refine(self, c: Candidate) -> Refined:
        """A search to convergence, parts kept apart."""
        base, (model, settings) = self._base(c.hypothesis), (self._model, self._settings)
        q, q_assigned, assigned, steps = self._reassign_features(base, c.q)
        cost = base.plus(assigned)
        solution, penetration = self._seeker.seek(cost, q, settings.refine), 0.0
        if model.self_collision is not None:
            solution = separate(self._seeker, model.self_collision, cost, solution, settings.contact)
            penetration = model.self_collision.penetration(solution.quadratic.posed)
        mode = self._mode(c.hypothesis, solution, assigned, penetration, q_assigned)
        landmarks = self._body.landmarks(solution.quadratic.posed)
        return Refined(c.hypothesis, mode, landmarks, q_assigned, steps.plus(solution.steps))

    def log_volume(self, refined: Refined) -> float:
        """Log-volume of a mode, added to its weight, by the second-order model."""
        return Surroundings(self._body, self.surroundings(refined)[0]).log_volume

    def surroundings(self, refined: Refined) -> tuple[QuadraticModel, Cost]:
        """The energy that a mode is a minimum of, and its second-order model there."""
        cost = self._base(refined.hypothesis).plus(self._assigned(refined.q_assigned))
        return cost.at(refined.mode.q), cost

    def _base(self, h: Hypothesis) -> Cost:
        """The energy without the pictures' assigned features."""
        previous, transition_from = h.origin.previous, h.origin.transition_from
        pose = None if previous is None else previous.key
        key = h.association, h.pull, transition_from is not None, pose
        if key not in self._bases:
            self._bases[key] = self._with(h, [*self._flow(h), *self._pulled(h.pull)])
        return self._bases[key]

    def _pulled(self, pull: int) -> list[Term]:
        """Terms that pull the limbs of hypotheses under one of the case's pulls, none for -1."""
        if pull < 0:
            return []
        if pull not in self._pulls:
            self._pulls[pull] = [LimbTargets(self._body, self.case.pulls[pull])]
        return self._pulls[pull]

    def _flow(self, h: Hypothesis) -> list[Term]:
        """Image terms of the movement since a hypothesis' previous pose."""
        previous = h.origin.previous
        if previous is None or previous.key not in self.flows:
            return []
        if previous.key not in self._ties:
            self._ties[previous.key] = self.case.likelihood.terms_since(self.flows[previous.key])
        return self._ties[previous.key]

    def _assigned(self, q: np.ndarray, brief: bool = False) -> list[Term]:
        """Image terms around q (nq,); see `ImageLikelihood.assigned`."""
        likelihood = self.case.likelihood
        return likelihood.assigned(self._body.at(q), brief) if likelihood.cameras else []

    def _score_assigned(self, h: Hypothesis, assigned: Sequence[Term]) -> float:
        cost = self._with(h, [*assigned, *self._pulled(h.pull)])
        return h.prior_score - cost.value_at(h.q) - self.case.associations[h.association].penalty

    def _followed(self, h: Hypothesis) -> tuple[np.ndarray, StepCounts]:
        """The pose (nq,) to which keypoints and flow move a hypothesis, as pictures are only used near it, and the
        steps that took. A hypothesis that begins at its body's pose in the frame before starts from there; one about
        that pose moves along."""
        previous = h.origin.previous
        if previous is None or not (h.origin.family.at_previous or h.relative_to_previous):
            return h.q, StepCounts()
        key = h.association, h.origin.transition_from is not None, previous.key
        if key not in self._warm_starts:
            self._warm_starts[key] = self._warm_start(h, previous)
        warm = self._warm_starts[key]
        if h.origin.family.at_previous:
            return warm.q, warm.steps
        # the steps are the parent's, and counted where it is searched from
        return self._body.integrate(warm.q, self._body.difference(previous.q, h.q)), StepCounts()

    def _warm_start(self, h: Hypothesis, previous: PreviousPose) -> Solution:
        """Start from the pose in the frame before, or from that predicted by its velocity if keypoints and flow fit it
        better."""
        followed = self.flows.get(previous.key)
        flow = [] if followed is None else self.case.likelihood.leading(followed)
        cost = self._with(h, flow)
        start = previous.q
        if previous.q_predicted is not None and cost.value_at(previous.q_predicted) < cost.value_at(start):
            start = previous.q_predicted
        return self._seeker.seek(cost, start, self._settings.follow)

    def _reassign_features(self, base: Cost, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[Term], StepCounts]:
        """The start (nq,) of the last search, the image terms there, and the pose around which they are taken: they are
        assigned again until the pose no longer moves, or `rounds` times. Also the steps that took."""
        steps = StepCounts()
        for _ in range(self._model.cues.surface.rounds - 1 if self.case.likelihood.cameras else 0):
            before, assigned = q, self._assigned(q)
            solution = self._seeker.seek(base.plus(assigned), before, self._settings.explore)
            q, steps = solution.q, steps.plus(solution.steps)
            if float(np.abs(self._body.difference(before, q)).max()) < self._settings.reassign_tolerance:
                return q, before, assigned, steps
        return q, q, self._assigned(q), steps

    def _mode(
        self, h: Hypothesis, solution: Solution, assigned: Sequence[Term], penetration: float, q_assigned: np.ndarray
    ) -> Mode:
        association, dt, body = self.case.associations[h.association], self.case.dt, self._body
        posed, previous = solution.quadratic.posed, h.origin.previous
        # the pictures, flow included, and the priors (eq. 12); not the transition, which would narrow the samples of a
        # search that is static (CSS footnote 5)
        flow = self._flow(h) if self._settings.flow_in_covariance else []
        seen = [*flow, *assigned, *self._pulled(h.pull)]
        static = self._static(h.association).plus(seen).of(posed)
        return Mode(
            q=posed.q,
            velocity=np.zeros(body.nv) if previous is None else body.velocity(previous.q, posed.q, dt),
            covariance=mode_covariance(body, posed.q, solution.quadratic.gradient, static.hessian),
            energy=solution.quadratic.value + association.penalty,
            status=solution.status,
            kkt_residual=solution.kkt_residual,
            penetration=penetration,
            parent=h.parent,
            association=association.name,
            origin=self._origin(h, q_assigned),
        )

    def _with(self, h: Hypothesis, terms: Sequence[Term]) -> Cost:
        """The energy of a hypothesis with these terms, the transition included where it has one."""
        previous, observed = h.origin.transition_from, self.case.associations[h.association].term
        since = [] if previous is None else self._model.since(previous, self.case.dt, observed)
        return self._static(h.association).plus([*terms, *since])

    def _static(self, association: int) -> Cost:
        """The energy of a frame's keypoints by themselves, made once."""
        if association not in self._statics:
            self._statics[association] = self._model.cost(self.case.associations[association].term)
        return self._statics[association]

    def _origin(self, h: Hypothesis, q_assigned: np.ndarray) -> Origin:
        extent = self.case.likelihood.extents
        return h.origin._replace(q_assigned=q_assigned, extent=extent) if extent else h.origin
