"""Evidence of the loose-limbed tracker at one instant: the likelihood of limbs, and the part detectors that propose
places."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.inference.beliefs.mixture import Density, KernelMixture, UniformBox, mixture_of
from estimator.inference.beliefs.space import PLACEMENTS
from estimator.search.cost_model import CostModel
from estimator.trackers.loose_limbed.limbs.keypoint_evidence import (
    KeypointEvidence,
    KeypointEvidenceSettings,
    LimbLandmarks,
    landmarks_of_limbs,
)
from estimator.trackers.loose_limbed.limbs.left_over import LeftOver
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood, LimbSettings, LimbView, common_box
from estimator.trackers.loose_limbed.limbs.window import Instant, LimbLogRatio, limb_views, shows_person
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from estimator.trackers.loose_limbed.part_detectors.hull import HullSettings, hull_proposals
from estimator.trackers.loose_limbed.part_detectors.keypoints import KeypointDetectorSettings, keypoint_proposals
from estimator.trackers.loose_limbed.part_detectors.templates import (
    LimbTemplates,
    load_templates,
    observed_views,
    template_proposals,
)
from humanoid.limbs.limb import LimbGraph
from humanoid.support.settings import CheckedSettings, setting

_KEPT = 3  # instants whose views are kept: the next is used again as the present one, and as the last


@dataclass(frozen=True)
class ImportanceSettings(CheckedSettings):
    """Q: kernels about what was proposed, and anywhere.

    place [m], turn [rad]: standard deviations of the kernels. anywhere: share that is even in the cameras' common
    volume and turned anyhow, for limbs of which no proposal is right; without any proposal Q is that alone.
    """

    place: float = setting(0.04, above=0)
    turn: float = setting(0.25, above=0)
    anywhere: float = setting(0.1, above=0, below=1)


def importance_functions(
    detectors: Sequence[AllPartProposals], limbs: int, box: np.ndarray, settings: ImportanceSettings
) -> tuple[Density, ...]:
    """Importance functions Q of the limbs (Sigal et al., CVPR 2004, section 4.1): the proposals of several part
    detectors with equal weight. box (2, 3) [m]: where limbs can be at all."""
    return tuple(
        _function([part_proposals[limb] for part_proposals in detectors], box, settings) for limb in range(limbs)
    )


def _function(part_proposals: Sequence[PartProposals], box: np.ndarray, settings: ImportanceSettings) -> Density:
    anywhere = UniformBox(PLACEMENTS, *box)
    received = [proposals for proposals in part_proposals if len(proposals.points)]
    if not received:
        return anywhere
    weight = np.concatenate([proposals.weights / proposals.weights.sum() for proposals in received])
    variance = np.square([[settings.place] * 3 + [settings.turn] * 3])
    kernels = mixture_of(PLACEMENTS, np.concatenate([proposals.points for proposals in received]), variance, weight)
    return KernelMixture(kernels.log_weight, kernels.mean, kernels.shape, kernels.shapes, anywhere, settings.anywhere)


@dataclass(frozen=True)
class PartDetectorSettings:
    """Bottom-up part detectors, and how importance functions are made from their proposals.

    by_keypoints: the frame's keypoints, by every pair of views, or one and the limb's length. by_hull: places that are
    foreground in all views, the likeliest for each limb. templates: a file of eigen-templates, made by `kinemode
    train-templates` for these cameras; none without. keypoints, hull: of these two. importance: of Q.
    """

    by_keypoints: bool = True
    by_hull: bool = True
    templates: str = ""
    keypoints: KeypointDetectorSettings = field(default_factory=KeypointDetectorSettings)
    hull: HullSettings = field(default_factory=HullSettings)
    importance: ImportanceSettings = field(default_factory=ImportanceSettings)


@dataclass(frozen=True)
class SeenSettings:
    """Evidence of limbs.

    pictures: of their likelihood. keypoints: how a frame's keypoints count as evidence beside it, if `by_keypoints`.
    """

    pictures: LimbSettings = field(default_factory=LimbSettings)
    by_keypoints: bool = True
    keypoints: KeypointEvidenceSettings = field(default_factory=KeypointEvidenceSettings)


class InstantReader:
    """Makes likelihoods and importance functions of the frames of one clip; those of a frame that is requested again
    are not read again."""

    def __init__(self, model: CostModel, graph: LimbGraph, seen: SeenSettings, detectors: PartDetectorSettings) -> None:
        self._model, self._graph, self._seen, self._detectors = model, graph, seen, detectors
        self._recent_views: deque[tuple[tuple[ImageCues, ...], list[LimbView]]] = deque(maxlen=_KEPT)
        self._box: tuple[tuple[Camera, ...], np.ndarray] | None = None

    def shows_person(self, observation: Observation) -> bool:
        """Whether there are enough keypoints, or a view shows the person."""
        return observation.has_enough_points or shows_person(self._views(observation))

    def pictures(self, observation: Observation) -> LimbLikelihood | None:
        """The likelihood of limbs by the pictures of a frame, None without any."""
        views = self._views(observation)
        if not views:
            return None
        box = self.box(observation)
        return LimbLikelihood(self._graph.limbs, views, settings=self._seen.pictures, box=box)

    def left_over(self, observation: Observation) -> LeftOver | None:
        """The person in the pictures of a frame, against which poses are held; None where no view shows where."""
        views = [view for view in self._views(observation) if view.foreground.size]
        return LeftOver(self._graph.limbs, views) if views else None

    def instant(self, rng: np.random.Generator, observation: Observation, *, anew: bool) -> Instant:
        """The measurements of a frame. anew: there is no frame before, so that importance functions are needed even
        where nothing is proposed."""
        pictures, box = self.pictures(observation), self.box(observation)
        part_proposals = self.part_proposals(rng, observation, pictures)
        proposals: tuple[Density | None, ...] = (None,) * len(self._graph.limbs)
        if anew or part_proposals:
            proposals = importance_functions(part_proposals, len(self._graph.limbs), box, self._detectors.importance)
        return Instant(observation.time, self.log_ratio(observation), proposals, box)

    def log_ratio(self, observation: Observation) -> LimbLogRatio | None:
        """Log ratio of limbs by a frame's pictures and keypoints together; None without any."""
        pictures = self.pictures(observation)
        if not self._seen.by_keypoints or not observation.count:
            return None if pictures is None else pictures.log_ratio
        body, sigma = self._model.body, self._model.keypoint_sigma(observation)
        evidence = KeypointEvidence(body, self._graph, observation, sigma, self._seen.keypoints, self._landmarks)
        if pictures is None:
            return evidence.log_likelihood

        def log_ratio(limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
            return np.asarray(pictures.log_ratio(limb, t, R) + evidence.log_likelihood(limb, t, R))

        return log_ratio

    @cached_property
    def _landmarks(self) -> tuple[LimbLandmarks, ...]:
        return landmarks_of_limbs(self._model.body, self._graph)

    def part_proposals(
        self, rng: np.random.Generator, observation: Observation, pictures: LimbLikelihood | None
    ) -> tuple[AllPartProposals, ...]:
        """The proposals of every enabled part detector for a frame."""
        said: list[AllPartProposals] = []
        if self._detectors.by_keypoints and observation.count:
            body, settings = self._model.body, self._detectors.keypoints
            said.append(keypoint_proposals(body, self._graph, observation, settings, self._landmarks))
        if self._detectors.by_hull and pictures is not None:
            said.append(hull_proposals(rng, self._graph, pictures, self._views(observation), self._detectors.hull))
        templates = self._templates
        if templates is not None and (views := observed_views(observation)):
            said.append(template_proposals(templates, self._graph, views))
        return tuple(said)

    def box(self, observation: Observation) -> np.ndarray:
        """Lowest and highest corner (2, 3) [m] of where limbs can be; raises InputError where cameras see no place in
        common."""
        if self._box is None or self._box[0] is not observation.cameras:
            s = self._seen.pictures
            self._box = observation.cameras, common_box(observation.cameras, s.farthest, s.margin)
        return self._box[1]

    @cached_property
    def _templates(self) -> LimbTemplates | None:
        return load_templates(self._detectors.templates) if self._detectors.templates else None

    def _views(self, observation: Observation) -> list[LimbView]:
        for cues, views in self._recent_views:
            if cues is observation.cues:
                return views
        views = limb_views(observation)
        self._recent_views.append((observation.cues, views))
        return views
