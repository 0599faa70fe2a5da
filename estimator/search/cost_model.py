"""The energy of one frame, assembled from its terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.interpenetration import Interpenetration
from estimator.energy.pose_mixture import load_mixture, shipped_mixture
from estimator.energy.pose_prior import PosePrior, misfit
from estimator.energy.priors import Stabilisers, Transition
from estimator.energy.reprojection import Reprojection
from estimator.energy.term import Cost, Term
from estimator.energy.upright import Upright, world_up
from estimator.numerics.robust import POTENTIALS
from estimator.vision.likelihood.image_likelihood import ImageLikelihood, ImageModel
from estimator.vision.likelihood.settings import CueSettings, ImageSettings, cue_settings
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_PLACE_V, ROOT_TURN_V, SHORTEST_STEP, Body, PosedBody
from humanoid.subject.landmarks import landmark_spread
from humanoid.support.settings import setting

ALL_DETECTED = 12  # keypoints of a camera from which the whole person counts as detected: COCO's limbs


@dataclass(frozen=True)
class CostSettings:
    """Weights and scales of the energy; all are negative log-probabilities, so weights near 1 are honest ones.

    potential, nu: robust potential of a keypoint (`estimator.numerics.robust`).
    keypoint_noise: standard deviation of a shoulder-like keypoint as a fraction of the subject's extent in the image
        (root mean square distance of its keypoints from their centre): detectors err in proportion to the person.
    landmark_mismatch: how far, in the same unit, the subject's landmarks may lie from where the detector sees them;
        it keeps sharply detected points of the face from deciding the body's size.
    stabiliser_weight: strength of the rest-position priors. upright_weight: of the root's, relative to these.
    pose_prior_weight: share of the rest-position priors, 0 to 1, whose place a mixture learned from captured motion
        takes (`estimator.energy.pose_prior`); pose_prior_file: its numbers. Where none are named it is the shipped
        ones, of human34, and a body that they do not suit (`estimator.energy.pose_prior.misfit`) has the rest positions
        alone.
    interpenetration_weight, clearance_scale: repulsion of body parts (CSS 3.2.4): energy at contact, and the distance
        [m] over which it changes e-fold.
    turn_speed [rad/s], root_turn_speed [rad/s], root_slide_speed [m/s]: standard deviation of the change between
        frames, per second, of joints, of the root's orientation and of its position; transition_potential,
        transition_nu: long tails let a mode jump when the image insists.
    exchange_penalty: energy of reading a frame's keypoints with left and right swapped.
    image: of the pictures' cues.
    """

    potential: str = setting("lorentzian", one_of=tuple(POTENTIALS))
    nu: float = setting(8.0, above=0)
    keypoint_noise: float = setting(0.03, above=0)
    landmark_mismatch: float = setting(0.7, at_least=0)
    stabiliser_weight: float = setting(1.0, at_least=0)
    upright_weight: float = setting(1.0, at_least=0)
    pose_prior_weight: float = setting(0.25, at_least=0, at_most=1)
    pose_prior_file: str = ""
    interpenetration_weight: float = setting(1.0, at_least=0)
    clearance_scale: float = setting(0.005, above=0)
    turn_speed: float = setting(6.0, above=0)
    root_turn_speed: float = setting(3.0, above=0)
    root_slide_speed: float = setting(1.5, above=0)
    transition_potential: str = setting("lorentzian", one_of=tuple(POTENTIALS))
    transition_nu: float = setting(20.0, above=0)
    exchange_penalty: float = setting(3.0, at_least=0)
    image: ImageSettings = field(default_factory=ImageSettings)


class CostModel:
    """Builds the energy of a frame for one body; terms that do not change from frame to frame are made once.

    cues: the settings of each cue of the pictures. pose_prior: the learned mixture of poses, with its share of the
    energy, None where the body or the settings have none.
    """

    def __init__(
        self,
        body: Body,
        settings: CostSettings | None = None,
        self_collision: SelfCollision | None = None,
        cues: CueSettings | None = None,
    ) -> None:
        self.body = body
        self.settings = settings or CostSettings()
        self.cues = cues or cue_settings()
        self.self_collision = self_collision if self_collision is not None and self_collision.pairs else None
        spread = landmark_spread(body.landmark_names) / landmark_spread(("left_shoulder",))[0]
        self._spread = np.hypot(spread, self.settings.landmark_mismatch)
        priors = _pose_priors(body, self.settings)
        if self.self_collision is not None and self.settings.interpenetration_weight > 0.0:
            s = self.settings
            priors.append(Interpenetration(self.self_collision, s.clearance_scale, s.interpenetration_weight))
        self._priors = tuple(priors)
        self.pose_prior = next((term for term in priors if isinstance(term, PosePrior)), None)
        self._has_upright = (
            body.has_free_root
            and body.subject.upright is not None
            and self.settings.stabiliser_weight * self.settings.upright_weight > 0.0
        )
        self._image: ImageModel | None = None
        self._last_upright: tuple[tuple[Camera, ...], Upright] | None = None

    def observation_term(self, observation: Observation) -> Reprojection:
        """The keypoint term of a frame."""
        return Reprojection(
            self.body, observation, self.keypoint_sigma(observation), self.settings.potential, self.settings.nu
        )

    def likelihood(self, observation: Observation, posed: PosedBody) -> ImageLikelihood | None:
        """What the pictures of a frame say, None where there are none; `posed`, about where the body is, gives its
        extent in the images."""
        if not observation.cues:
            return None
        points = self.body.landmarks(posed)
        pixels = [c.camera.project(points) for c in observation.cues]
        # landmarks behind a camera have no place in its image
        extents = [image_extent(p, np.isfinite(p).all(axis=1).astype(np.float64)) for p in pixels]
        detected = min(1.0, observation.count / (ALL_DETECTED * len(observation.cameras)))
        return self.image.likelihood(observation.cues, extents, detected)

    @property
    def image(self) -> ImageModel:
        """What the image terms of all frames share, made when it is first asked for."""
        if self._image is None:
            self._image = ImageModel(self.body, self.settings.image, cues=self.cues)
        return self._image

    def keypoint_sigma(self, observation: Observation) -> np.ndarray:
        """Standard deviation (C, L) [px] of the keypoints of a frame; what trembles in the clip's is added, and what a
        keypoint that was not detected has of its own."""
        extent = np.array([image_extent(p, c) for p, c in zip(observation.pixels, observation.confidence, strict=True)])
        sigma: np.ndarray = self.settings.keypoint_noise * extent[:, None] * self._spread[None, :]
        if observation.jitter:
            sigma = np.hypot(sigma, np.array(observation.jitter)[:, None])
        if observation.spread is not None:
            sigma = np.hypot(sigma, observation.spread)
        return np.maximum(sigma, 0.5)

    def extent(self, camera: Camera, q: np.ndarray) -> float:
        """The body's size in an image [px] at q (nq,), see `image_extent`."""
        pixels = camera.project(self.body.landmarks(self.body.at(q)))
        return image_extent(pixels, np.isfinite(pixels).all(axis=1).astype(float))

    def _upright(self, cameras: tuple[Camera, ...]) -> Upright:
        """The root's stabiliser; which way is up depends on the cameras alone."""
        if self._last_upright is None or self._last_upright[0] is not cameras:
            s = self.settings
            self._last_upright = cameras, Upright(self.body, world_up(cameras), s.stabiliser_weight * s.upright_weight)
        return self._last_upright[1]

    def cost(
        self,
        observed: Reprojection | None,
        q_previous: np.ndarray | None = None,
        dt: float = 0.0,
        image_terms: Sequence[Term] = (),
    ) -> Cost:
        """Energy of a frame; with `q_previous` (nq,) the change since then, `dt` seconds ago, is paid for as well."""
        terms: list[Term] = (
            [*image_terms, *self._priors] if observed is None else [observed, *image_terms, *self._priors]
        )
        if observed is not None and self._has_upright:
            terms.append(self._upright(observed.cameras))
        if q_previous is not None:
            terms.append(self.transition(q_previous, dt))
        return Cost(self.body, terms)

    def transition(self, q_previous: np.ndarray, dt: float) -> Transition:
        """What the change since `q_previous` (nq,), `dt` seconds ago, costs: the last term of `cost`."""
        s = self.settings
        return Transition(self.body, q_previous, self.transition_std(dt), s.transition_potential, s.transition_nu)

    def transition_std(self, dt: float) -> np.ndarray:
        """Standard deviation (nv,) of the change in `dt` seconds."""
        s = self.settings
        return per_dof(self.body, s.turn_speed, s.root_turn_speed, s.root_slide_speed) * max(dt, SHORTEST_STEP)


def _pose_priors(body: Body, settings: CostSettings) -> list[Term]:
    """The stabilisers, a learned mixture, or a share of each; the stabilisers alone for a body that the shipped mixture
    does not suit."""
    strength, share = settings.stabiliser_weight, settings.pose_prior_weight
    if strength * share <= 0.0 or without_prior(body, settings) is not None:
        return [Stabilisers(body, strength)] if strength > 0.0 else []
    mixture = load_mixture(settings.pose_prior_file) if settings.pose_prior_file else shipped_mixture()
    own: list[Term] = [Stabilisers(body, strength * (1.0 - share))] if share < 1.0 else []
    return [*own, PosePrior(body, mixture, strength * share)]


def without_prior(body: Body, settings: CostSettings) -> str | None:
    """What a body lacks for the shipped mixture, which is then left out; None where nothing, or a file is named, which
    has to suit it."""
    return None if settings.pose_prior_file else misfit(body, shipped_mixture())


def per_dof(body: Body, turn: float, root_turn: float, root_slide: float) -> np.ndarray:
    """One number for each degree of freedom (nv,): of joints, of a free root's orientation and of its position."""
    values = np.full(body.nv, turn)
    if body.has_free_root:
        values[ROOT_PLACE_V], values[ROOT_TURN_V] = root_slide, root_turn
    return values


def image_extent(pixels: np.ndarray, confidence: np.ndarray) -> float:
    """Root mean square distance [px] of the seen keypoints (L, 2) from their centre; 100 if fewer than two are seen."""
    seen = confidence > 0.0
    if np.count_nonzero(seen) < 2:
        return 100.0
    return float(np.sqrt(np.square(pixels[seen] - pixels[seen].mean(axis=0)).sum(axis=1).mean()))
