"""Where the next frame's hypotheses come from: the kept modes, and proposals about them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from estimator.imaging.observation import Observation
from estimator.modes import origin
from estimator.modes.mixture import Mixture
from estimator.search.jumps import only_camera
from estimator.search.mode_search import FrameCase, Hypothesis, ModeSearch
from estimator.search.proposals import (
    CovarianceScaledProposal,
    LimbProposal,
    Proposal,
    SphericalProposal,
    WeakestDirections,
)

SHAPES = ("covariance", "spherical", "weakest")


class ProposalSettings(NamedTuple):
    """How proposals are made, see `estimator.trackers.css.CssSettings`."""

    shape: str
    scale: float
    tail: float
    forgetting: float
    transition: bool
    momentum: float
    jump_penalty: float
    limb_penalty: float


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
        case: FrameCase,
        observation: Observation,
    ) -> None:
        self._search, self._limb, self._settings, self._rng = search, limb, settings, rng
        self._prior, self._case = prior, case
        self._camera = only_camera(observation)
        names = [r.name for r in case.readings]
        # the reading that continues each mode's; the first where the frame has not that of the parent
        self._own = [names.index(m.association) if m.association in names else 0 for m in prior.modes]
        step = settings.momentum * case.dt
        moves = settings.transition and case.evidence is not None and step > 0.0
        self._predicted = [search.body.integrate(m.q, step * m.velocity) if moves else None for m in prior.modes]

    def kept(self) -> list[Hypothesis]:
        """Every parent where it was."""
        return [self._hypothesis(i, m.q, self._own[i], origin.PARENT) for i, m in enumerate(self._prior.modes)]

    def other_readings(self, count: int) -> list[Hypothesis]:
        """Parents in the other reading of the keypoints, those that it fits best."""
        modes = range(len(self._prior.modes))
        others = [
            self._hypothesis(i, self._prior.modes[i].q, r, origin.READING)
            for i in modes
            for r in range(len(self._case.readings))
            if r != self._own[i]
        ]
        return self._search.screened(others, self._case, count, pictures=False)

    def samples(self, count: int) -> list[Hypothesis]:
        """Figure 6, steps 1 to 2.2."""
        drawn = self._parents(count)
        found = []
        for i in np.unique(drawn):
            proposal = self._proposal(int(i))
            many = int(np.count_nonzero(drawn == i))
            drawings = [proposal.sample(self._rng) for _ in range(many)]
            found += [self._hypothesis(int(i), q, self._own[i], origin.SAMPLE) for q in drawings]
        return found

    def flips(self, count: int) -> list[Hypothesis]:
        """Kinematic jumps: limbs and parts at their other depths."""
        flips = self._search.flips
        if self._camera is None or not (flips.limbs or flips.parts):
            return []
        propose = partial(flips.draw, self._rng, camera=self._camera)
        return self._jumps(count, self._settings.jump_penalty, origin.JUMP, propose)

    def limbs(self, count: int, looks: int) -> list[Hypothesis]:
        """One limb elsewhere, the best of so many looks at the pictures."""
        propose = partial(self._limb.sample, self._rng)
        jumps = self._jumps(looks, self._settings.limb_penalty, origin.LIMB, propose)
        return self._search.screened(jumps, self._case, count)

    def exchanges(self, count: int) -> list[Hypothesis]:
        """Two limbs in each other's places in the image."""
        if self._camera is None:
            return []
        propose = partial(self._search.flips.exchange, self._rng, camera=self._camera)
        return self._jumps(count, self._settings.limb_penalty, origin.LIMBS, propose)

    def _parents(self, count: int) -> np.ndarray:
        return self._rng.choice(len(self._prior.modes), size=count, p=self._prior.weights)

    def _hypothesis(self, i: int, q: np.ndarray, reading: int, family: str) -> Hypothesis:
        if not self._settings.transition:  # flow is evidence of its own (CSS section 3.1.2), where there is any
            before = self._prior.modes[i].q if self._case.evidence is not None else None
            return Hypothesis(q, reading, i, 0.0, before, None, pays=False, family=family)
        score = self._settings.forgetting * float(self._prior.log_scores[i])
        return Hypothesis(q, reading, i, score, self._prior.modes[i].q, self._predicted[i], family=family)

    def _proposal(self, i: int) -> Proposal:
        mode, s = self._prior.modes[i], self._settings
        if s.shape == "weakest":
            return WeakestDirections(self._search.body, mode.q, mode.covariance, radii=(s.scale, 2.0 * s.scale))
        kind = SphericalProposal if s.shape == "spherical" else CovarianceScaledProposal
        return kind(self._search.body, mode.q, mode.covariance, s.scale, s.tail or np.inf)

    def _jumps(
        self, count: int, penalty: float, family: str, propose: Callable[[np.ndarray], np.ndarray | None]
    ) -> list[Hypothesis]:
        """Hypotheses whose parents were wrong too: they pay a flat price instead of the transition's, where that is
        paid, and no flow leads to them from where the parent was."""
        price = penalty if self._settings.transition else 0.0
        found = []
        for i in self._parents(count):
            q = propose(self._prior.modes[i].q)
            if q is None:
                continue
            h = self._hypothesis(int(i), q, self._own[i], family)
            if h.q_previous is not None:
                h = h._replace(prior_score=h.prior_score - price, q_previous=q, q_predicted=None, price=price)
            found.append(h)
        return found
