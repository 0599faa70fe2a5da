"""Flow as a cue: read from successive pictures, followed from where the surface was before (CSS eq. 9); single points
more exactly than the dense flow does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from estimator.energy.term import Term
from estimator.numerics.robust import LORENTZIAN
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.assigned import AssignedPoints, assignments, isotropic
from estimator.vision.cues.base import CameraView, Cue, ExplainedPose, Matcher, PastPose
from estimator.vision.cues.cue_picture import (
    CONTOUR_LEGEND,
    CuePicture,
    Dots,
    PixelLines,
    contour_dots,
    dimmed,
    relative,
)
from estimator.vision.cues.flow_field import FlowField, FlowSettings, flow_field
from estimator.vision.cues.part_patches import RETURNED, follow_patches, part_masks
from estimator.vision.cues.point_tracking import tracked_both_ways
from humanoid.kinematics.body import points_in_world
from humanoid.support.settings import setting

STRAY = 8.0  # px; a refined point this far from where the field led it has found something else
ELSEWHERE = 1.0  # px
DOUBTFUL = 0.8  # sureness below which a second try is worth its time: it came back half a pixel off


def follow_points(
    flow: FlowField, pixels: np.ndarray, guess: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) in this frame of points of the previous one, pixels (N, 2), and their confidence (N,), 0 to 1.

    The dense field is the start. Lucas and Kanade's iteration refines each point, forwards and backwards: the field is
    smooth over several pixels, and thin limbs need better. A `guess` (N, 2) starts a second try for points that the
    first one leaves in doubt or has found elsewhere; the one that returns nearer to its start is used. Points of one
    pixel move alike, so each pixel is computed once, however many points there are. Where the two images do not differ
    nothing moves, with full confidence.
    """
    points = np.clip(pixels, 0.0, np.array(flow.size) - 1.0)
    height, width = flow.outlier.shape
    here = points - flow.corner
    cell = np.floor(here + 0.5).astype(np.int64)
    inside = np.flatnonzero(((cell >= 0) & (cell < [width, height])).all(axis=1))
    moved, sure = np.zeros(points.shape), np.ones(len(points))
    expected = None if guess is None else (guess - flow.corner)[inside]
    moved[inside], sure[inside] = _moved(flow, here[inside], cell[inside], expected)
    return points + moved, sure


def _moved(
    flow: FlowField, points: np.ndarray, cell: np.ndarray, guess: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (N, 2) of points (N, 2) of the maps, in pixels `cell` (N, 2), and their confidence (N,)."""
    if not len(points):
        return np.zeros((0, 2)), np.zeros(0)
    width = flow.outlier.shape[1]
    _, first, of = np.unique(cell[:, 1] * width + cell[:, 0], return_index=True, return_inverse=True)
    moved, sure, cells = _followed_pixels(flow, cell[first].astype(np.float32))
    moved, sure = moved[of], sure[of]
    if guess is not None:
        elsewhere = np.square(guess - points - moved).sum(axis=1) > ELSEWHERE**2  # never where the guess is NaN
        again = np.flatnonzero(elsewhere | ((sure < DOUBTFUL) & np.isfinite(guess).all(axis=1)))
        if len(again):
            here = cells[of[again]]
            other, other_sure = _refined(flow, here, (here + guess[again] - points[again]).astype(np.float32))
            better = other_sure > sure[again]
            moved[again[better]], sure[again[better]] = (other - here)[better], other_sure[better]
    return moved, sure


def _followed_pixels(flow: FlowField, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements (N, 2) of the pixels (N, 2), near those of the dense field; their confidence (N,); the pixels."""
    x, y = cells.astype(np.int64).T
    predicted = cells + flow.flow[y, x]
    places, sure = _refined(flow, cells, predicted)
    lost = sure <= 0.0
    places[lost], sure[lost] = predicted[lost], 0.5 * (1.0 - flow.outlier[y, x][lost])
    return places - cells, sure, cells


def _refined(flow: FlowField, points: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Refined places (N, 2) of points that flow moves to `guess`, and their confidence (N,), zero where lost."""
    places, missed = tracked_both_ways(flow.before, flow.now, points, guess, levels=1)
    return places, _sureness(places, missed, guess)


def _sureness(places: np.ndarray, missed: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """Confidence (N,) of places (N, 2) by how much each misses its start, zero for those far from a guess (N, 2)."""
    near = np.square(places - guess).sum(axis=1) < STRAY**2
    return np.where(near, 1.0 / (1.0 + missed * missed), 0.0)


@dataclass(frozen=True)
class FlowCueSettings(FlowSettings):
    """Settings of flow: its computation and checks, and its part in the energy.

    evidence: independent measurements that all inside nodes together count as (CSS eq. 9), 0 for none. leading: as many
        as it counts while it leads a hypothesis to where the other cues are matched, at least `evidence`. There it has
        to win over the transition; as evidence it counts less, since it is relative to a pose that is itself uncertain.
    noise [px], share: standard deviation of the flow, and its part that grows with the flow's length. mixed: factor of
        both for points whose own part of the body has too little texture about them, so that pixels of other parts and
        of the background count, too. nu: Lorentzian.
    """

    evidence: float = setting(10.0, at_least=0)
    leading: float = setting(60.0, at_least=0)
    noise: float = setting(0.5, above=0)
    share: float = setting(0.1, at_least=0)
    mixed: float = setting(2.0, at_least=1)
    nu: float = setting(4.0, above=0)


FLOW_NODES = 200  # more give nothing new; beside keypoints flow has less weight, and fewer are enough
_FEWEST = 0.4  # share of them that is always followed


class Followed(NamedTuple):
    """Nodes (N,) followed by one camera's flow: where they were, (N, 2) [px], where they are now, (N, 2) [px], the
    confidence, (N,), 0 to 1, and which were followed by pixels of their own part of the body alone, (N,) bool."""

    node: np.ndarray
    before: np.ndarray
    target: np.ndarray
    sure: np.ndarray
    own: np.ndarray


_LOST = Followed(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool))


class Flow(Cue):
    """Optical flow of the body's surface since the frame before."""

    name = "flow"
    summary = "optical flow of the surface since the frame before (CSS section 3.1.2)"
    settings = FlowCueSettings()
    follows = True

    def read(self, pictures: CameraPictures, instant: int, settings: FlowSettings, prepared: Any) -> FlowField | None:
        """See `Cue.read`; None at the first frame."""
        before = pictures.before(instant)
        return None if before is None else flow_field(before, pictures.picture(instant), settings)

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return FlowMatcher(view)


class FlowMatcher(Matcher):
    """Flow of one image."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: FlowCueSettings = view.settings
        self._flow: FlowField = view.cues[Flow.name]

    def follow(self, pasts: Sequence[PastPose]) -> list[Followed]:
        """The nodes seen in each past and where they are now: the image is searched once for the points of all."""
        if not pasts or self._settings.evidence <= 0.0:
            return [_LOST for _ in pasts]
        seen = [self._seen(past) for past in pasts]
        pixels, guess, masks = (np.concatenate([part[k] for part in seen]) for k in (1, 2, 3))
        target, sure = follow_points(self._flow, pixels, guess)
        target, sure, own = self._by_own_part(pixels, target, sure, masks)
        followed, first = [], 0
        for node, before, _, _ in seen:
            part = slice(first, first + len(node))
            followed.append(Followed(node, before, target[part], sure[part], own[part]))
            first = part.stop
        return followed

    def _by_own_part(
        self, pixels: np.ndarray, target: np.ndarray, sure: np.ndarray, masks: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places (N, 2) and confidence (N,) of points at pixels (N, 2) that flow leads to target (N, 2), by the pixels
        of masks (N, SIDE, SIDE) alone where these suffice, (N,) bool; others stay as they are."""
        flow, corner = self._flow, np.array(self._flow.corner)
        places, missed = follow_patches(flow.before, flow.now, pixels - corner, target - corner, masks)
        places += corner
        sureness = _sureness(places, missed, target)
        own = (missed < RETURNED) & (sureness > 0.0)
        still = (target == pixels).all(axis=1)  # where the two images do not differ, neither does what is beside it
        return np.where(own[:, None], places, target), np.where(own, sureness, sure), own | still

    def since(self, followed: Followed) -> list[Term]:
        """See `Matcher.since`."""
        return self._tied(followed, self._settings.evidence)

    def leading(self, followed: Followed) -> list[Term]:
        """See `Matcher.leading`."""
        return self._tied(followed, max(self._settings.evidence, self._settings.leading))

    def _tied(self, followed: Followed, evidence: float) -> list[Term]:
        """The nodes at the places they were followed to, counted as a number of measurements together."""
        s, view = self._settings, self.view
        point, before, target, sure, own = followed
        if not len(point):
            return []
        length = np.linalg.norm(target - before, axis=1)
        precision = 1.0 / np.square((s.noise + s.share * length) * np.where(own, 1.0, s.mixed))
        weight = view.weight * evidence / len(point) * sure
        group = assignments(point, target, isotropic(precision), weight, LORENTZIAN, s.nu)
        surface = view.surface
        return [AssignedPoints(view.body, view.camera, surface.joint, surface.local, [group], name=Flow.name)]

    def _seen(self, past: PastPose) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Nodes (N,) seen in the frame before, where they were, (N, 2), where they are expected, (N, 2), or NaN, and
        the masks of their patches, see `part_masks`."""
        surface, prediction = self.view.surface, self.view.predictor.predict(past.parent)
        usable, enough = prediction.visible, round(FLOW_NODES * max(self.view.weight, _FEWEST))
        usable &= np.cumsum(usable) % max(1, np.count_nonzero(usable) // enough) == 0
        point = np.flatnonzero(usable)
        guess = np.full((len(point), 2), np.nan)
        if past.predicted is not None:
            world = points_in_world(past.predicted, surface.joint[point], surface.local[point])
            guess = self.view.camera.project(world)
        return point, prediction.pixels[point], guess, part_masks(prediction, surface, point)

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        picture = self.view.cues.picture
        motion = cv2.applyColorMap((255.0 * (1.0 - self._flow.whole_boundary())).astype(np.uint8), cv2.COLORMAP_INFERNO)
        grey = cv2.cvtColor(dimmed(picture), cv2.COLOR_GRAY2BGR)
        yield CuePicture(
            "motion_boundaries",
            "motion boundaries (bright)",
            cv2.addWeighted(grey, 0.5, motion, 0.9, 0.0),
            contour_dots(shown.prediction.contours, 1.8),
            CONTOUR_LEGEND,
        )
        yield CuePicture(
            "flow",
            "flow of the nodes",
            dimmed(picture, 0.55),
            [] if shown.past is None else self._ways(shown, shown.past),
            [
                ("from where a node was", "warn"),
                ("to where the flow takes it", "good"),
                ("to where the pose has it", "bad"),
            ],
        )

    def _ways(self, shown: ExplainedPose, past: PastPose) -> list[PixelLines | Dots]:
        (followed,) = self.follow([past])
        layers: list[PixelLines | Dots] = []
        for term in self.since(followed):
            assert isinstance(term, AssignedPoints)
            there = term.features(shown.posed)
            weight = relative(there.weight)
            before = self.view.camera.project(points_in_world(past.parent, there.joint, there.local))
            layers += [
                PixelLines(before, there.target, "warn", weight),
                PixelLines(there.target, there.pixels, "bad", weight),
                Dots(there.target, "good"),
            ]
        return layers
