"""Description of a cue's diagnostic image, which `viz.cue_pictures` draws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from estimator.vision.cues.assigned import AssignedPoints
from estimator.vision.prediction import Contours
from estimator.vision.visibility import HIDDEN, INNER, OUTER
from humanoid.kinematics.body import PosedBody

Colour = str
"""By what it means: good, warn, bad, muted, text, hypothesis, left or right."""
CONTOUR_LEGEND: tuple[tuple[str, Colour], ...] = (
    ("outline", "good"), ("within the body", "warn"), ("hidden", "muted"),
)  # fmt: skip
_CONTOURS = {HIDDEN: "muted", INNER: "warn", OUTER: "good"}


class Area(NamedTuple):
    """Pixels tinted: strength (H, W) uint8, 0 for not at all."""

    strength: np.ndarray
    colour: Colour


class PixelLines(NamedTuple):
    """Lines between pixels (N, 2), fainter where weight (N,), 0 to 1, is small."""

    start: np.ndarray
    end: np.ndarray
    colour: Colour
    weight: np.ndarray | None = None


class Dots(NamedTuple):
    """Small discs at pixels (N, 2)."""

    at: np.ndarray
    colour: Colour
    radius: float = 2.0


class CuePicture(NamedTuple):
    """A picture of a cue's evidence for a pose; all pixels are those of the cues.

    name: ends the file's. title: what is shown. base (H, W) or (H, W, 3) uint8 BGR: what is drawn on. layers: from
    below. legend: what the colours mean.
    """

    name: str
    title: str
    base: np.ndarray
    layers: Sequence[Area | PixelLines | Dots]
    legend: Sequence[tuple[str, Colour]]


def dimmed(picture: np.ndarray | None, strength: float = 0.45) -> np.ndarray:
    """A picture (H, W, 3) uint8 BGR, darker and without colour, (H, W), so that what is drawn on it stands out."""
    assert picture is not None
    return (cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) * strength).astype(np.uint8)


def contour_dots(contours: Contours, radius: float = 2.2) -> list[Dots]:
    """The points of contours by what is seen of them; `CONTOUR_LEGEND` explains the colours."""
    return [Dots(contours.pixels[contours.state == s], colour, radius) for s, colour in _CONTOURS.items()]


def links(term: AssignedPoints, posed: PosedBody, colour: Colour) -> PixelLines:
    """Lines from the points of a term at a pose to the features assigned to them."""
    features = term.features(posed)
    return PixelLines(features.pixels, features.target, colour, relative(features.weight))


def relative(weight: np.ndarray) -> np.ndarray:
    """Weights (N,) beside the largest, 0 to 1."""
    return np.asarray(weight / max(float(weight.max(initial=0.0)), 1e-300))
