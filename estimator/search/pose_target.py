"""What a frame expects and is told of poses, as the density that samples of them are drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimator.cameras.camera import Camera
from estimator.inference.chains.exchange import Message
from estimator.inference.chains.feature_density import FeatureDensity
from estimator.inference.steps import Reach, Steps
from estimator.likelihood.outline_values import OutlineLikelihood
from estimator.search.pose_parts import PoseParts
from estimator.terms.pose_prior import PosePrior
from humanoid.kinematics.body import Body, PlacedBodies


@dataclass(frozen=True, eq=False)
class Expected:
    """What is expected of the next frame, in the tangent space at reference (nq,): centres (K, nv) of kernels with
    weights (K,), steps from there, and samples (N, nv)."""

    reference: np.ndarray
    centres: np.ndarray
    weights: np.ndarray
    steps: Steps
    samples: np.ndarray

    @cached_property
    def reach(self) -> Reach:
        """Where poses are expected."""
        return self.steps.reach(self.centres, self.weights)


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """The posterior of poses as tangents x (N, nv) (`estimator.inference.walk.Target`).

    What the past expects of trunk and limbs is taken as independent: of a thousand poses that were put together of
    parts drawn apart hardly any is near a whole pose of the past, and the next ones would descend from these few.

    camera: in which features are told. outlines: what else the picture says, None where nothing. anew: the part of
    which the past is taken to be wrong, and that may be anywhere (`Rest.guess`); none by default. pose_prior: which
    poses people take, where that was learned: the features of one image leave the depth of limbs open.
    """

    parts: PoseParts
    camera: Camera
    outlines: OutlineLikelihood | None
    prior: Expected
    message: Message
    anew: int = -1
    pose_prior: PosePrior | None = None
    _told: dict[tuple[int, ...], FeatureDensity] = field(default_factory=dict, init=False)

    @property
    def body(self) -> Body:
        """Whose poses."""
        return self.parts.body

    @cached_property
    def _anywhere(self) -> Reach:
        """Of steps from rest that lead where joints are as a rule."""
        steps = self.prior.steps
        rest, spread = self.parts.rest.guess(self.body, self.prior.reference)
        anywhere = Steps(spread, steps.lower, steps.upper, steps.groups, 0.0, 1.0)
        return anywhere.reach(rest[None], np.ones(1))

    def past_of(self, part: int, kernels: np.ndarray) -> tuple[Steps, np.ndarray]:
        """Steps, and the centres (N, nv) they go from, that a part comes by; kernels (N,) of the past."""
        if part != self.anew:
            return self.prior.steps, self.prior.centres[kernels]
        return self._anywhere.steps, np.tile(self._anywhere.centres, (len(kernels), 1))

    def of_group(self, x: np.ndarray, group: int) -> np.ndarray:
        """See `Target`: of the degrees of freedom of one part, by the past."""
        return (self._anywhere if group == self.anew else self.prior.reach).log_density(x, group)

    def prepared(self, x: np.ndarray) -> PlacedBodies:
        """See `Target`: poses at tangents x (N, nv)."""
        return self.body.placed(self.at(x))

    def told(self, samples: PlacedBodies) -> np.ndarray:
        """See `Target`: by the message about all features; -inf where they have no image."""
        return self.evidence(samples, range(len(self.parts.features.names)))

    def likelihood(self, samples: PlacedBodies) -> np.ndarray:
        """See `Target`: by outlines and silhouette, and by the learned prior of poses."""
        value = np.zeros(len(samples.q)) if self.outlines is None else self.outlines.log_likelihood(samples)
        return value if self.pose_prior is None else value - self.pose_prior.values(samples)

    def evidence(self, placed: PlacedBodies, features: Sequence[int] | np.ndarray) -> np.ndarray:
        """What the message says of some features of N poses (N,); -inf where they have no image."""
        if not len(features):
            return np.zeros(len(placed.q))
        told = self._told_of(tuple(int(f) for f in features))
        pixels = self.pixels(placed)[:, list(features)]
        whole = np.isfinite(pixels).all(axis=(1, 2))
        value = np.full(len(pixels), -np.inf)
        value[whole] = told.log_density(pixels[whole])
        return value

    def _told_of(self, features: tuple[int, ...]) -> FeatureDensity:
        """The message about some features, made once."""
        if features not in self._told:
            names = self.parts.features.names
            self._told[features] = self.message.evidence.over(names).marginal([names[f] for f in features])
        return self._told[features]

    def at(self, x: np.ndarray) -> np.ndarray:
        """Configurations (N, nq) at tangents x (N, nv)."""
        return self.body.integrated(np.tile(self.prior.reference, (len(x), 1)), x)

    def pixels(self, placed: PlacedBodies) -> np.ndarray:
        """Features (N, F, 2) [px]; NaN where they have no image."""
        return self.camera.project(self.parts.features.points(placed))
