"""A chain of poses by weighted samples, drawn part by part from where an image shows their features.

Likelihood sampling (Taycher and Darrell 2003; Taycher et al. 2004, section 4) as one chain of several: samples come
from what is told of the features, by inverse kinematics, and from the past, and are weighed by past, features and
outlines.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimator.cameras.camera import Camera
from estimator.inference.chains.exchange import Message
from estimator.inference.chains.feature_density import FeatureDensity, uniform
from estimator.inference.clusters import clusters
from estimator.inference.particles import effective_count, normalised, systematic
from estimator.inference.steps import Steps
from estimator.likelihood.outline_values import OutlineLikelihood
from estimator.search.pose_parts import PoseParts
from estimator.search.proposals.limb_ik import ImageProposal
from estimator.search.trunk_kernels import NormalMixture, led_kernels
from humanoid.kinematics.body import Body, PlacedBodies
from humanoid.support.settings import check, setting

_FEATURE_NOISE = 2.0  # px, of where a feature is in the image of a pose
_DIFFERENCE = 1e-5  # rad or m
_LED = 32  # trunks of the past that are led to what is seen


@dataclass(frozen=True)
class PoseChainSettings:
    """How poses are drawn.

    particles: how many. draws: of each limb for each trunk, one of which is kept. kernels: of the past, by which
    samples are weighed. by_past: share of the samples that come from the past alone, of trunks and of limbs. groups: of
    samples that the features are expected by.
    noise: of the dynamics, as a share of the energy's turn_speed and its like. far, wide: share of steps that are long,
    and how many times as long; of trunk and limbs each by itself.
    together: whether samples are weighed by what the past expects of whole poses; else by what it expects of trunk and
    limbs, as if these did not depend on each other: of a thousand poses that were put together of parts drawn apart
    hardly any is near a whole pose of the past.
    Raises InputError where a value cannot be.
    """

    particles: int = setting(1000, at_least=1)
    draws: int = setting(4, at_least=1)
    kernels: int = setting(200, at_least=1)
    by_past: float = setting(0.5, at_least=0, at_most=1)
    groups: int = setting(3, at_least=1)
    noise: float = setting(0.3, above=0)
    far: float = setting(0.1, at_least=0, at_most=1)
    wide: float = setting(5.0, at_least=1)
    together: bool = False

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, eq=False)
class Crowd:
    """Poses of one frame: q (N, nq), weights (N,) that sum to one. reference (nq,): in whose tangent space they are
    moved."""

    q: np.ndarray
    weights: np.ndarray
    reference: np.ndarray


@dataclass(frozen=True, eq=False)
class Expected:
    """What is expected of the next frame: tangents at reference (nq,), centres (K, nv) of kernels with weights (K,),
    steps from there, and samples (N, nv) with the kernels they come from (N,)."""

    reference: np.ndarray
    centres: np.ndarray
    weights: np.ndarray
    steps: Steps
    samples: np.ndarray
    kernel: np.ndarray


@dataclass(frozen=True, eq=False)
class Drawn:
    """Poses drawn so far: tangents x (N, nv) and explained (N,), the logarithm of the density, up to a constant of all,
    that they are spread by, given by the parts that were drawn."""

    x: np.ndarray
    explained: np.ndarray


@dataclass(frozen=True, eq=False)
class PoseChain:
    """One frame's chain of poses (`estimator.inference.chains.exchange.Chain`).

    camera: in which features are told. outlines: what else the picture says of poses, None where nothing.
    past: whether samples also come from the past, as they have to where the image does not show everything; without, as
    likelihood sampling has it, there are none where a feature is not detected. std (nv,): of the dynamics, for a step.
    """

    rng: np.random.Generator
    parts: PoseParts
    camera: Camera
    outlines: OutlineLikelihood | None
    std: np.ndarray
    settings: PoseChainSettings
    past: bool = True
    told: dict[str, float] = field(default_factory=dict)

    @property
    def body(self) -> Body:
        """Whose poses."""
        return self.parts.body

    def predict(self, state: Crowd, dt: float) -> Expected:
        """See `Chain`; `dt` is in `std` already."""
        s, body = self.settings, self.body
        lower, upper = body.tangent_bounds(state.reference)
        steps = Steps(self.std, lower, upper, self.parts.dofs, s.far, s.wide)
        tangents = body.differences(state.reference, state.q)
        few = systematic(self.rng, state.weights, min(s.kernels, len(state.weights)))
        chosen = systematic(self.rng, np.full(len(few), 1.0 / len(few)), s.particles)
        centres = tangents[few]
        samples = steps.moved(self.rng, centres[chosen])
        return Expected(state.reference, centres, np.full(len(few), 1.0 / len(few)), steps, samples, chosen)

    def features(self, prior: Expected) -> FeatureDensity:
        """See `Chain`: groups of the samples' features, each as a normal density."""
        pixels = self._pixels(self._placed(prior.reference, prior.samples))
        flat = pixels.reshape(len(pixels), -1)
        whole = np.isfinite(flat).all(axis=1)
        if not whole.any():
            return uniform(self.parts.features.names)
        flat = flat[whole]
        radius = 2.0 * float(np.sqrt(flat.var(axis=0).max())) + _FEATURE_NOISE
        label = clusters(flat, np.full(len(flat), 1.0 / len(flat)), radius, self.settings.groups)
        log_weight, mean, covariance = [], [], []
        for k in range(int(label.max()) + 1):
            own = flat[label == k]
            off = own - own.mean(axis=0)
            log_weight.append(np.log(len(own) / len(flat)))
            mean.append(own.mean(axis=0))
            covariance.append(off.T @ off / len(own) + _FEATURE_NOISE**2 * np.eye(flat.shape[1]))
        names = self.parts.features.names
        known = np.ones((len(mean), len(names)), dtype=bool)
        return FeatureDensity(
            names, np.array(log_weight), known, np.array(mean).reshape(len(mean), -1, 2), np.array(covariance)
        )

    def update(self, prior: Expected, message: Message) -> tuple[Crowd, float]:
        """See `Chain`. Trunks first, then each limb on the trunks that are kept, each by what tells of it alone; in the
        end whole poses, by what their parts did not know of each other. Without any sample the past goes on alone."""
        drawn = self._trunks(prior, message)
        for part in range(1, self.parts.count):
            if drawn is not None:
                drawn = self._limbs(prior, message, drawn, part)
        if drawn is None:
            return self.without_samples(prior)
        placed = self._placed(prior.reference, drawn.x)
        target = self._expected(prior, drawn.x)
        target += self._evidence(message, placed, None) + self._outline(placed, None)
        log_weight = target - drawn.explained
        if not np.isfinite(log_weight).any():
            return self.without_samples(prior)
        weights, log_mean = normalised(np.where(np.isfinite(log_weight), log_weight, -np.inf))
        self.told["samples"] = float(len(weights))
        self.told["effective_sample_size"] = effective_count(weights)
        q = placed.q[systematic(self.rng, weights, self.settings.particles)]
        return Crowd(q, np.full(len(q), 1.0 / len(q)), prior.reference), log_mean

    def _expected(self, prior: Expected, x: np.ndarray) -> np.ndarray:
        """Log density (N,) of whole poses at tangents x (N, nv) by the past, see `PoseChainSettings.together`."""
        if self.settings.together:
            return prior.steps.log_density(x, prior.centres, prior.weights)
        each = [prior.steps.log_density(x, prior.centres, prior.weights, [part]) for part in range(self.parts.count)]
        return np.asarray(np.sum(each, axis=0))

    def _trunks(self, prior: Expected, message: Message) -> Drawn | None:
        """Trunks (N) with the limbs of the samples that they come from, kept by their weights; None if none can be."""
        s, group = self.settings, self.parts.dofs[0]
        x = prior.samples.copy()
        led = self._led(prior, message)
        share = 1.0 if led is None else (s.by_past if self.past else 0.0)
        log_q = np.full(len(x), -np.inf)
        if share < 1.0 and led is not None:
            count = round((1.0 - share) * len(x))
            x[:count, group] = led.sample(self.rng, count)
            log_q = np.log1p(-share) + led.log_density(x[:, group])
        inside = ((x >= prior.steps.lower) & (x <= prior.steps.upper)).all(axis=1)
        x = np.clip(x, prior.steps.lower, prior.steps.upper)
        past = prior.steps.log_density(x, prior.centres, prior.weights, [0])
        if share > 0.0:
            log_q = np.logaddexp(log_q, np.log(share) + past)
        placed = self._placed(prior.reference, x)
        target = past + self._evidence(message, placed, self.parts.of_part[0]) + self._outline(placed, 0)
        log_weight = np.where(inside & np.isfinite(log_q), target - log_q, -np.inf)
        if not np.isfinite(log_weight).any():
            return None
        weights, log_mass = normalised(log_weight)
        kept = systematic(self.rng, weights, len(weights))
        return Drawn(x[kept], target[kept] - log_mass)

    def _led(self, prior: Expected, message: Message) -> NormalMixture | None:
        """Trunks where the features that they move may be: about the past, or, where that says nothing, at rest."""
        body, group, on_trunk = self.parts.body, self.parts.dofs[0], self.parts.of_part[0]
        names = [self.parts.features.names[f] for f in on_trunk]
        told = message.guide.over(self.parts.features.names).marginal(names)
        if self.past:
            few = systematic(self.rng, prior.weights, min(_LED, len(prior.weights)))
            centres, std = prior.centres[few], prior.steps.std[group] * self.settings.wide
        else:
            centres = np.tile(body.difference(prior.reference, body.neutral), (4, 1))
            std = _rest_std(body)[group]
        predicted = self._pixels(self._placed(prior.reference, centres))[:, on_trunk]
        jacobian = np.empty((len(centres), len(on_trunk), 2, len(group)))
        for k, dof in enumerate(group):
            moved = centres.copy()
            moved[:, dof] += _DIFFERENCE
            there = self._pixels(self._placed(prior.reference, moved))[:, on_trunk]
            jacobian[..., k] = (there - predicted) / _DIFFERENCE
        if not (np.isfinite(predicted).all() and np.isfinite(jacobian).all()):
            return None
        return led_kernels(self.rng, centres[:, group], std, told, predicted, jacobian)

    def _limbs(self, prior: Expected, message: Message, trunks: Drawn, part: int) -> Drawn | None:
        """Trunks with one of several draws of a limb on each, in proportion to their weights; None if none can be."""
        s, count = self.settings, len(trunks.x)
        x = np.repeat(trunks.x, s.draws, axis=0)
        proposal, placed = self._seen_end(message, part), self._placed(prior.reference, x)
        past = self.past or proposal is None
        by_past = np.zeros(len(x), dtype=bool)
        if past:
            by_past[:] = True if proposal is None else self.rng.random(len(x)) < s.by_past
        share = (1.0 if proposal is None else s.by_past) if past else 0.0
        group, ok = self.parts.dofs[part], np.ones(len(x), dtype=bool)
        if by_past.any():
            rows = self.rng.choice(len(prior.centres), size=int(by_past.sum()), p=prior.weights)
            x[np.ix_(by_past, group)] = prior.steps.moved_group(self.rng, prior.centres[rows], group)
        if proposal is not None and not by_past.all():
            arms = proposal.drawn(self.rng, placed.of(~by_past))
            x[np.ix_(~by_past, group)] = arms.angles - prior.reference[proposal.ik.entries]
            ok[~by_past] = arms.ok
        before = prior.steps.log_density(x, prior.centres, prior.weights, [part])
        log_q = np.log(share) + before if share > 0.0 else np.full(len(x), -np.inf)
        if proposal is not None and share < 1.0:
            angles = x[:, group] + prior.reference[proposal.ik.entries]
            log_q = np.logaddexp(log_q, np.log1p(-share) + proposal.log_density(angles, placed))
        placed = self._placed(prior.reference, x)
        target = before + self._evidence(message, placed, self.parts.of_part[part]) + self._outline(placed, part)
        log_weight = np.where(ok & np.isfinite(log_q), target - log_q, -np.inf).reshape(count, s.draws)
        log_mass = np.logaddexp.reduce(log_weight, axis=1) - np.log(s.draws)
        alive = np.isfinite(log_mass)
        if not alive.any():
            return None
        level = np.cumsum(np.exp(log_weight[alive] - log_mass[alive, None] - np.log(s.draws)), axis=1)
        taken = np.minimum((level < self.rng.random((len(level), 1)) * level[:, -1:]).sum(axis=1), s.draws - 1)
        rows = np.flatnonzero(alive) * s.draws + taken
        return Drawn(x[rows], trunks.explained[alive] + target[rows] - log_mass[alive])

    def _seen_end(self, message: Message, part: int) -> ImageProposal | None:
        """Where the image may show the end of a limb; None where nothing tells."""
        name = self.parts.features.names[int(self.parts.of_part[part][-1])]
        told = message.guide.over(self.parts.features.names).marginal([name])
        seen = np.flatnonzero(told.known[:, 0])
        if not len(seen):
            return None
        only = FeatureDensity(
            told.names, told.log_weight[seen], told.known[seen], told.mean[seen], told.covariance[seen]
        )
        return ImageProposal(self.parts.ik[part - 1], self.camera, only)

    def _evidence(self, message: Message, placed: PlacedBodies, features: np.ndarray | None) -> np.ndarray:
        """Log density (N,) of some features of N poses, or of all, by what was told; -inf where they have no image."""
        names = self.parts.features.names
        chosen = np.arange(len(names)) if features is None else features
        if not len(chosen):
            return np.zeros(len(placed.q))
        told = message.evidence.over(names).marginal([names[f] for f in chosen])
        pixels = self._pixels(placed)[:, chosen]
        whole = np.isfinite(pixels).all(axis=(1, 2))
        value = np.full(len(pixels), -np.inf)
        value[whole] = told.log_density(pixels[whole])
        return value

    def _outline(self, placed: PlacedBodies, part: int | None) -> np.ndarray:
        """What the picture says (N,) of the limbs that a part moves, or of all."""
        if self.outlines is None:
            return np.zeros(len(placed.q))
        if part is None:
            return self.outlines.log_likelihood(placed)
        return np.asarray(self.outlines.values(placed, self.parts.shapes[part])[0].sum(axis=1))

    def without_samples(self, prior: Expected) -> tuple[Crowd, float]:
        """Where the image shows nothing that a pose could be drawn from: what was expected."""
        self.told["samples"] = 0.0
        self.told["effective_sample_size"] = 0.0
        q = self._placed(prior.reference, prior.samples).q
        return Crowd(q, np.full(len(q), 1.0 / len(q)), prior.reference), -np.inf

    def _placed(self, reference: np.ndarray, x: np.ndarray) -> PlacedBodies:
        """Poses at tangents x (N, nv) from a reference (nq,)."""
        body = self.body
        return body.placed(body.integrated(np.tile(reference, (len(x), 1)), x))

    def _pixels(self, placed: PlacedBodies) -> np.ndarray:
        """Features (N, F, 2) [px]; NaN where they have no image."""
        return self.camera.project(self.parts.features.points(placed))


def _rest_std(body: Body) -> np.ndarray:
    """How far from rest joints are (nv,), by their stabilisers."""
    std = np.full(body.nv, 1.0)
    for stabiliser in body.subject.stabilisers:
        if body.model.existJointName(stabiliser.joint):
            std[body.place(stabiliser.joint).v] = stabiliser.std
    return std
