"""What the loose-limbed tracker makes of one instant: the likelihood of limbs, and who shouts where they may be."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from estimator.cameras.camera import Camera
from estimator.imaging.image_cues import ImageCues
from estimator.imaging.observation import Observation
from estimator.inference.beliefs.mixture import Density
from estimator.limbs.instant import limb_views, shows_person
from estimator.limbs.likelihood import LimbLikelihood, LimbSettings, LimbView
from estimator.limbs.volume import common_box
from estimator.limbs.window import Instant
from estimator.search.shouters.contract import Shouts
from estimator.search.shouters.hull import HullSettings, hull_shouts
from estimator.search.shouters.importance import ImportanceSettings, importance_functions
from estimator.search.shouters.template_file import load_templates
from estimator.search.shouters.templates import LimbTemplates, observed_views, template_shouts
from estimator.trackers.beginning import enough_keypoints
from humanoid.limbs.limb import LimbGraph
from humanoid.support.settings import check

_KEPT = 2  # instants whose views are kept: that to come is asked for again as the present one


@dataclass(frozen=True)
class ShoutSettings:
    """Who says bottom-up where limbs may be, and how importance functions are made of it.

    by_hull: places that are foreground in all views, the likeliest for each limb. templates: a file of eigen-templates,
    made by `kinemode train-templates` for these cameras; none without. hull: of that. importance: of Q.
    """

    by_hull: bool = True
    templates: str = ""
    hull: HullSettings = field(default_factory=HullSettings)
    importance: ImportanceSettings = field(default_factory=ImportanceSettings)

    def __post_init__(self) -> None:
        check(self)


class InstantReader:
    """Makes likelihoods and importance functions of the frames of one clip; those of a frame that is asked for again
    are not read again."""

    def __init__(self, graph: LimbGraph, likelihood: LimbSettings, shout: ShoutSettings) -> None:
        self._graph, self._likelihood, self._shout = graph, likelihood, shout
        self._kept: deque[tuple[tuple[ImageCues, ...], list[LimbView]]] = deque(maxlen=_KEPT)
        self._box: tuple[tuple[Camera, ...], np.ndarray] | None = None

    def shows_person(self, observation: Observation) -> bool:
        """Whether there are enough keypoints, or a view shows the person."""
        return enough_keypoints(observation) or shows_person(self._views(observation))

    def pictures(self, observation: Observation) -> LimbLikelihood | None:
        """What the pictures of a frame say of limbs, None without any."""
        views = self._views(observation)
        if not views:
            return None
        box = self.box(observation)
        return LimbLikelihood(self._graph.limbs, views, settings=self._likelihood, box=box)

    def instant(self, rng: np.random.Generator, observation: Observation, *, anew: bool) -> Instant:
        """What is measured in a frame. anew: nothing is known of the frame before, so that importance functions are
        needed even where nobody shouts."""
        pictures, box = self.pictures(observation), self.box(observation)
        shouts = self.shouts(rng, observation, pictures)
        proposals: tuple[Density | None, ...] = (None,) * len(self._graph.limbs)
        if anew or shouts:
            proposals = importance_functions(shouts, len(self._graph.limbs), box, self._shout.importance)
        return Instant(observation.time, None if pictures is None else pictures.log_ratio, proposals, box)

    def shouts(
        self, rng: np.random.Generator, observation: Observation, pictures: LimbLikelihood | None
    ) -> tuple[Shouts, ...]:
        """What every shouter that is on says of a frame."""
        said: list[Shouts] = []
        if self._shout.by_hull and pictures is not None:
            said.append(hull_shouts(rng, self._graph, pictures, self._views(observation), self._shout.hull))
        templates = self._templates
        if templates is not None and (views := observed_views(observation)):
            said.append(template_shouts(templates, self._graph, views))
        return tuple(said)

    def box(self, observation: Observation) -> np.ndarray:
        """Lowest and highest corner (2, 3) [m] of where limbs can be; raises InputError where cameras see no place in
        common."""
        if self._box is None or self._box[0] is not observation.cameras:
            s = self._likelihood
            self._box = observation.cameras, common_box(observation.cameras, s.farthest, s.margin)
        return self._box[1]

    @cached_property
    def _templates(self) -> LimbTemplates | None:
        return load_templates(self._shout.templates) if self._shout.templates else None

    def _views(self, observation: Observation) -> list[LimbView]:
        for cues, views in self._kept:
            if cues is observation.cues:
                return views
        views = limb_views(observation)
        self._kept.append((observation.cues, views))
        return views
