"""Anchors as a cue: patches of the surface that are followed for some frames from the pose at which they began.

Flow ties a pose to the frame before alone, so that its errors add up from frame to frame. An anchor ties it to the pose
of up to half a second before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np

from estimator.energy.term import Term
from estimator.numerics.robust import LORENTZIAN
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.assigned import AssignedPoints, assignments, isotropic
from estimator.vision.cues.base import CameraView, Cue, ExplainedPose, Matcher, PastPose
from estimator.vision.cues.cue_picture import CuePicture, Dots, dimmed, links
from estimator.vision.cues.part_patches import LEAST_TEXTURE, RETURNED, SIDE, follow_patches, part_masks, texture_of
from estimator.vision.cues.point_tracking import tracked
from estimator.vision.prediction import Prediction
from humanoid.support.errors import InputError
from humanoid.support.per_object import per_object
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
_APART = 6  # px between anchors when they begin
_AWAY = 4.0  # standard deviations; an anchor farther from the pose is on something else
COLUMNS = 6 + SIDE  # of what is learned
_BITS = 1 << np.arange(SIDE)


class Anchors(NamedTuple):
    """Anchors at an instant: their nodes (N,) int, places (N, 2) [px], variances (N,) [px^2] of the place that a pose
    has, ages (N,) [s], and the pixels of their own part about them, (N, SIDE, SIDE) bool."""

    node: np.ndarray
    place: np.ndarray
    variance: np.ndarray
    age: np.ndarray
    mask: np.ndarray

    def where(self, chosen: np.ndarray) -> Anchors:
        """Those that are chosen, by a mask or indices."""
        return Anchors(*(column[chosen] for column in self))

    def packed(self, instant: int) -> np.ndarray:
        """As an array (MOST, `COLUMNS`) float64: instant, node, x, y, variance, age and the mask's rows as whole
        numbers, bit by bit; without an anchor a row has a node of -1."""
        rows = np.full((MOST, COLUMNS), -1.0)
        count = len(self.node)
        rows[:count, 0] = instant
        rows[:count, 1:6] = np.column_stack([self.node, self.place, self.variance, self.age])
        rows[:count, 6:] = self.mask @ _BITS
        return rows

    @staticmethod
    def unpacked(rows: np.ndarray, instant: int) -> Anchors:
        """Those of an array of `packed`, none where it is of another instant."""
        rows = rows[(rows[:, 1] >= 0.0) & (rows[:, 0] == instant)]
        mask = (rows[:, 6:, None].astype(np.int64) & _BITS) > 0
        return Anchors(rows[:, 1].astype(np.int64), rows[:, 2:4], rows[:, 4], rows[:, 5], mask)


class Anchored(NamedTuple):
    """What ties a pose to a past: the nodes (N,) of anchors, their places (N, 2) [px] in this picture, the variances
    (N,) [px^2], and the energy that the same anchors had in the picture before at the past.

    The error of the pose at which an anchor began is the same in every frame. So only the change of its energy is new
    evidence; over an anchor's life the changes add up to its last energy.
    """

    node: np.ndarray
    place: np.ndarray
    variance: np.ndarray
    counted: float


_NONE = Anchors(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, SIDE, SIDE), bool))
_UNANCHORED = Anchored(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), 0.0)


@dataclass(frozen=True, eq=False)
class AnchorReading:
    """Grey values (H, W) uint8 of a picture, and of that of the instant before, None where none counts as such; and the
    anchors there (MOST, COLUMNS), see `Anchors.packed`, None before the first pose."""

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
    follows = True
    beside_depth = False

    def read(self, pictures: CameraPictures, instant: int, settings: AnchorSettings, prepared: Any) -> AnchorReading:
        """See `Cue.read`."""
        before = pictures.before(instant)
        return AnchorReading(instant, _grey(pictures.picture(instant)), None if before is None else _grey(before))

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return AnchorMatcher(view)

    def with_learned(self, reading: AnchorReading, learned: np.ndarray) -> AnchorReading:
        """See `Cue.with_learned`."""
        if learned.shape != (MOST, COLUMNS):
            raise InputError("learned anchors", f"have the shape {learned.shape}, not {(MOST, COLUMNS)}")
        return replace(reading, learned=learned)


class AnchorMatcher(Matcher):
    """The anchors in one picture; none before the first pose."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: AnchorSettings = view.settings
        self._reading: AnchorReading = view.cues[Anchor.name]

    @cached_property
    def _followed(self) -> tuple[Anchors, Anchors]:
        """Those of the instant before that are in this picture, too: where they are, and where they were."""
        before, places = _continued(self._reading, len(self.view.surface.joint))
        return before._replace(place=places, variance=before.variance + self._settings.drift**2), before

    def follow(self, pasts: Sequence[PastPose]) -> list[Anchored]:
        """The anchors that were followed to this picture, and what they counted at each past."""
        now, before = self._followed
        if not len(now.node) or self._settings.evidence <= 0.0:
            return [_UNANCHORED for _ in pasts]
        counted = self._term(Anchored(now.node, before.place, now.variance, 0.0))
        return [Anchored(now.node, now.place, now.variance, counted.value(past.left or past.parent)) for past in pasts]

    def since(self, followed: Anchored) -> list[Term]:
        """See `Matcher.since`: the anchors where they were followed to, less what they counted before."""
        return [self._term(followed)] if len(followed.node) else []

    def _term(self, anchored: Anchored) -> AssignedPoints:
        node, place, variance, counted = anchored
        s, view, count = self._settings, self.view, len(node)
        weight = np.full(count, view.weight * s.evidence / max(count, _ENOUGH))
        group = assignments(np.arange(count), place, isotropic(1.0 / variance), weight, LORENTZIAN, s.nu)
        joint, local = view.surface.joint[node], view.surface.local[node]
        return AssignedPoints(
            view.body, view.camera, joint, local, [group], -counted, name=Anchor.name, moves_with_past=False
        )

    def learn(self, prediction: Prediction, elapsed: float, weight: float) -> np.ndarray:
        """See `Matcher.learn`: the anchors that are followed on, and those that begin."""
        old = self._followed[0]
        old = old._replace(age=old.age + elapsed)
        away = np.linalg.norm(prediction.pixels[old.node] - old.place, axis=1)
        agrees = away < _AWAY * np.sqrt(old.variance)
        old = old.where(prediction.visible[old.node] & agrees & (old.age <= self._settings.longest))
        old = old._replace(mask=self._masks(prediction, old.node))
        new = self._new_anchors(prediction, old.place, MOST - len(old.node))
        both = Anchors(*(np.concatenate(columns) for columns in zip(old, new, strict=True)))
        return both.packed(self._reading.instant)

    def _new_anchors(self, prediction: Prediction, taken: np.ndarray, most: int) -> Anchors:
        """New anchors on visible nodes with texture about them, away from those at `taken` (N, 2) [px]."""
        node = np.flatnonzero(prediction.visible)
        masks = self._masks(prediction, node)
        texture = texture_of(self._reading.now, prediction.pixels[node], masks)
        order = np.argsort(-texture, kind="stable")
        order = order[texture[order] >= LEAST_TEXTURE]
        pixels = np.floor(prediction.pixels[node[order]] + 0.5).astype(np.int64)
        order = order[_spread(pixels, taken)][:most]
        node, masks = node[order], masks[order]
        variance = np.full(len(node), self.view.sigma(self._settings.noise) ** 2)
        return Anchors(node, prediction.pixels[node], variance, np.zeros(len(node)), masks)

    def _masks(self, prediction: Prediction, node: np.ndarray) -> np.ndarray:
        return part_masks(prediction, self.view.surface, node)

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        base = dimmed(self.view.cues.picture, 0.55)
        (followed,) = self.follow([shown.past or PastPose(shown.posed)])
        for term in self.since(followed):
            assert isinstance(term, AssignedPoints)
            yield CuePicture(
                "anchors",
                "patches followed from earlier poses",
                base,
                [links(term, shown.posed, "hypothesis"), Dots(followed.place, "good")],
                [("an anchor", "good"), ("to where the pose has it", "hypothesis")],
            )


@per_object  # the search of a frame, what is learned of it and the smoother ask the same reading
def _continued(reading: AnchorReading, nodes: int) -> tuple[Anchors, np.ndarray]:
    """Anchors of the instant before, on a body of so many nodes, that are in a picture, too, and their places (N, 2)
    [px] there."""
    if reading.learned is None or reading.before is None:
        return _NONE, _NONE.place
    old = Anchors.unpacked(reading.learned, reading.instant - 1)
    if (old.node >= nodes).any():
        raise InputError("learned anchors", f"are on nodes that the body's {nodes} lack")
    points = old.place.astype(np.float32)
    guess, _ = tracked(reading.before, reading.now, points, points, _LEVELS)
    places, missed = follow_patches(reading.before, reading.now, old.place, guess, old.mask)
    hit = missed < RETURNED
    return old.where(hit), places[hit]


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
