"""Colours of limbs as a cue: learned in the first frame and in those since, matched along the normals of contours."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.numerics.robust import LECLERC
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.assigned import assignments, nothing
from estimator.vision.cues.base import CameraView, ContourMatch, Cue, ExplainedPose, Matcher
from estimator.vision.cues.colour_matching import MATCHED, MISSING, OFF, find_borders, limb_costs
from estimator.vision.cues.colour_model import ColourReading, LimbColours, colour_bins, seen_colours, updated
from estimator.vision.cues.cue_picture import CuePicture, Dots, links
from estimator.vision.prediction import Prediction
from estimator.vision.visibility import HIDDEN
from humanoid.support.errors import InputError
from humanoid.support.settings import setting


@dataclass(frozen=True)
class ColourSettings:
    """Settings of the colours of limbs: how they are learned, and their part in the energy.

    evidence: independent measurements that all contour points together count as, 0 for none. inside: the same of the
        pixels within limbs, whose colours move no pose but choose between poses.
    noise: standard deviation of a border, as a fraction of the subject's extent. window: how far along the normal it is
        searched for, in extents. share: of its log-likelihood ratio that a pixel counts. nu: Leclerc spread.
    limbs, behind: time constants [s] with which the colours of limbs, and of what lies beside them, follow those seen.
    """

    evidence: float = setting(40.0, at_least=0)
    inside: float = setting(10.0, at_least=0)
    noise: float = setting(0.02, above=0)
    window: float = setting(0.12, above=0)
    share: float = setting(0.25, above=0, at_most=1)
    nu: float = setting(6.0, above=0)
    limbs: float = setting(2.0, above=0)
    behind: float = setting(0.2, above=0)


_DIMMED = 0.6  # brightness of the picture that is drawn on


class Colour(Cue):
    """Colours of limbs, and of what lies behind them."""

    name = "colour"
    summary = "the colours of limbs against those behind them, learned in the first frame and where they are seen since"
    settings = ColourSettings()
    learns = True
    beside_depth = False

    def read(self, pictures: CameraPictures, instant: int, settings: ColourSettings, prepared: Any) -> ColourReading:
        """See `Cue.read`."""
        return ColourReading(colour_bins(pictures.picture(instant)))

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return ColourMatcher(view)

    def with_learned(self, reading: ColourReading, learned: np.ndarray) -> ColourReading:
        """See `Cue.with_learned`."""
        return reading.with_learned(learned)


class ColourMatcher(Matcher):
    """The colours of one picture beside the learned ones; nothing before there are any."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: ColourSettings = view.settings
        self._reading: ColourReading = view.cues[Colour.name]
        self._colours: LimbColours | None = self._reading.colours
        parts = len(view.surface.links)
        if self._colours is not None and len(self._colours.apart) != parts:
            raise InputError("learned colours", f"are of {len(self._colours.apart)} parts, the body has {parts}")

    def contours(self, prediction: Prediction) -> list[ContourMatch]:
        """Where along the contours' normals the limbs' colours end, and what the pixels within limbs cost."""
        if self._colours is None:
            return []
        return [*self._borders(prediction, self._colours), *self._insides(prediction, self._colours)]

    def _borders(self, prediction: Prediction, colours: LimbColours) -> list[ContourMatch]:
        s, view, contours = self._settings, self.view, prediction.contours
        count = len(contours.state)
        if s.evidence <= 0.0 or not count:
            return []
        offset, variance, weight, status = self.borders(prediction)
        each = view.weight * s.evidence / count
        hidden = contours.state == HIDDEN
        apart = colours.apart[self._parts(prediction)[hidden], -1].sum()
        lost = 0.5 * s.nu * weight[status == MISSING].sum() + view.shared.occluded * view.shared.back_facing * apart
        point = np.flatnonzero(status == MATCHED)
        normal, sigma = contours.normals[point], view.sigma(s.noise)
        precision = 1.0 / (sigma**2 + variance[point])
        target = contours.pixels[point] + offset[point, None] * normal
        x, y = normal.T
        along = precision[:, None] * np.stack([x * x, x * y, y * y], axis=1)
        group = assignments(point, target, along, each * weight[point], LECLERC, s.nu)
        return [ContourMatch("colour", group, each * float(lost), "limb of another colour, or hidden")]

    def borders(self, prediction: Prediction) -> tuple[np.ndarray, ...]:
        """Offset, variance, weight and status (M,) of the contour points, see `find_borders`. Colours must be known."""
        s, view, contours, colours = self._settings, self.view, prediction.contours, self._colours
        assert colours is not None
        count = len(contours.state)
        offset, variance, weight, status = np.empty(count), np.empty(count), np.empty(count), np.empty(count, np.int8)
        find_borders(
            contours.pixels, contours.normals, contours.state, self._parts(prediction), prediction.owner,
            prediction.frame, self._reading.bins, colours.log_density, colours.apart,
            max(2.0, s.window * view.extent), 2.0 * view.sigma(s.noise), s.share, offset, variance, weight, status,
        )  # fmt: skip
        return offset, variance, weight, status

    def _parts(self, prediction: Prediction) -> np.ndarray:
        """Part (M,) of each contour point."""
        return np.asarray(self.view.surface.part[prediction.contours.nodes[:, 0]])

    def _insides(self, prediction: Prediction, colours: LimbColours) -> list[ContourMatch]:
        if self._settings.inside <= 0.0:
            return []
        costs, visible = np.empty(len(prediction.state)), prediction.visible
        limb_costs(
            prediction.pixels, visible, self.view.surface.part, self._reading.bins, colours.log_density, colours.apart,
            costs,
        )  # fmt: skip
        each = self.view.weight * self._settings.inside / max(1, int(np.count_nonzero(visible)))
        return [ContourMatch("colours within limbs", nothing(), each * float(costs.sum()))]

    def learn(self, prediction: Prediction, elapsed: float, weight: float) -> np.ndarray | None:
        """See `Matcher.learn`."""
        s = self._settings
        band = max(2.0, s.window * self.view.extent)
        seen = seen_colours(self._reading.bins, prediction, len(self.view.surface.links), band)
        limbs, behind = (weight * -math.expm1(-elapsed / float(constant)) for constant in (s.limbs, s.behind))
        return updated(self._reading.learned, seen, limbs, behind)

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        picture, contours = self.view.cues.picture, shown.prediction.contours
        if self._colours is None:
            return
        assert picture is not None
        *_, status = self.borders(shown.prediction)
        groups = [match.features for match in self.contours(shown.assigned) if len(match.features.point)]
        lines = [links(self.view.on_contours(shown.assigned, g), shown.posed, "hypothesis") for g in groups]
        kinds = ((OFF, "muted"), (MATCHED, "good"), (MISSING, "bad"))
        dots = [Dots(contours.pixels[(status == k) & (contours.state != HIDDEN)], colour) for k, colour in kinds]
        yield CuePicture(
            "colour", "colours of limbs and behind them", (_DIMMED * picture).astype(np.uint8), [*lines, *dots],
            [("colours differ", "good"), ("and the limb is not here", "bad"), ("alike, or unknown: not used", "muted"),
             ("to where the limb's colours end", "hypothesis")],
        )  # fmt: skip
