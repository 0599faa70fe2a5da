"""A cue of another package: a picture's middle of brightness draws a landmark. Registered by being imported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from estimator.numerics.robust import LORENTZIAN
from estimator.vision.cues.assigned import AssignedPoints, assignments, isotropic
from estimator.vision.cues.base import CameraView, Cue, Matcher
from estimator.vision.cues.cue_picture import CuePicture, Dots, dimmed, links
from estimator.vision.cues.settings import register


@dataclass(frozen=True)
class ToySettings:
    """How the landmark is drawn.

    landmark: its number. evidence: weight in a white picture. noise: as a fraction of the subject's extent.
    """

    landmark: int = 1
    evidence: float = 2.0
    noise: float = 0.5


class Toy(Cue):
    name, summary, settings = "toy", "where the picture is bright", ToySettings()

    def read(self, pictures: Any, instant: int, settings: ToySettings, prepared: Any) -> np.ndarray:
        moments = cv2.moments(cv2.cvtColor(pictures.picture(instant), cv2.COLOR_BGR2GRAY))
        return np.array([moments["m10"], moments["m01"]]) / max(moments["m00"], 1.0)

    def match(self, view: CameraView) -> Matcher:
        return ToyMatcher(view)


class ToyMatcher(Matcher):
    def terms(self, posed: Any, prediction: Any) -> list[AssignedPoints]:
        view, s, body, k = self.view, self.view.settings, self.view.body, [self.view.settings.landmark]
        precision = isotropic(np.full(1, 1.0 / view.sigma(s.noise) ** 2))
        weight = np.full(1, s.evidence * view.cues.picture.mean() / 255.0)
        group = assignments(np.zeros(1, int), view.cues["toy"][None], precision, weight, LORENTZIAN, 4.0)
        joint, local = body.landmark_joint[k], body.landmark_local[k]
        return [AssignedPoints(body, view.camera, joint, local, [group], name="bright middle")]

    def pictures(self, shown: Any) -> list[CuePicture]:
        lines = links(self.terms(shown.posed, shown.prediction)[0], shown.posed, "warn")
        layers = [lines, Dots(lines.end, "good", 4.0)]
        return [CuePicture("toy", "bright middle", dimmed(self.view.cues.picture), layers, [("bright middle", "good")])]


register(Toy())
