"""The density of poses that samples are drawn from, of a frame's predictions and messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.energy.pose_prior import PosePrior
from estimator.inference.chains.exchange import Message
from estimator.inference.chains.feature_density import FeatureDensity
from estimator.trackers.dual_chain.outline_values import OutlineLikelihood
from estimator.trackers.dual_chain.pose_parts import PoseParts
from estimator.trackers.dual_chain.steps import Reach, TruncatedSteps
from humanoid.kinematics.body import Body, PlacedBodies


@dataclass(frozen=True, eq=False)
class Expected:
    """Prediction of the next frame, in the tangent space at reference (nq,): centres (K, nv) of kernels with weights
    (K,), steps from there, and samples (N, nv).

    log_odds: in `alternative`, those of that prediction to this one. log_odds_lost: that a limb is not where it is
    predicted but anywhere, -inf for never.
    """

    reference: np.ndarray
    centres: np.ndarray
    weights: np.ndarray
    steps: TruncatedSteps
    samples: np.ndarray
    log_odds: float = 0.0
    log_odds_lost: float = -np.inf
    alternative: Expected | None = None

    @cached_property
    def reach(self) -> Reach:
        """The prediction of poses."""
        return self.steps.reach(self.centres, self.weights)


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """The posterior of poses as tangents x (N, nv) (`estimator.trackers.dual_chain.walk.SampleTarget`).

    The past's predictions of trunk and limbs are treated as independent. Of a thousand poses composed of separately
    drawn parts hardly any is near a whole pose of the past, and all later ones would descend from these few.

    camera: of the features in the message. outlines: further image evidence, None without any. elsewhere: the parts, by
    number, for which the past is assumed wrong, and where they may be instead. pose_prior: which poses people take,
    where that was learned: the features of one image leave the depth of limbs open. if_hidden: additional log-weight of
    an association for a hidden feature with a detection of its own, and for one without (`EvidenceSettings.if_hidden`).
    """

    parts: PoseParts
    camera: Camera
    outlines: OutlineLikelihood | None
    prior: Expected
    message: Message
    elsewhere: Mapping[int, Reach] = field(default_factory=dict)
    pose_prior: PosePrior | None = None
    if_hidden: tuple[float, float] = (0.0, 0.0)
    _marginals: dict[tuple[int, ...], FeatureDensity] = field(default_factory=dict, init=False)
    _if_hidden: dict[tuple[bool, ...], FeatureDensity] = field(default_factory=dict, init=False)

    @property
    def body(self) -> Body:
        """The body of the poses."""
        return self.parts.body

    def past_of(self, part: int) -> Reach:
        """The prediction of a part."""
        return self.elsewhere.get(part, self.prior.reach)

    def of_group(self, x: np.ndarray, group: int) -> np.ndarray:
        """See `Target`: of the degrees of freedom of one part, by the past."""
        return self.past_of(group).log_density(x, group)

    def prepared(self, x: np.ndarray) -> PlacedBodies:
        """See `Target`: poses at tangents x (N, nv)."""
        return self.body.placed(self.at(x))

    def log_message(self, samples: PlacedBodies) -> np.ndarray:
        """See `Target`: by the message about all features; -inf where they have no image."""
        return self.evidence(samples, range(len(self.parts.features.names)))

    def likelihood(self, samples: PlacedBodies) -> np.ndarray:
        """See `Target`: by outlines and silhouette, by which features are hidden, and by the learned prior of poses."""
        value = np.zeros(len(samples.q)) if self.outlines is None else self._by_picture(samples, self.outlines)
        return value if self.pose_prior is None else value - self.pose_prior.values(samples)

    def _by_picture(self, samples: PlacedBodies, outlines: OutlineLikelihood) -> np.ndarray:
        if not any(self.if_hidden):
            return outlines.log_likelihood(samples)
        value, hidden = outlines.with_hidden(samples, self.parts.features.points(samples), self.parts.of_limb)
        return np.asarray(value + self._by_what_is_hidden(samples, hidden))

    def _by_what_is_hidden(self, samples: PlacedBodies, hidden: np.ndarray) -> np.ndarray:
        """What is added to the message's log-likelihood of poses (N,) because they hide features, (N, F) bool: a hidden
        feature is unlikely to be detected. A hand that is seen is not behind the trunk, which its place in the image
        leaves open."""
        value = np.zeros(len(samples.q))
        if not hidden.any():
            return value
        received, pixels = self._marginal(tuple(range(self.parts.features.count))), self.pixels(samples)
        for which in np.unique(hidden[hidden.any(axis=1)], axis=0):
            rows = (hidden == which).all(axis=1)
            value[rows] = self._message_if_hidden(tuple(which.tolist())).log_density(pixels[rows])
            value[rows] -= received.log_density(pixels[rows])
        return value

    def _message_if_hidden(self, hidden: tuple[bool, ...]) -> FeatureDensity:
        """The message about all features to poses that hide some of them, made once."""
        if hidden not in self._if_hidden:
            received = self._marginal(tuple(range(len(hidden))))
            self._if_hidden[hidden] = received.if_hidden(np.array(hidden), *self.if_hidden)
        return self._if_hidden[hidden]

    def outlines_of(self, part: int, samples: PlacedBodies) -> np.ndarray:
        """Log-likelihoods (N,) of the outlines of the limbs that a part moves, with the others where they are."""
        if self.outlines is None:
            return np.zeros(len(samples.q))
        return np.asarray(self.outlines.values(samples, self.parts.shapes[part])[0].sum(axis=1))

    def evidence(self, placed: PlacedBodies, features: Sequence[int] | np.ndarray) -> np.ndarray:
        """The message's log-likelihood (N,) of some features of N poses; -inf where they have no image."""
        if not len(features):
            return np.zeros(len(placed.q))
        received = self._marginal(tuple(int(f) for f in features))
        pixels = self.pixels(placed)[:, list(features)]
        whole = np.isfinite(pixels).all(axis=(1, 2))
        value = np.full(len(pixels), -np.inf)
        value[whole] = received.log_density(pixels[whole])
        return value

    def _marginal(self, features: tuple[int, ...]) -> FeatureDensity:
        """The message about some features, made once."""
        if features not in self._marginals:
            names = self.parts.features.names
            self._marginals[features] = self.message.evidence.over(names).marginal([names[f] for f in features])
        return self._marginals[features]

    def at(self, x: np.ndarray) -> np.ndarray:
        """Configurations (N, nq) at tangents x (N, nv)."""
        return self.body.integrated(np.tile(self.prior.reference, (len(x), 1)), x)

    def pixels(self, placed: PlacedBodies) -> np.ndarray:
        """Features (N, F, 2) [px]; NaN where they have no image."""
        return self.camera.project(self.parts.features.points(placed))


BY_IMAGE = 0.6  # share of a limb that may be anywhere


TRIES = 8  # for each sample of it that is kept: of arms by inverse kinematics a fifth are inside their limits


GUIDED = 0.5  # power of the outlines' likelihood by which these are chosen, beside the message about its features


def anywhere(parts: PoseParts, prior: Expected) -> Reach:
    """Steps from rest that lead where joints are as a rule (`Rest.guess`)."""
    steps = prior.steps
    rest, spread = parts.rest.guess(parts.body, prior.reference)
    return TruncatedSteps(spread, steps.lower, steps.upper, steps.groups, 0.0, 1.0).reach(rest[None], np.ones(1))
