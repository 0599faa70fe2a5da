"""A chain of poses by weighted samples, drawn part by part from where an image shows their features.

Likelihood sampling (Taycher and Darrell 2003; Taycher et al. 2004, section 4) as one chain of several: samples come
from messages about the features, by inverse kinematics, and from the past, and are weighted by past, features and
outlines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.pose_prior import PosePrior
from estimator.inference.annealing import effective_count, normalised, systematic
from estimator.inference.chains.exchange import Message, nothing_seen
from estimator.inference.chains.feature_density import FeatureDensity, uniform
from estimator.inference.clusters import clusters
from estimator.trackers.dual_chain.alternative import Alternative
from estimator.trackers.dual_chain.outline_values import OutlineLikelihood
from estimator.trackers.dual_chain.pose_draws import PartDraws
from estimator.trackers.dual_chain.pose_parts import PoseParts
from estimator.trackers.dual_chain.pose_target import GUIDED, Expected, PoseTarget, anywhere
from estimator.trackers.dual_chain.steps import Reach, TruncatedSteps
from estimator.trackers.dual_chain.walk import SampleBox, Tempered, TemperingSettings, tempered
from humanoid.kinematics.body import Body
from humanoid.support.settings import CheckedSettings, setting

_FEATURE_NOISE = 2.0  # px, of where a feature is in the image of a pose
_GROUPED = 1000  # samples that a density of features is made of, at most
_FEWEST = 8  # samples of a stratum
BY_PARTS, BY_PAST = "parts", "past"


@dataclass(frozen=True)
class PoseChainSettings(CheckedSettings):
    """Settings of the drawing of poses.

    particles: how many. draws: "parts", trunk and limbs one after the other from the past and the image, or "past",
    whole poses from the past alone, as in CONDENSATION. kernels: of the past, by which parts are weighted. by_past,
    by_image: shares of the parts that come from the past as it is, and from inverse kinematics; the others are
    Kalman-updated from the past by the features. groups: of samples from which the features are predicted.
    noise: of the dynamics, as a share of the energy's turn_speed and its like. far, wide: share of steps that are long,
    and how many times as long; of trunk and limbs each by itself. lost: rate [1/s] at which a limb gets lost and may be
    anywhere, 0 for never; renewed: share of the samples that search for limbs there, and of those that follow
    what was found (`PoseChain.update`).
    rest: shortest time [s] in which unobserved joints go two thirds of the way back to rest (`Rest`). tempering: how
    outlines are let in.
    Raises InputError where a value is outside its range.
    """

    particles: int = setting(2000, at_least=2)
    draws: str = setting(BY_PARTS, one_of=(BY_PARTS, BY_PAST))
    kernels: int = setting(100, at_least=1)
    by_past: float = setting(0.2, at_least=0, at_most=1)
    by_image: float = setting(0.2, at_least=0, at_most=1)
    groups: int = setting(3, at_least=1)
    noise: float = setting(0.45, above=0)
    far: float = setting(0.2, at_least=0, at_most=1)
    wide: float = setting(3.0, at_least=1)
    lost: float = setting(0.07, at_least=0)
    renewed: float = setting(0.2, above=0, below=0.5)
    rest: float = setting(0.5, above=0)
    tempering: TemperingSettings = field(default_factory=TemperingSettings)


@dataclass(frozen=True, eq=False)
class ParticleSet:
    """Poses of one frame: q (N, nq), weights (N,) that sum to one. reference (nq,): in whose tangent space they are
    moved. alternative: poses besides, None for none."""

    q: np.ndarray
    weights: np.ndarray
    reference: np.ndarray
    alternative: Alternative | None = None


class _Way(NamedTuple):
    """From which prediction poses come, and about which parts, by number, that is wrong, with where these may be
    instead; log_odds: to the particles' prediction being right about all. reported: in the chain's diagnostics."""

    log_odds: float
    prior: Expected
    elsewhere: Mapping[int, Reach] = {}
    reported: bool = False


@dataclass(frozen=True, eq=False)
class PoseChain:
    """One frame's chain of poses (`estimator.inference.chains.exchange.FeatureChain`).

    camera: of the features in messages. outlines: further image evidence of poses, None without any.
    past: whether samples also come from the past, as they must where the image does not show everything. Without, as in
    likelihood sampling, there are none where a feature is not detected. std (nv,): of the dynamics, for a step.
    pose_prior, if_hidden: see `PoseTarget`. diagnostics: filled with samples, effective_sample_size, powers, accepted.
    """

    rng: np.random.Generator
    parts: PoseParts
    camera: Camera
    outlines: OutlineLikelihood | None
    std: np.ndarray
    settings: PoseChainSettings
    past: bool = True
    pose_prior: PosePrior | None = None
    if_hidden: tuple[float, float] = (0.0, 0.0)
    diagnostics: dict[str, float] = field(default_factory=dict)

    @property
    def body(self) -> Body:
        """The body of the poses."""
        return self.parts.body

    def predict(self, state: ParticleSet, dt: float) -> Expected:
        """See `Chain`; the noise of `dt` is in `std` already."""
        s, other = self.settings, state.alternative
        count = s.particles if s.draws == BY_PAST else min(s.kernels, len(state.weights))
        expected = self._predicted(state, dt, count, s.particles)
        if s.lost > 0.0:
            # limbs get lost each by itself: the odds of a probability of 1 - exp(-lost dt)
            expected = replace(expected, log_odds_lost=s.lost * dt + float(np.log(-np.expm1(-s.lost * dt))))
        if other is None:
            return expected
        poses = ParticleSet(other.q, np.full(len(other.q), 1.0 / len(other.q)), state.reference)
        alternative = self._predicted(poses, dt, min(s.kernels, len(other.q)), len(other.q))
        return replace(expected, alternative=replace(alternative, log_odds=other.log_odds))

    def _predicted(self, state: ParticleSet, dt: float, kernels: int, samples: int) -> Expected:
        """The prediction of some poses by so many kernels."""
        s, body = self.settings, self.body
        lower, upper = body.tangent_bounds(state.reference)
        steps = TruncatedSteps(self.std, lower, upper, self.parts.dofs, s.far, s.wide)
        few = systematic(self.rng, state.weights, kernels)
        centres, even = body.differences(state.reference, state.q)[few], np.full(kernels, 1.0 / kernels)
        spread = self.std * np.sqrt(1.0 + s.far * (s.wide**2 - 1.0))
        centres = self.parts.rest.returned(centres, state.reference, spread, -np.expm1(-dt / s.rest))
        return Expected(
            state.reference, centres, even, steps, steps.moved(self.rng, centres[systematic(self.rng, even, samples)])
        )

    def features(self, prior: Expected) -> FeatureDensity:
        """See `Chain`: groups of the samples' features, each as a normal density."""
        target, names = self._target(prior, None), self.parts.features.names
        some = prior.samples[:: -(-len(prior.samples) // _GROUPED)]
        flat = target.pixels(target.prepared(some)).reshape(len(some), -1)
        flat = flat[np.isfinite(flat).all(axis=1)]
        if not len(flat):
            return uniform(names)
        radius = 2.0 * float(np.sqrt(flat.var(axis=0).max())) + _FEATURE_NOISE
        label = clusters(flat, np.full(len(flat), 1.0 / len(flat)), radius, self.settings.groups)
        log_weight, mean, covariance = [], [], []
        for k in range(int(label.max()) + 1):
            own = flat[label == k]
            off = own - own.mean(axis=0)
            log_weight.append(np.log(len(own) / len(flat)))
            mean.append(own.mean(axis=0))
            covariance.append(off.T @ off / len(own) + _FEATURE_NOISE**2 * np.eye(flat.shape[1]))
        known = np.ones((len(mean), len(names)), dtype=bool)
        return FeatureDensity(
            names, np.array(log_weight), known, np.array(mean).reshape(len(mean), -1, 2), np.array(covariance)
        )

    def update(self, prior: Expected, message: Message) -> tuple[ParticleSet, float]:
        """See `Chain`. Without any sample the past is predicted alone.

        The past may be wrong about limbs. So some samples draw one limb, or all, from where the image shows their ends
        or from rest, and the others from the past. They are a stratum of their own, weighted by its odds and its
        evidence: among the others a limb that was just found would be lost in resampling before outlines support it.
        One such proposal is tried in every frame, chosen at random, at the odds of all of them. What is found is
        followed beside the particles until the images of several frames have decided (`_divided`).
        """
        s = self.settings
        if s.draws == BY_PAST:
            return self._by_past(self._target(prior, message))
        self.diagnostics["samples"] = self.diagnostics["effective_sample_size"] = 0.0
        ways = self._ways(prior)
        few = max(int(s.renewed * s.particles), _FEWEST)
        counts = [max(s.particles - few * (len(ways) - 1), _FEWEST), *(few for _ in ways[1:])]
        strata = [self._stratum(message, way, count) for way, count in zip(ways, counts, strict=True)]
        log_evidences = [-np.inf if result is None else result.log_evidence for result in strata]
        log_shares, log_evidence = _log_shares(np.array([way.log_odds for way in ways]), np.array(log_evidences))
        if not np.isfinite(log_evidence):
            return self.without_samples(prior)
        self.diagnostics["renewed"] = float(np.exp(log_shares[1:]).sum())
        poses = [np.zeros((0, self.body.nv)) if result is None else result.x for result in strata]
        return self._divided(prior, poses, log_shares), log_evidence

    def _divided(self, prior: Expected, strata: Sequence[np.ndarray], log_shares: np.ndarray) -> ParticleSet:
        """The particles, of strata of tangents (N, nv) with shares (S,) of which the first has the past right.

        Whichever of it and all others has less than the share of a kernel would be lost among the particles by chance,
        and is followed beside them with the odds that it has.
        """
        s, others = self.settings, list(range(1, len(strata)))
        if not others:
            return self._even(prior, strata[0])
        right, elsewhere = log_shares[0], float(np.logaddexp.reduce(log_shares[1:]))
        less, more = sorted(((right, [0]), (elsewhere, others)))
        if np.exp(less[0]) * s.kernels >= 1.0:
            return self._even(prior, self._joined(strata, log_shares, [0, *others], s.particles))
        particles = self._even(prior, self._joined(strata, log_shares, more[1], s.particles))
        if not np.isfinite(less[0]):
            return particles
        few = self._joined(strata, log_shares, less[1], max(int(s.renewed * s.particles), _FEWEST))
        return replace(particles, alternative=Alternative(self._even(prior, few).q, less[0] - more[0]))

    def _joined(
        self, strata: Sequence[np.ndarray], log_shares: np.ndarray, some: Sequence[int], count: int
    ) -> np.ndarray:
        """So many even samples (count, nv) of some strata together, by their shares."""
        share = np.exp(log_shares[some] - log_shares[some].max())
        each = [
            np.full(len(strata[k]), w / max(len(strata[k]), 1)) for k, w in zip(some, share / share.sum(), strict=True)
        ]
        return np.vstack([strata[k] for k in some])[systematic(self.rng, np.concatenate(each), count)]

    def _ways(self, prior: Expected) -> list[_Way]:
        """That the past is right, another way, and the alternative."""
        right = _Way(0.0, prior, reported=True)
        if not self.past or not np.isfinite(prior.log_odds_lost):
            return [right]
        chosen, other = self._chosen(), anywhere(self.parts, prior)
        log_odds = float(np.log(len(self._wrong))) + len(chosen) * prior.log_odds_lost
        ways = [right, _Way(log_odds, prior, dict.fromkeys(chosen, other))]
        alternative = prior.alternative
        return ways if alternative is None else [*ways, _Way(alternative.log_odds, alternative)]

    @property
    def _wrong(self) -> tuple[tuple[int, ...], ...]:
        """The parts that the past may be wrong about: one limb, or all of them."""
        limbs = range(1, self.parts.count)
        return (*((part,) for part in limbs), *((tuple(limbs),) if len(limbs) > 1 else ()))

    def _chosen(self) -> tuple[int, ...]:
        """The limbs that this frame tries."""
        return self._wrong[self.rng.integers(len(self._wrong))]

    def _stratum(self, message: Message, way: _Way, count: int) -> Tempered | None:
        """Samples of the posterior with some parts elsewhere than where the past has them, and their evidence."""
        s, prior = self.settings, way.prior
        some = np.linspace(0, len(prior.samples) - 1, count).astype(np.int64)
        target = replace(self._target(prior, message), elsewhere=way.elsewhere)
        partial = PartDraws(self.rng, target, self.past, s.by_past, s.by_image).all_parts(prior.samples[some])
        if partial is None:
            return None
        # parts were chosen by the message about each alone: in the end they are weighted by that about all
        log_message = target.log_message(target.prepared(partial.x))
        possible = np.isfinite(log_message)
        log_weight = np.where(possible, log_message - partial.log_message, -np.inf)
        least_power = GUIDED if way.elsewhere and self.outlines else 0.0
        box = SampleBox(self.parts.dofs, prior.steps.std, prior.steps.lower, prior.steps.upper)
        result = tempered(self.rng, partial.x, log_weight, target, box, s.tempering, least_power)
        if result is None:
            return None
        if way.reported:
            self.diagnostics["samples"], self.diagnostics["effective_sample_size"] = (
                float(possible.sum()),
                result.effective,
            )
            self.diagnostics["powers"], self.diagnostics["accepted"] = float(result.powers), result.accepted
        return result._replace(log_evidence=result.log_evidence + partial.log_evidence)

    def without_samples(self, prior: Expected) -> tuple[ParticleSet, float]:
        """The prediction, for images that show nothing from which a pose could be drawn."""
        self.diagnostics["samples"], self.diagnostics["effective_sample_size"] = 0.0, 0.0
        particles, other = self._even(prior, prior.samples), prior.alternative
        if other is not None:
            alternative = Alternative(self._even(other, other.samples).q, other.log_odds)
            particles = replace(particles, alternative=alternative)
        return particles, -np.inf

    def _by_past(self, target: PoseTarget) -> tuple[ParticleSet, float]:
        """Whole poses of the past, selected by features and outlines (Isard and Blake 1998)."""
        x = target.prior.samples
        placed = target.prepared(x)
        log_weight = target.log_message(placed) + target.likelihood(placed)
        if not np.isfinite(log_weight).any():
            return self.without_samples(target.prior)
        weights, log_mean = normalised(log_weight)
        self.diagnostics["samples"] = float(np.isfinite(log_weight).sum())
        self.diagnostics["effective_sample_size"] = effective_count(weights)
        return self._even(target.prior, x[systematic(self.rng, weights, len(x))]), log_mean

    def _target(self, prior: Expected, message: Message | None) -> PoseTarget:
        received = nothing_seen(self.parts.features.names) if message is None else message
        return PoseTarget(
            self.parts,
            self.camera,
            self.outlines,
            prior,
            received,
            pose_prior=self.pose_prior,
            if_hidden=self.if_hidden,
        )

    def _even(self, prior: Expected, x: np.ndarray) -> ParticleSet:
        """Poses at tangents x (N, nv), each as likely as the others."""
        q = self.body.integrated(np.tile(prior.reference, (len(x), 1)), x)
        return ParticleSet(q, np.full(len(q), 1.0 / len(q)), prior.reference)


def _log_shares(log_odds: np.ndarray, log_evidence: np.ndarray) -> tuple[np.ndarray, float]:
    """Logarithms (S,) of the posterior shares of strata with prior odds (S,) by their evidence, -inf where they have
    none; and of the evidence of all, -inf where no stratum has any."""
    each = log_odds - np.logaddexp.reduce(log_odds) + log_evidence
    total = float(np.logaddexp.reduce(each))
    return (each - total if np.isfinite(total) else each), total
