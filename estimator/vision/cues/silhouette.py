"""The silhouette as a cue: separated from the background, matched from the body's outline to its own and back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.numerics.robust import LECLERC, LORENTZIAN
from estimator.vision.camera_pictures import CameraPictures, PersonMasks
from estimator.vision.cues.assigned import Assignments, nothing
from estimator.vision.cues.background import FEWEST_FRAMES, KnownBody
from estimator.vision.cues.base import CameraView, ContourMatch, Cue, ExplainedPose, Matcher
from estimator.vision.cues.cue_picture import Area, CuePicture, Dots, PixelLines, dimmed, links
from estimator.vision.cues.foreground import (
    Background,
    Silhouette,
    SilhouetteSettings,
    background_beside,
    foreground_mask,
    learn_background,
    person_mask,
    silhouette_of,
)
from estimator.vision.cues.outline_matching import across_outline, nearest_contour, nearest_outline
from estimator.vision.prediction import Prediction
from estimator.vision.visibility import OUTER
from humanoid.support.settings import setting


@dataclass(frozen=True)
class SilhouetteCueSettings(SilhouetteSettings):
    """Settings of the silhouette: the separation of the person from the background, and the outline's part in the
    energy.

    evidence: independent measurements that the foreground's outline counts as, 0 for none: half from the model's
        contour to the outline (Leclerc: a limb missing from the foreground must pull nothing), half the other way
        (Lorentzian).
    noise: standard deviation, as a fraction of the subject's extent. nu: spread of both.
    """

    evidence: float = setting(60.0, at_least=0)
    noise: float = setting(0.02, above=0)
    nu: float = setting(8.0, above=0)


OUTLINE_SAMPLES = 200
AGREES = 4.0  # standard deviations within which a contour point lies on the outline
NEAR_EDGE = 2  # px between an outline and the edge that bears it out
SURE_EDGE, LEAST_TRUST = 0.3, 0.1  # strength that proves an outline; trust where there is no edge at all
ON_SILHOUETTE = 0.6  # share of the keypoints that a silhouette has to cover to be the person's
_WIDTHS = 0.3, 1.0, 1.8  # of the body's own: within it surely, about its outline, and surely beyond it
_NEAR = 3.0  # px around it, at the cues' resolution


class BesidePerson(NamedTuple):
    """Constants of a clip where another cue shows about where the person is: the background beside them, None without
    one."""

    background: Background | None


class Outline(Cue):
    """The outline of what differs from the background, only about the person where another cue, such as depth, locates
    them."""

    name = "silhouette"
    summary = "the outline of what differs from the background, which is learned, given, or given as masks"
    settings = SilhouetteCueSettings()
    on_contours = True
    uses_masks = True

    def prepare(self, pictures: CameraPictures, settings: SilhouetteSettings) -> Background | BesidePerson | None:
        """The background, of a given picture or learned from the clip; None where there is none, or masks are given."""
        if pictures.has_masks:
            return None
        plate = pictures.plate()
        if plate is not None:
            mean = plate.astype(np.float32)
            return Background(mean, np.full_like(mean, 2.0), np.ones(mean.shape[:2], bool))
        if pictures.person_masks is not None:
            return BesidePerson(_beside(pictures, pictures.person_masks, settings))
        frames, instants = pictures.spread(settings.frames)
        bodies = [None if i is None else KnownBody(*(pictures.body(i, w) for w in _WIDTHS)) for i in instants]
        return _noted(pictures, learn_background(frames, settings, bodies), len(frames))

    def read(
        self,
        pictures: CameraPictures,
        instant: int,
        settings: SilhouetteSettings,
        prepared: Background | BesidePerson | None,
    ) -> Silhouette | None:
        """See `Cue.read`; None without a background, or where it is known that no person is there."""
        mask = pictures.mask(instant)
        if mask is not None:
            return silhouette_of(mask)
        if prepared is None:
            return None
        if isinstance(prepared, BesidePerson):
            assert pictures.person_masks is not None
            person = pictures.person_masks.mask(instant)
            if person is None:
                return None
            return silhouette_of(person_mask(pictures.picture(instant), person, prepared.background, settings))
        return silhouette_of(foreground_mask(pictures.picture(instant), prepared, settings), prepared.known)

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return OutlineMatcher(view)

    def doubt(self, cues: ImageCues, keypoints: np.ndarray, instant: int) -> str:
        """A background learned from a clip includes a person who hardly moves."""
        silhouette: Silhouette = cues[self.name]
        x, y = np.clip(keypoints + 0.5, 0, np.array(cues.camera.image_size) - 1).astype(int).T
        known = silhouette.known[y, x]
        if known.mean() < 1.0 - ON_SILHOUETTE:
            said = f"the background behind {np.mean(~known):.0%} of the keypoints of frame {instant} is never seen"
            return f"{said}: the silhouette has no part there; give masks or a picture of the empty scene"
        share = float(np.mean(silhouette.distance[y, x][known] < _NEAR))
        if share >= ON_SILHOUETTE:
            return ""
        said = f"the silhouette of frame {instant} has {share:.0%} of the keypoints on it"
        return f"{said}; give masks or a picture of the empty scene"


def _beside(pictures: CameraPictures, persons: PersonMasks, settings: SilhouetteSettings) -> Background | None:
    instants = pictures.instants(settings.frames)
    frames, masks = [pictures.picture(i) for i in instants], [persons.mask(i) for i in instants]
    return _noted(pictures, background_beside(frames, masks), len(frames), "; the person is as wide as depth has them")


def _noted(pictures: CameraPictures, background: Background | None, frames: int, so: str = "") -> Background | None:
    """The same, with a message why there is none and what follows from it."""
    if background is None:
        why = "the camera moves" if frames >= FEWEST_FRAMES else "the clip is too short"
        pictures.note(f"{why}, no background model{so}")
    return background


class OutlineMatcher(Matcher):
    """The silhouette of one image. Edges of the picture, where known, show which parts of its outline are real."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: SilhouetteCueSettings = view.settings
        self._silhouette: Silhouette = view.cues[Outline.name]

    def contours(self, prediction: Prediction) -> list[ContourMatch]:
        """From the model's contour to the foreground's outline, and back."""
        if self._settings.evidence <= 0.0:
            return []
        labels = "body to silhouette", "silhouette to body"
        if not (len(self._silhouette.boundary) and len(prediction.contours.state)):
            return [ContourMatch(label, nothing()) for label in labels]
        back, lost = self._back(prediction)
        return [ContourMatch(labels[0], self._there(prediction)), ContourMatch(labels[1], back, lost)]

    def _there(self, prediction: Prediction) -> Assignments:
        contours = prediction.contours
        chosen = np.empty(len(contours.state), dtype=np.int64)
        nearest_outline(contours.pixels, contours.state, self._silhouette.nearest, chosen)
        return self._to_outline(np.arange(len(chosen)), chosen, self._share(len(contours.state)), LECLERC)

    def _back(self, prediction: Prediction) -> tuple[Assignments, float]:
        """The features, and the energy of those without a contour."""
        contours, extent = prediction.contours, self.view.extent
        place, samples, normals = self._samples
        chosen = np.empty(len(samples), dtype=np.int64)
        nearest_contour(samples, normals, contours.pixels, contours.normals, contours.state, 0.2 * extent, chosen)
        each = self._share(len(samples))
        group = self._to_outline(chosen, place, each, LORENTZIAN)
        if len(group.point) == len(chosen):
            return group, 0.0
        s = self._settings
        lost = self._trust[place][chosen < 0].sum()  # all, where no contour of the model is in the picture
        far = s.nu * np.log1p((extent / self.view.sigma(s.noise)) ** 2 / s.nu)
        return group, each * 0.5 * far * float(lost)

    @cached_property
    def _samples(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Some boundary pixels (S,), with their places and normals (S, 2)."""
        silhouette = self._silhouette
        place = np.arange(0, len(silhouette.boundary), max(1, len(silhouette.boundary) // OUTLINE_SAMPLES))
        return place, silhouette.boundary[place], silhouette.normal[place]

    def _share(self, count: int) -> float:
        """Weight of one of `count` assignments of one direction."""
        return 0.5 * self.view.weight * self._settings.evidence / count

    def _to_outline(self, point: np.ndarray, place: np.ndarray, each: float, potential: int) -> Assignments:
        """Assignments of boundary pixels `place` (N,) to contour points `point` (N,), where neither is negative."""
        s, outline = self._settings, self._silhouette
        precision = 1.0 / self.view.sigma(s.noise) ** 2
        nu = float(s.nu)
        parts = across_outline(
            point, place, outline.boundary, outline.normal, self._trust, precision, each, potential, nu
        )
        return Assignments(*parts)

    def agreement(self, prediction: Prediction) -> float | None:
        """Share of the model's outline that lies on the foreground's."""
        silhouette, contours = self._silhouette, prediction.contours
        outer = contours.state == OUTER
        if not len(silhouette.boundary) or not outer.any():
            return None
        x, y = np.round(contours.pixels[outer]).astype(int).T
        distance = np.abs(
            silhouette.distance[y.clip(0, len(silhouette.mask) - 1), x.clip(0, silhouette.mask.shape[1] - 1)]
        )
        return float(np.mean(distance < AGREES * self.view.sigma(self._settings.noise)))

    @cached_property
    def _trust(self) -> np.ndarray:
        """The support of each boundary pixel of the foreground by an edge of the picture along it, (M,), 0 to 1.

        Outlines that no known background proves count nothing, and where a background model takes the place that a
        person has left for foreground, its outline lies on no edge.
        """
        silhouette, edges = self._silhouette, self.view.cues.get("edges")
        if edges is None or not len(silhouette.boundary):
            return silhouette.certain.astype(float)
        height, width = edges.strength.shape
        best = np.zeros(len(silhouette.boundary))
        for offset in range(-NEAR_EDGE, NEAR_EDGE + 1):
            x, y = np.round(silhouette.boundary + offset * silhouette.normal).astype(int).T
            x, y = x.clip(0, width - 1), y.clip(0, height - 1)
            along = np.abs(np.einsum("ni,ni->n", edges.direction[y, x], silhouette.normal))
            best = np.maximum(best, edges.strength[y, x] * along)
        trust = LEAST_TRUST + (1.0 - LEAST_TRUST) * np.minimum(1.0, best / SURE_EDGE)
        return np.where(silhouette.certain, trust, 0.0)

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        contours = shown.prediction.contours
        layers: list[Area | PixelLines | Dots] = [Area(np.where(self._silhouette.mask, 70, 0).astype(np.uint8), "text")]
        for match, colour in zip(self.contours(shown.assigned), ("left", "right"), strict=False):
            if len(match.features.point):
                lines = links(self.view.on_contours(shown.assigned, match.features), shown.posed, colour)
                layers += [lines, Dots(lines.end, colour, 1.5)]
        yield CuePicture(
            "silhouette",
            "silhouette",
            cv2.cvtColor(dimmed(self.view.cues.picture), cv2.COLOR_GRAY2BGR),
            [*layers, Dots(contours.pixels[contours.state == OUTER], "good")],
            [("body's outline", "good"), ("to the silhouette's", "left"), ("and from it back", "right")],
        )
