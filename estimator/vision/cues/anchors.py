"""Anchors as a cue: patches of the surface that are followed for some frames from the pose at which they began.

Flow ties a pose to the frame before alone, so that its errors add up from frame to frame. An anchor ties it to the pose
of up to half a second before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np

from estimator.energy.term import Term
from estimator.numerics.robust import LORENTZIAN
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.assigned import AssignedPoints, assignments, isotropic
from estimator.vision.cues.base import CameraView, Cue, ExplainedPose, Matcher
from estimator.vision.cues.cue_picture import CuePicture, Dots, dimmed, links
from estimator.vision.cues.point_tracking import tracked_both_ways
from estimator.vision.prediction import Prediction
from humanoid.kinematics.body import PosedBody
from humanoid.support.errors import InputError
from humanoid.support.settings import setting


@dataclass(frozen=True)
class AnchorSettings:
    """Settings of anchors: how long they are followed, and their part in the energy.

    evidence: independent measurements that all anchors together count as, 0 for none; fewer where there are less than
        half as many as nodes that flow follows.
    noise: standard deviation, as a fraction of the subject's extent, of where the pose at which an anchor began has it.
    drift [px]: what each frame adds to it. longest [s]: how long an anchor is followed. nu: Lorentzian.
    """

    evidence: float = setting(10.0, at_least=0)
    noise: float = setting(0.02, above=0)
    drift: float = setting(0.5, at_least=0)
    longest: float = setting(0.5, above=0)
    nu: float = setting(4.0, above=0)


MOST = 300
"""Anchors at a time: rows of what is learned."""
_ENOUGH = 100  # with fewer anchors each counts no more
_LEVELS = 2  # of the pyramid: about 20 px a frame
_RETURNED = 1.0  # px; what is followed back and misses its start by more has found something else
_APART = 6  # px between anchors when they begin
_BORDER = 3.0  # px from an anchor that begins to where there is no body: its patch shows the body
_AWAY = 4.0  # standard deviations; an anchor farther from the pose is on something else
_TEXTURE = 2e-4
"""Least eigenvalue of a patch of `_PATCH` pixels, as OpenCV has it, with which an anchor begins: slopes of 1.8 grey
values a pixel in the direction in which they are smallest. With a noise of 3 grey values in either picture a window of
11 x 11 pixels is found there with a standard deviation of 0.2 px."""
_PATCH = 7  # px across, of that eigenvalue


class Anchors(NamedTuple):
    """Anchors at an instant: their nodes (N,) int, places (N, 2) [px], variances (N,) [px^2] of the place that a pose
    has, and ages (N,) [s]."""

    node: np.ndarray
    place: np.ndarray
    variance: np.ndarray
    age: np.ndarray

    def where(self, chosen: np.ndarray) -> Anchors:
        """Those that are chosen, by a mask or indices."""
        return Anchors(*(column[chosen] for column in self))

    def packed(self, instant: int) -> np.ndarray:
        """As an array (MOST, 6) float64: node, x, y, variance, age, instant; without an anchor a row has a node of
        -1."""
        rows = np.full((MOST, 6), -1.0)
        rows[: len(self.node)] = np.column_stack([*self, np.full(len(self.node), float(instant))])
        return rows

    @staticmethod
    def unpacked(rows: np.ndarray, instant: int) -> Anchors:
        """Those of an array of `packed`, none where it is of another instant."""
        rows = rows[(rows[:, 0] >= 0.0) & (rows[:, 5] == instant)]
        return Anchors(rows[:, 0].astype(np.int64), rows[:, 1:3], rows[:, 3], rows[:, 4])


_NONE = Anchors(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class AnchorReading:
    """Grey values (H, W) uint8 of a picture, and of that of the instant before, None where none counts as such; and the
    anchors there (MOST, 6), see `Anchors.packed`, None before the first pose."""

    instant: int
    now: np.ndarray
    before: np.ndarray | None
    learned: np.ndarray | None = None


class Anchor(Cue):
    """Patches of the surface that are followed from the pose at which they began."""

    name = "anchors"
    summary = "patches of the surface, followed for up to half a second from the pose at which they began"
    settings = AnchorSettings()
    learns = True
    by_default = False

    def read(self, pictures: CameraPictures, instant: int, settings: AnchorSettings, prepared: Any) -> AnchorReading:
        """See `Cue.read`."""
        before = pictures.before(instant)
        return AnchorReading(instant, _grey(pictures.picture(instant)), None if before is None else _grey(before))

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return AnchorMatcher(view)

    def with_learned(self, reading: AnchorReading, learned: np.ndarray) -> AnchorReading:
        """See `Cue.with_learned`."""
        if learned.shape != (MOST, 6):
            raise InputError("learned anchors", f"have the shape {learned.shape}, not {(MOST, 6)}")
        return replace(reading, learned=learned)


class AnchorMatcher(Matcher):
    """The anchors in one picture; none before the first pose."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: AnchorSettings = view.settings
        self._reading: AnchorReading = view.cues[Anchor.name]

    @cached_property
    def _continued(self) -> Anchors:
        """Those of the instant before, where they are in this picture."""
        r = self._reading
        if r.learned is None or r.before is None:
            return _NONE
        old = Anchors.unpacked(r.learned, r.instant - 1)
        if (old.node >= len(self.view.surface.joint)).any():
            raise InputError("learned anchors", f"are on nodes that the body's {len(self.view.surface.joint)} lack")
        points = old.place.astype(np.float32)
        places, missed = tracked_both_ways(r.before, r.now, points, points, _LEVELS)
        now = old._replace(place=places.astype(float), variance=old.variance + self._settings.drift**2)
        return now.where(missed < _RETURNED)

    def terms(self, posed: PosedBody, prediction: Prediction) -> list[Term]:
        """The anchors where they were followed to."""
        s, view, anchors = self._settings, self.view, self._continued
        count = len(anchors.node)
        if not count or s.evidence <= 0.0:
            return []
        weight = np.full(count, view.weight * s.evidence / max(count, _ENOUGH))
        precision = isotropic(1.0 / anchors.variance)
        group = assignments(np.arange(count), anchors.place, precision, weight, LORENTZIAN, s.nu)
        joint, local = view.surface.joint[anchors.node], view.surface.local[anchors.node]
        return [AssignedPoints(view.body, view.camera, joint, local, [group], name=Anchor.name)]

    def learn(self, prediction: Prediction, elapsed: float, weight: float) -> np.ndarray:
        """See `Matcher.learn`: the anchors that are followed on, and those that begin."""
        old = self._continued
        old = old._replace(age=old.age + elapsed)
        away = np.linalg.norm(prediction.pixels[old.node] - old.place, axis=1)
        agrees = away < _AWAY * np.sqrt(old.variance)
        old = old.where(prediction.visible[old.node] & agrees & (old.age <= self._settings.longest))
        new = self._new_anchors(prediction, old.place, MOST - len(old.node))
        both = Anchors(*(np.concatenate(columns) for columns in zip(old, new, strict=True)))
        return both.packed(self._reading.instant)

    def _new_anchors(self, prediction: Prediction, taken: np.ndarray, most: int) -> Anchors:
        """New anchors on visible nodes with texture about them, away from those at `taken` (N, 2) [px]."""
        node = np.flatnonzero(prediction.visible)
        node = node[within_body(prediction, prediction.pixels[node], _BORDER)]
        last = np.array(self._reading.now.shape[::-1]) - 1
        pixels = np.floor(prediction.pixels[node] + 0.5).astype(np.int64).clip(0, last)
        texture = texture_at(self._reading.now, pixels)
        order = np.argsort(-texture, kind="stable")
        order = order[texture[order] >= _TEXTURE]
        node = node[order[_spread(pixels[order], taken)]][:most]
        variance = np.full(len(node), self.view.sigma(self._settings.noise) ** 2)
        return Anchors(node, prediction.pixels[node], variance, np.zeros(len(node)))

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        base = dimmed(self.view.cues.picture, 0.55)
        for term in self.terms(shown.posed, shown.prediction):
            assert isinstance(term, AssignedPoints)
            yield CuePicture(
                "anchors",
                "patches followed from earlier poses",
                base,
                [links(term, shown.posed, "hypothesis"), Dots(self._continued.place, "good")],
                [("an anchor", "good"), ("to where the pose has it", "hypothesis")],
            )


def texture_at(grey: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The smaller eigenvalue of the structure tensor of patches of grey (H, W) uint8 about pixels (N, 2) int, (N,)."""
    if not len(pixels):
        return np.zeros(0, np.float32)
    left, top = np.maximum(pixels.min(axis=0) - _PATCH, 0)
    right, bottom = pixels.max(axis=0) + _PATCH + 1
    column, row = (pixels - [left, top]).T
    return np.asarray(cv2.cornerMinEigenVal(np.ascontiguousarray(grey[top:bottom, left:right]), _PATCH)[row, column])


def within_body(prediction: Prediction, pixels: np.ndarray, margin: float) -> np.ndarray:
    """Which pixels (N, 2) are on the predicted body, as are those `margin` [px] to each of four sides, (N,) bool."""
    within = np.ones(len(pixels), bool)
    for side in margin * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]):
        cells, inside = prediction.cells(pixels + side)
        within &= inside
        within[inside] &= prediction.owner[cells[inside, 1], cells[inside, 0]] >= 0
    return within


def _spread(pixels: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Indices of the first of pixels (N, 2) int in each square of `_APART` pixels without any of `taken` (M, 2)."""
    used = set(map(tuple, (np.floor(taken + 0.5).astype(np.int64) // _APART).tolist()))
    chosen = []
    for k, square in enumerate(map(tuple, (pixels // _APART).tolist())):
        if square not in used:
            used.add(square)
            chosen.append(k)
    return np.array(chosen, dtype=np.int64)


def _grey(picture: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
