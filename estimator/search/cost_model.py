"""The energy of one frame, assembled from its terms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation, image_extent
from estimator.energy.cost import Cost
from estimator.energy.pose_prior import PosePrior
from estimator.energy.priors import Stabilisers, Transition
from estimator.energy.recorded import RecordedTerm
from estimator.energy.reprojection import Reprojection
from estimator.energy.standing import HeldPoints, StandingTie, standing_ties
from estimator.energy.term import Term
from estimator.search.cost_terms import PER_CAMERAS, PER_FRAME, CostSettings, TermContext, terms_of
from estimator.vision.cues.image_likelihood import ImageLikelihood, ImageModel
from estimator.vision.cues.settings import CueSettings, cue_settings
from humanoid.collision.floor import stiff_hands
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_PLACE_V, ROOT_TURN_V, SHORTEST_STEP, Body, PosedBody
from humanoid.subject.landmarks import landmark_spread

ALL_DETECTED = 12  # keypoints of a camera from which the whole person counts as detected: COCO's limbs


def parts_apart(body: Body, cost: CostSettings) -> SelfCollision:
    """Distances of the parts of a body that keep clear of each other."""
    hands = stiff_hands(body)
    return SelfCollision(body, exclude=[] if cost.hands_apart else list(combinations(hands, 2)))


class CostModel:
    """Builds the energy of a frame for one body; terms that do not change from frame to frame are made once.

    cues: the settings of each cue of the pictures. pose_prior: the learned mixture of poses, with its share of the
    energy, None where the body or the settings have none. quickness (nv,): see `quickness_of`; 1 where the settings do
    not request it.
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
        self._spread = landmark_spread(body.landmark_names) / landmark_spread(("left_shoulder",))[0]
        known = body.keypoint_std / body.extent
        self._place = np.where(np.isnan(known), self.settings.keypoint_place, known)
        self.quickness = quickness_of(body) if self.settings.quickness else np.ones(body.nv)
        self._context = TermContext(body, self.settings, self.self_collision)
        self._fixed = tuple(terms_of(self._context))
        self.pose_prior = next((term for term in self._fixed if isinstance(term, PosePrior)), None)
        self._image: ImageModel | None = None
        self._last_standing: tuple[np.ndarray, float, HeldPoints] | None = None
        self._last_transition: tuple[float, Transition, list[Stabilisers]] | None = None
        self._last_by_cameras: tuple[tuple[Camera, ...], list[Term]] | None = None

    def rest_energies(self, q: np.ndarray) -> np.ndarray:
        """Energies (N,) of the priors on rest positions at configurations q (N, nq)."""
        rest = [term for term in self._fixed if isinstance(term, (Stabilisers, PosePrior))]
        return Cost(self.body, rest).values_at(q)

    def observation_term(self, observation: Observation) -> Reprojection:
        """The keypoint term of a frame, and beside it all others that are made from what is observed."""
        s, sigma = self.settings, self.keypoint_sigma(observation)
        context = replace(self._context, cameras=observation.cameras, observation=observation)
        beside = terms_of(context, PER_FRAME)
        return Reprojection(self.body, observation, sigma, s.potential, s.nu, beside)

    def likelihood(self, observation: Observation, posed: PosedBody) -> ImageLikelihood:
        """The image likelihood of a frame. `posed`, about where the body is, gives its extent in the images."""
        if not observation.cues:
            return ImageLikelihood()
        points = self.body.landmarks(posed)
        pixels = [c.camera.project(points) for c in observation.cues]
        # landmarks behind a camera have no place in its image
        extents = [image_extent(p, np.isfinite(p).all(axis=1).astype(np.float64)) for p in pixels]
        detected = detected_share(observation)
        return ImageLikelihood.of(self.image, observation.cues, extents, detected)

    @property
    def image(self) -> ImageModel:
        """Data shared by the image terms of all frames, made on first use."""
        if self._image is None:
            self._image = ImageModel(self.body, self.cues)
        return self._image

    def keypoint_sigma(self, observation: Observation) -> np.ndarray:
        """Standard deviation (C, L) [px] of the keypoints of a frame: from the detector's errors, as measured in the
        clip where available, from their places on the body, from the clip's jitter, and the extra one of keypoints that
        were not detected."""
        extent = observation.extents
        measured = np.array(observation.noise) if observation.noise else np.ones(len(extent))
        noise = self.settings.keypoint_noise * measured
        sigma: np.ndarray = extent[:, None] * np.hypot(noise[:, None] * self._spread, self._place)
        if observation.jitter:
            sigma = np.hypot(sigma, np.array(observation.jitter)[:, None])
        if observation.spread is not None:
            sigma = np.hypot(sigma, observation.spread)
        return np.maximum(sigma, 0.5)

    def extent(self, camera: Camera, q: np.ndarray) -> float:
        """The body's size in an image [px] at q (nq,), see `image_extent`."""
        pixels = camera.project(self.body.landmarks(self.body.at(q)))
        return image_extent(pixels, np.isfinite(pixels).all(axis=1).astype(float))

    def _by_cameras(self, cameras: tuple[Camera, ...]) -> list[Term]:
        """The terms that depend on the cameras, made once for a clip's."""
        known = self._last_by_cameras
        if known is None or list(map(id, known[0])) != list(map(id, cameras)):
            terms = terms_of(replace(self._context, cameras=cameras), PER_CAMERAS)
            known = self._last_by_cameras = cameras, terms
        return known[1]

    def cost(
        self,
        observed: Reprojection | None,
        q_previous: np.ndarray | None = None,
        dt: float = 0.0,
        image_terms: Sequence[Term] = (),
    ) -> Cost:
        """Energy of a frame; with `q_previous` (nq,) the change since then, `dt` seconds ago, is penalised as well."""
        terms: list[Term] = [*image_terms, *self._fixed]
        if observed is not None:
            keypoints = [observed] if observed.cameras else []
            terms = [*keypoints, *terms, *self._by_cameras(observed.cameras), *observed.beside]
        if q_previous is not None:
            terms.extend(self.since(q_previous, dt, observed))
        return Cost(self.body, terms)

    def since(self, q_previous: np.ndarray, dt: float, observed: Reprojection | None) -> list[RecordedTerm]:
        """Penalty of the change since `q_previous` (nq,), `dt` seconds ago, terms that hold the observed standing
        points, and what the past has counted of the priors on rest positions: the last terms of `cost`."""
        standing = None if observed is None else observed.observation.standing
        transition, counted = self._since(dt)
        changed = [*counted, transition.since(q_previous)]
        if standing is None or self.settings.standing_weight <= 0.0:
            return changed
        held = self._standing_points(standing, dt).targets(self.body.at(q_previous))
        return [*held, *changed]

    def _standing_points(self, standing: np.ndarray, dt: float) -> HeldPoints:
        """Held points of a frame whose landmarks stand with these probabilities (L,), `dt` seconds after the last; made
        once."""
        known = self._last_standing
        if known is None or known[0] is not standing or known[1] != dt:
            s = self.settings
            std = math.hypot(s.standing_error, s.standing_slip * dt)
            points = HeldPoints(self.body, standing, std, s.standing_weight)
            known = self._last_standing = standing, dt, points
        return known[2]

    def standing_ties(self, standing: np.ndarray | None, dt: float) -> list[StandingTie]:
        """Terms that tie the standing points of two successive frames, `dt` seconds apart; standing (L,): see
        `Observation`."""
        s = self.settings
        if standing is None or s.standing_weight <= 0.0:
            return []
        return standing_ties(self.body, standing, s.standing_slip * max(dt, SHORTEST_STEP), s.standing_weight)

    def transition(self, q_previous: np.ndarray, dt: float) -> Transition:
        """Penalty of the change of the configuration since `q_previous` (nq,), `dt` seconds ago."""
        return self._since(dt)[0].since(q_previous)

    def _since(self, dt: float) -> tuple[Transition, list[Stabilisers]]:
        """The transition from any pose `dt` seconds ago, and what such a pose has counted of the priors on rest
        positions; made once."""
        known = self._last_transition
        if known is None or known[0] != dt:
            s, std = self.settings, self.transition_std(dt)
            counted = []
            if s.rest_time > 0.0:
                rest = [term for term in self._fixed if isinstance(term, Stabilisers)]
                counted = [term.counted_before(std, dt / s.rest_time) for term in rest]
            transition = Transition(self.body, self.body.neutral, std, s.transition_potential, s.transition_nu)
            known = self._last_transition = dt, transition, counted
        return known[1:]

    def transition_std(self, dt: float) -> np.ndarray:
        """Standard deviation (nv,) of the change in `dt` seconds."""
        s = self.settings
        return (
            self.quickness
            * per_dof(self.body, s.turn_speed, s.root_turn_speed, s.root_slide_speed)
            * max(dt, SHORTEST_STEP)
        )


def detected_share(observation: Observation) -> float:
    """Share of a person that the detector has found in a frame, 0 to 1; 0 without cameras."""
    return min(1.0, observation.count / (ALL_DETECTED * max(1, len(observation.cameras))))


def quickness_of(body: Body) -> np.ndarray:
    """Quickness of each degree of freedom (nv,) by the stabilisers; 1 for the root."""
    model, quickness = body.model, np.ones(body.nv)
    for stabiliser in body.subject.stabilisers:
        if model.existJointName(stabiliser.joint):
            quickness[model.idx_vs[model.getJointId(stabiliser.joint)]] = stabiliser.quickness
    return quickness


def per_dof(body: Body, turn: float, root_turn: float, root_slide: float) -> np.ndarray:
    """One number for each degree of freedom (nv,): of joints, of a free root's orientation and of its position."""
    values = np.full(body.nv, turn)
    if body.has_free_root:
        values[ROOT_PLACE_V], values[ROOT_TURN_V] = root_slide, root_turn
    return values
