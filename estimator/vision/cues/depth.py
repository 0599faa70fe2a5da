"""Depth as a cue: the person's points in space, matched to the nodes of the body that should be seen, and back."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from estimator.energy.point_targets import PointTargets
from estimator.energy.term import Term
from estimator.vision.camera_pictures import CameraPictures, PersonMasks
from estimator.vision.cues.base import CameraView, Cue, ExplainedPose, Matcher
from estimator.vision.cues.cue_picture import CuePicture, Dots, dimmed
from estimator.vision.cues.depth_reading import (
    DepthReading,
    DepthSettings,
    NodePointPairs,
    PersonPoints,
    closest_nodes,
    closest_points,
    surface_precision,
)
from estimator.vision.prediction import Prediction
from estimator.vision.stereo import DepthPoints
from humanoid.kinematics.body import PosedBody, directions_in_world, points_in_world

AGREES = 3.0  # standard deviations within which a point lies on the surface


class Depth(Cue):
    """Points of the person's surface."""

    name = "depth"
    summary = "points of the surface in space, by stereo or a depth camera (ELMO section 3.2)"
    settings = DepthSettings()
    needs_depth = True

    def prepare(self, pictures: CameraPictures, settings: DepthSettings) -> DepthReading | None:
        """See `DepthReading.of`."""
        return DepthReading.of(pictures, settings)

    def person_masks(self, prepared: DepthReading | None) -> PersonMasks | None:
        """See `Cue.person_masks`."""
        return prepared

    def read(
        self, pictures: CameraPictures, instant: int, settings: DepthSettings, prepared: DepthReading | None
    ) -> PersonPoints | None:
        """See `Cue.read`; None where no person is seen."""
        return None if prepared is None else prepared.at(instant)

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return DepthMatcher(view)


class DepthMatcher(Matcher):
    """The person's points of one picture."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        self._settings: DepthSettings = view.settings
        self._points: DepthPoints = view.cues[Depth.name].points

    def terms(self, posed: PosedBody, prediction: Prediction) -> list[Term]:
        """The closest pairs, from the nodes that should be seen to the points and back (ELMO eq. 1)."""
        if self._settings.evidence <= 0.0:
            return []
        both = self._pairs(posed, prediction)
        s, surface = self._settings, self.view.surface
        node, point = (np.concatenate(parts) for parts in zip(*both, strict=True))
        joint, points = surface.joint[node], self._points.some(point)
        normals = directions_in_world(posed, joint, surface.normal[node])
        each = 0.5 * self.view.weight * s.evidence
        weight = np.concatenate([np.full(len(pairs.node), each / len(pairs.node)) for pairs in both])
        precision = surface_precision(points, normals, s.surface_noise, s.slide)
        body, local = self.view.body, surface.local[node]
        return [
            PointTargets(
                body,
                joint,
                local,
                points.places,
                precision,
                weight=weight,
                potential="lorentzian",
                nu=s.nu,
                name=Depth.name,
            )
        ]

    def _pairs(self, posed: PosedBody, prediction: Prediction) -> tuple[NodePointPairs, NodePointPairs]:
        """From nodes to points and back. A body outside the picture is charged for all its nodes: what is seen belongs
        to a person."""
        surface = self.view.surface
        nodes = np.flatnonzero(prediction.visible) if prediction.visible.any() else np.arange(len(surface.joint))
        places = points_in_world(posed, surface.joint[nodes], surface.local[nodes])
        return closest_points(self._points, places, nodes), closest_nodes(self._points, places, nodes)

    def agreement(self, prediction: Prediction) -> float | None:
        """Share of the points that lie on the body's front as the camera sees it."""
        return float(np.mean(self._explained(prediction)))

    def _explained(self, prediction: Prediction) -> np.ndarray:
        """Which points (P,) bool are as far from the camera as the body that is seen there."""
        points, camera = self._points, self.view.camera
        left, top, size = prediction.frame
        cells = np.nan_to_num((camera.project(points.places) - [left, top]) / size + 0.5, nan=-1.0).astype(int)
        rows, columns = prediction.buffer.shape
        inside = ((cells >= 0) & (cells < [columns, rows])).all(axis=1)
        nearness = np.zeros(len(points))
        nearness[inside] = prediction.buffer[cells[inside, 1], cells[inside, 0]]
        depth = points.places @ camera.R_camera_world[2] + camera.t_camera_world[2]
        away = np.abs(1.0 / np.maximum(nearness, 1e-9) - depth)
        return np.asarray(away < AGREES * np.hypot(points.along, self._settings.surface_noise))

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        explained, at = self._explained(shown.prediction), self.view.camera.project(self._points.places)
        layers = [
            Dots(self.view.cues[Depth.name].pixels, "muted", 1.0),
            Dots(at[explained], "good", 1.5),
            Dots(at[~explained], "bad", 1.5),
        ]
        base = cv2.cvtColor(dimmed(self.view.cues.picture), cv2.COLOR_GRAY2BGR)
        legend = [("points on the body as it lies", "good"), ("points before or behind it, or beside", "bad")]
        yield CuePicture(Depth.name, Depth.name, base, layers, legend)
