"""Flow as a cue: read from successive pictures, followed from where the surface was before (CSS eq. 9)."""

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
from estimator.vision.cues.flow.flow_field import FlowField, FlowSettings, flow_field
from estimator.vision.cues.flow.point_flow import follow_points
from humanoid.kinematics.body import points_in_world
from humanoid.support.settings import setting


@dataclass(frozen=True)
class FlowCueSettings(FlowSettings):
    """Settings of flow: its computation and checks, and its part in the energy.

    evidence: independent measurements that all inside nodes together count as (CSS eq. 9), 0 for none. leading: as many
        as it counts while it leads a hypothesis to where the other cues are matched, at least `evidence`. There it has
        to win over the transition; as evidence it counts less, since it is relative to a pose that is itself uncertain.
    noise [px], share: standard deviation of the flow, and its part that grows with the flow's length. nu: Lorentzian.
    """

    evidence: float = setting(10.0, at_least=0)
    leading: float = setting(60.0, at_least=0)
    noise: float = setting(0.5, above=0)
    share: float = setting(0.1, at_least=0)
    nu: float = setting(4.0, above=0)


FLOW_NODES = 200  # more give nothing new; beside keypoints flow has less weight, and fewer are enough
_FEWEST = 0.4  # share of them that is always followed


class Followed(NamedTuple):
    """Nodes (N,) followed by one camera's flow: where they were, (N, 2) [px], where they are now, (N, 2) [px], and the
    confidence, (N,), 0 to 1."""

    node: np.ndarray
    before: np.ndarray
    target: np.ndarray
    sure: np.ndarray


_LOST = Followed(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))


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
        pixels, guess = (np.concatenate([part[k] for part in seen]) for k in (1, 2))
        target, sure = follow_points(self._flow, pixels, guess)
        followed, first = [], 0
        for node, before, _ in seen:
            own = slice(first, first + len(node))
            followed.append(Followed(node, before, target[own], sure[own]))
            first = own.stop
        return followed

    def since(self, followed: Followed) -> list[Term]:
        """See `Matcher.since`."""
        return self._tied(followed, self._settings.evidence)

    def leading(self, followed: Followed) -> list[Term]:
        """See `Matcher.leading`."""
        return self._tied(followed, max(self._settings.evidence, self._settings.leading))

    def _tied(self, followed: Followed, evidence: float) -> list[Term]:
        """The nodes at the places they were followed to, counted as a number of measurements together."""
        s, view = self._settings, self.view
        point, before, target, sure = followed
        if not len(point):
            return []
        length = np.linalg.norm(target - before, axis=1)
        precision = 1.0 / np.square(s.noise + s.share * length)
        weight = view.weight * evidence / len(point) * sure
        group = assignments(point, target, isotropic(precision), weight, LORENTZIAN, s.nu)
        surface = view.surface
        return [AssignedPoints(view.body, view.camera, surface.joint, surface.local, [group], name=Flow.name)]

    def _seen(self, past: PastPose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes (N,) seen in the frame before, where they were, (N, 2), and where they are expected, (N, 2), or NaN."""
        surface, prediction = self.view.surface, self.view.predictor.predict(past.parent)
        usable, enough = prediction.visible, round(FLOW_NODES * max(self.view.weight, _FEWEST))
        usable &= np.cumsum(usable) % max(1, np.count_nonzero(usable) // enough) == 0
        point = np.flatnonzero(usable)
        guess = np.full((len(point), 2), np.nan)
        if past.predicted is not None:
            world = points_in_world(past.predicted, surface.joint[point], surface.local[point])
            guess = self.view.camera.project(world)
        return point, prediction.pixels[point], guess

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
