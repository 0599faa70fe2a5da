"""Poses drawn part by part: trunks first, then each limb, from the past and the image.

Given trunk, head and neck the limbs are independent (Taycher et al. 2004, section 4), so each is drawn and weighted by
its own evidence alone. Weights of joint draws collapse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.inference.annealing import normalised, systematic
from estimator.trackers.dual_chain.kalman_steps import KalmanSteps, Length, kalman_steps
from estimator.trackers.dual_chain.limb_ik import ImageProposal
from estimator.trackers.dual_chain.pose_target import BY_IMAGE, GUIDED, TRIES, PoseTarget
from estimator.trackers.dual_chain.steps import TruncatedSteps

_WAYS = 6  # to see the features of a part, that update it
_WIDER = 1.3  # are Kalman-updated steps, which are linear, than those of the past
_BY_PAST, _UPDATED, _BY_IMAGE = range(3)


@dataclass(frozen=True, eq=False)
class PartialSamples:
    """Even samples of some parts: tangents x (N, nv), and log_message (N,), the sum of the log-likelihoods by which
    each was chosen: the message about its features alone and, for some parts, the outlines. log_evidence: logarithm of
    the mean of that under what was expected."""

    x: np.ndarray
    log_message: np.ndarray
    log_evidence: float = 0.0


@dataclass(frozen=True, eq=False)
class PartDraws:
    """Draws of the parts of one frame.

    past: whether they also come from the past. by_past, by_image: shares of draws from the past, and from inverse
    kinematics of the end of a limb; all others are steps from the past, Kalman-updated by the features.
    """

    rng: np.random.Generator
    target: PoseTarget
    past: bool
    by_past: float
    by_image: float

    def all_parts(self, x: np.ndarray) -> PartialSamples | None:
        """As many poses as there are at tangents x (N, nv), with every part drawn in turn; None where the image shows
        nothing from which one can be drawn."""
        partial: PartialSamples | None = PartialSamples(x, np.zeros(len(x)))
        for part in range(self.target.parts.count):
            partial = None if partial is None else self._with_part(partial, part)
        return partial

    def _with_part(self, partial: PartialSamples, part: int) -> PartialSamples | None:
        """The same poses with one more part. Each comes from its own kernel of the past, an auxiliary variable, so that
        its weight is by that alone; likelihood sampling, which uses no kernels, is weighted by all of them."""
        target, group = self.target, self.target.parts.dofs[part]
        elsewhere, count = part in target.elsewhere, len(partial.x)
        x, before = (np.repeat(each, TRIES if elsewhere else 1, axis=0) for each in (partial.x, partial.log_message))
        reach = target.past_of(part)
        kernel = self.rng.choice(len(reach.centres), size=len(x), p=reach.weights)
        steps, centres = reach.steps, reach.centres[kernel]
        proposal = self._seen_end(part)
        if not self.past and part > 0 and proposal is None:
            return None
        updated, shares = (
            self._kalman_updated(x, steps, centres, kernel, part),
            self._shares(part, proposal is not None),
        )
        x, ok = self._sampled(x, steps, centres, group, updated, proposal, shares)
        placed = target.prepared(x)
        own = reach.log_density_each(x, kernel, part)
        with np.errstate(divide="ignore"):
            log_shares = np.log(shares)
        log_q = np.logaddexp(
            own + log_shares[_BY_PAST], updated.log_density(x[:, None, group])[:, 0] + log_shares[_UPDATED]
        )
        if proposal is not None:
            angles = x[:, group] + target.prior.reference[proposal.ik.entries]
            log_q = np.logaddexp(log_q, proposal.log_density(angles, placed) + log_shares[_BY_IMAGE])
        past = own if self.past else target.of_group(x, part)
        log_message = target.evidence(placed, target.parts.of_part[part])
        if elsewhere:
            log_message = log_message + GUIDED * target.outlines_of(part, placed)
        ok &= np.isfinite(log_q) & np.isfinite(log_message)
        if not ok.any():
            return None
        log_weight = np.full(len(x), -np.inf)
        log_weight[ok] = (past + log_message - log_q)[ok]
        weights, log_mean = normalised(log_weight)
        kept = systematic(self.rng, weights, count)
        return PartialSamples(x[kept], before[kept] + log_message[kept], partial.log_evidence + log_mean)

    def _sampled(
        self, x: np.ndarray, steps: TruncatedSteps, centres: np.ndarray, group: np.ndarray, updated: KalmanSteps,
        proposal: ImageProposal | None, shares: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Tangents (N, nv) with a group redrawn inside the limits, and which were redrawn, (N,) bool."""
        x, ok = x.copy(), np.ones(len(x), dtype=bool)
        way = self.rng.choice(3, size=len(x), p=shares)
        by_past, is_updated, by_image = (way == w for w in (_BY_PAST, _UPDATED, _BY_IMAGE))
        x[np.ix_(by_past, group)] = steps.moved_group(self.rng, centres[by_past], group)
        x[np.ix_(is_updated, group)] = updated.sample(self.rng, 1)[is_updated, 0]
        if proposal is not None:
            limbs = proposal.sample(self.rng, self.target.prepared(x[by_image]))
            x[np.ix_(by_image, group)] = limbs.angles - self.target.prior.reference[proposal.ik.entries]
            ok[by_image] = limbs.ok
        lower, upper = steps.lower[group], steps.upper[group]
        ok &= ((x[:, group] >= lower) & (x[:, group] <= upper)).all(axis=1)
        x[:, group] = np.clip(x[:, group], lower, upper)
        return x, ok

    def _shares(self, part: int, seen: bool) -> np.ndarray:
        """Shares (3,) of draws by the past, Kalman-updated and by the image."""
        if not self.past:
            return np.array([0.0, 1.0, 0.0]) if part == 0 else np.array([0.0, 0.0, 1.0])
        by_image = (BY_IMAGE if part in self.target.elsewhere else self.by_image) if seen else 0.0
        by_past = min(self.by_past, 1.0 - by_image)
        return np.array([by_past, max(1.0 - by_past - by_image, 0.0), by_image])

    def _kalman_updated(
        self, x: np.ndarray, steps: TruncatedSteps, centres: np.ndarray, kernel: np.ndarray, part: int
    ) -> KalmanSteps:
        """The place of a part by the features that it moves, on each of the poses x (N, nv): from its centre (N, nv),
        that of a kernel (N,), or from rest where the past is uninformative."""
        target, parts = self.target, self.target.parts
        group, moved = parts.dofs[part], parts.of_part[part]
        names = [parts.features.names[f] for f in moved]
        received = self.target.message.guide.over(parts.features.names).marginal(names).merged().reduced(_WAYS)
        centres, std = centres[:, group], _WIDER * steps.std[group]
        lengths = [Length(1.0 - steps.share, std), Length(steps.share, steps.wide * std)]
        if not self.past:
            rest, spread = parts.rest.guess(target.body, target.prior.reference)
            centres, lengths = np.tile(rest[group], (len(x), 1)), [Length(1.0, spread[group])]
        at = x.copy()
        at[:, group] = centres
        rows = np.arange(len(x))
        if part == 0:  # nothing else moves what the trunk has: one for each kernel
            _, first, rows = np.unique(
                kernel if self.past else np.zeros(len(x)), return_index=True, return_inverse=True
            )
            at, centres = at[first], centres[first]
        predicted, jacobian = parts.features.in_image(target.body, target.at(at), target.camera, moved)
        lengths = [length for length in lengths if length.share > 0.0]
        return kalman_steps(centres, lengths, received, predicted, jacobian[..., group]).of(rows)

    def _seen_end(self, part: int) -> ImageProposal | None:
        """Where the image may show the end of a limb; None for the trunk, and where it is unknown."""
        if part == 0:
            return None
        parts = self.target.parts
        name = parts.features.names[int(parts.of_part[part][-1])]
        received = self.target.message.guide.over(parts.features.names).marginal([name]).merged()
        seen = np.flatnonzero(received.known[:, 0])
        if not len(seen):
            return None
        return ImageProposal(parts.ik[part - 1], self.target.camera, received.of(seen))
