"""Sources of the next frame's hypotheses: the kept modes, and proposals about them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.inference.mixture import Mixture
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.frame_search import FrameProblem
from estimator.search.from_examples import ExampleSearch, example_starts
from estimator.search.hypothesis import Hypothesis
from estimator.search.jumps.readings import AWAY, TOWARDS, has_both, trunk_readings
from estimator.search.mode_search import ModeSearch
from estimator.search.proposals import (
    CovarianceScaledProposal,
    LimbProposal,
    Proposal,
    SphericalProposal,
    WeakestDirections,
)

SHAPES = ("covariance", "spherical", "weakest")


class ProposalSettings(NamedTuple):
    """Settings of proposals, see `estimator.trackers.css.settings.CssSettings`."""

    shape: str
    scale: float
    tail: float
    forgetting: float
    transition: bool
    momentum: float
    jump_penalty: float
    limb_penalty: float
    example_penalty: float


class Proposals:
    """Draws hypotheses of one frame from the mixture of the frame before.

    Parameters
    ----------
    search: of the body. settings: see there. rng: of the frame. prior: the mixture of the frame before. case,
        observation: the frame.
    """

    def __init__(
        self,
        search: ModeSearch,
        limb: LimbProposal,
        settings: ProposalSettings,
        rng: np.random.Generator,
        prior: Mixture,
        case: FrameProblem,
        observation: Observation,
    ) -> None:
        self._search, self._limb, self._settings, self._rng = search, limb, settings, rng
        self._prior, self._case, self._observation = prior, case, observation
        self._camera = observation.only_camera
        names = [association.name for association in case.associations]
        # the association that continues each mode's; the first where the frame has not that of the parent
        self._own = [names.index(m.association) if m.association in names else 0 for m in prior.modes]
        step = settings.momentum * case.dt
        moves = settings.transition and bool(case.likelihood.cameras) and step > 0.0
        predicted = [search.body.integrate(m.q, step * m.velocity) if moves else None for m in prior.modes]
        self._previous = [self._previous_pose(m.q, q) for m, q in zip(prior.modes, predicted, strict=True)]

    def parent_poses(self) -> list[Hypothesis]:
        """Every parent where it was."""
        return [
            self._continued(i, m.q, self._own[i], self._origin(i, Family.KEPT)) for i, m in enumerate(self._prior.modes)
        ]

    def other_associations(self, count: int) -> list[Hypothesis]:
        """Parents in the other association of the keypoints, those that it fits best."""
        others = [
            self._continued(i, mode.q, k, self._origin(i, Family.ASSOCIATION))
            for i, mode in enumerate(self._prior.modes)
            for k in range(len(self._case.associations))
            if k != self._own[i]
        ]
        return self._search.screened(others, self._case, count, pictures=False)

    def samples(self, count: int) -> list[Hypothesis]:
        """Figure 6, steps 1 to 2.2."""
        parents = self._parents(count)
        hypotheses = []
        for i in np.unique(parents):
            proposal, origin = self._proposal(int(i)), self._origin(int(i), Family.SAMPLE)
            samples = [proposal.sample(self._rng) for _ in range(int(np.count_nonzero(parents == i)))]
            about = [self._continued(int(i), q, self._own[i], origin) for q in samples]
            hypotheses += [h._replace(relative_to_previous=True) for h in about]
        return hypotheses

    def kinematic_jumps(self, count: int) -> list[Hypothesis]:
        """Limbs and parts at their other depths; first the trunk of the best parent, where its other reading is not
        among the parents."""
        jumps, camera = self._search.jumps, self._camera
        if camera is None or not (jumps.limbs or jumps.parts):
            return []
        turned: list[Hypothesis] = []
        if count and self._search.settings.readings and self._one_reading(camera):
            turn = partial(jumps.trunk_turned, camera=camera)
            turned = self._jumped(np.zeros(1, int), self._settings.jump_penalty, Family.DEPTH_JUMP, turn)
        propose = partial(jumps.draw, self._rng, camera=camera)
        parents = self._parents(count - len(turned))
        return [*turned, *self._jumped(parents, self._settings.jump_penalty, Family.DEPTH_JUMP, propose)]

    def limbs(self, count: int, looks: int) -> list[Hypothesis]:
        """One limb elsewhere, the best of so many poses scored against the pictures."""
        propose = partial(self._limb.sample, self._rng)
        elsewhere = self._jumped(self._parents(looks), self._settings.limb_penalty, Family.LIMB_JUMP, propose)
        return self._search.screened(elsewhere, self._case, count)

    def limb_exchanges(self, count: int) -> list[Hypothesis]:
        """Two limbs in each other's places in the image."""
        if self._camera is None:
            return []
        propose = partial(self._search.jumps.exchange, self._rng, camera=self._camera)
        return self._jumped(self._parents(count), self._settings.limb_penalty, Family.LIMB_EXCHANGE, propose)

    def examples(self, count: int) -> list[Hypothesis]:
        """Starts from an index of examples: the best scored of those similar to the pictures, first searched without a
        past, then as jumps of the whole body from the best parent. Those with their back to the only camera are
        penalised, as in a first frame."""
        search, how = self._search, ExampleSearch()
        lookups = search.examples.lookup_without_prior(self._observation, how.neighbours)
        starts = example_starts(search.body, lookups, how.away)
        explored = search.explored(search.screened(starts, self._case, count), self._case)
        penalty = self._settings.example_penalty if self._settings.transition else 0.0
        best, hypotheses = int(np.argmax(self._prior.weights)), []
        for candidate in search.distinct(explored, count):
            origin = Origin(Family.EXAMPLE, self._previous_pose(candidate.q, None, self._prior.modes[best].q), penalty)
            h = self._continued(best, candidate.q, candidate.hypothesis.association, origin)
            hypotheses.append(h._replace(prior_score=h.prior_score + candidate.hypothesis.prior_score - penalty))
        return hypotheses

    def _parents(self, count: int) -> np.ndarray:
        return self._rng.choice(len(self._prior.modes), size=count, p=self._prior.weights)

    def _previous_pose(
        self, q: np.ndarray, q_predicted: np.ndarray | None, q_left: np.ndarray | None = None
    ) -> PreviousPose | None:
        """Previous pose of hypotheses that moved from a mode q (nq,)."""
        if self._settings.transition:
            return PreviousPose(q, q_predicted, q_left=q_left)
        # flow is a term of its own in the image likelihood (CSS section 3.1.2), where there is any
        return PreviousPose(q, None, False, q_left) if self._case.likelihood.cameras else None

    def _origin(self, i: int, family: Family) -> Origin:
        """Origin of hypotheses that moved from mode i."""
        return Origin(family, self._previous[i])

    def _continued(self, i: int, q: np.ndarray, association: int, origin: Origin) -> Hypothesis:
        """A hypothesis at q (nq,) with what its parent, mode i, hands on."""
        handed_on = self._settings.forgetting * float(self._prior.log_scores[i]) if self._settings.transition else 0.0
        return Hypothesis(q, association, origin, i, handed_on)

    def _proposal(self, i: int) -> Proposal:
        mode, s = self._prior.modes[i], self._settings
        if s.shape == "weakest":
            return WeakestDirections(self._search.body, mode.q, mode.covariance, radii=(s.scale, 2.0 * s.scale))
        kind = SphericalProposal if s.shape == "spherical" else CovarianceScaledProposal
        return kind(self._search.body, mode.q, mode.covariance, s.scale, s.tail or np.inf)

    def _one_reading(self, camera: Camera) -> bool:
        """Whether the best parent's trunk leads towards the camera or away from it, and no parent's the other way."""
        there = trunk_readings(self._search.body, np.array([m.q for m in self._prior.modes]), camera)
        return there[0] in (TOWARDS, AWAY) and not has_both(there)

    def _jumped(
        self, parents: np.ndarray, penalty: float, family: Family, propose: Callable[[np.ndarray], np.ndarray | None]
    ) -> list[Hypothesis]:
        """Hypotheses whose parents were wrong too: they have a flat penalty instead of the transition's, where
        there is one, and no flow leads to them from where the parent was."""
        flat_penalty = penalty if self._settings.transition else 0.0
        hypotheses = []
        for i in parents:
            q = propose(self._prior.modes[i].q)
            if q is None:
                continue
            origin = Origin(family, self._previous_pose(q, None, self._prior.modes[i].q), flat_penalty)
            h = self._continued(int(i), q, self._own[i], origin)
            hypotheses.append(h._replace(prior_score=h.prior_score - origin.penalty))
        return hypotheses
