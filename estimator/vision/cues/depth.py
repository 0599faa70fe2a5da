"""Depth as a cue: the person's points in space, matched to the nodes of the body that should be seen, and back."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from estimator.energy.point_targets import PointTargets
from estimator.energy.term import Term
from estimator.numerics.closest import closest
from estimator.vision.camera_pictures import CameraPictures, PersonMasks
from estimator.vision.cues.assigned import nothing
from estimator.vision.cues.base import CameraView, ContourMatch, Cue, ExplainedPose, Matcher
from estimator.vision.cues.cue_picture import CuePicture, Dots, dimmed
from estimator.vision.cues.depth_rays import NOTHING, Contradicted, depth_behind
from estimator.vision.cues.depth_reading import (
    DepthReading,
    DepthSettings,
    PersonPoints,
    closest_nodes,
    closest_points,
    surface_precision,
)
from estimator.vision.prediction import Prediction
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
        self._person: PersonPoints = view.cues[Depth.name]
        self._points = self._person.points

    def contours(self, prediction: Prediction) -> list[ContourMatch]:
        """What the depth of the body costs in squares of the picture: it ranks poses and, being that of the prediction,
        draws nothing. Pairs on one ray that draw end farther from the truth than closest pairs do."""
        energy = self._settings.repeated * self._of_squares(prediction)
        return [ContourMatch("depth in squares", nothing(), energy)] if energy else []

    def terms(self, posed: PosedBody, prediction: Prediction) -> list[Term]:
        """The closest pairs, from the nodes that should be seen to the points and back (ELMO eq. 1), nodes below the
        floor, and what the rays contradict."""
        if self._settings.evidence <= 0.0:
            return []
        nodes = self._should_be_seen(prediction)
        places = self._places(posed, nodes)
        return [self._pairs(posed, nodes, places), *self._below_floor(posed), *self._by_rays(nodes, places, prediction)]

    def _should_be_seen(self, prediction: Prediction) -> np.ndarray:
        """The nodes (N,) that should be seen. A body outside the picture is charged for all its nodes: what is seen
        belongs to a person."""
        return np.flatnonzero(prediction.visible) if prediction.visible.any() else np.arange(len(prediction.state))

    def _places(self, posed: PosedBody, nodes: np.ndarray) -> np.ndarray:
        surface = self.view.surface
        return points_in_world(posed, surface.joint[nodes], surface.local[nodes])

    def _pairs(self, posed: PosedBody, nodes: np.ndarray, places: np.ndarray) -> PointTargets:
        both = closest_points(self._points, places, nodes), closest_nodes(self._points, places, nodes)
        node, point = (np.concatenate(parts) for parts in zip(*both, strict=True))
        s, seen = self._settings, self._points.some(point)
        normals = directions_in_world(posed, self.view.surface.joint[node], self.view.surface.normal[node])
        precision = surface_precision(seen, normals, s.surface_noise, s.slide)
        weight = np.concatenate([np.full(len(p.node), 0.5 * s.evidence / len(p.node)) for p in both])
        return self._targets(node, seen.places, precision, weight)

    def _below_floor(self, posed: PosedBody) -> list[Term]:
        """Nodes below the floor, drawn up to it: nobody stands in it, whatever they may stand on."""
        s, floor = self._settings, self._person.floor
        if floor is None:
            return []
        places = self._places(posed, np.arange(len(self.view.surface.joint)))
        height = floor.height(places)
        low = np.flatnonzero(height < 0.0)
        if not len(low):
            return []
        upwards = np.outer(floor.normal, floor.normal) / s.surface_noise**2
        on_floor = places[low] - height[low, None] * floor.normal
        weight = np.full(len(low), 0.5 * s.evidence / len(places))
        return [self._targets(low, on_floor, np.tile(upwards, (len(low), 1, 1)), weight, "nodes below the floor")]

    def _by_rays(self, nodes: np.ndarray, places: np.ndarray, prediction: Prediction) -> list[Term]:
        """Nodes (N,) at places (N, 3) that the camera sees past, drawn to what it sees there, or to the closest point
        of the person where that is another thing; and the closest nodes drawn to the points that the body does not
        cover."""
        s, rays, points = self._settings, self._person.rays, self._points
        if s.rays <= 0.0:
            return []
        past = self._seen_past(places)
        beside = points.places[closest(places[past.place], points.places)[0]]
        met = np.where((past.point == NOTHING)[:, None], beside, rays.surface.places[past.point])
        off = depth_behind(self.view.camera, rays.surface.places, prediction)
        bare = rays.surface.places[off > AGREES * np.hypot(rays.surface.along, s.surface_noise)]
        node = nodes[np.concatenate([past.place, closest(bare, places)[0]])]
        if not len(node):
            return []
        weight = s.rays * np.concatenate([past.weight, np.full(len(bare), rays.share(s.patch))])
        anywhere = np.tile(np.eye(3) / s.slide**2, (len(node), 1, 1))
        return [self._targets(node, np.concatenate([met, bare]), anywhere, weight, "what rays contradict")]

    def without_past(self, prediction: Prediction) -> float:
        """See `Matcher.without_past`: the share of squares that frames with a past leave out."""
        return (1.0 - self._settings.repeated) * self._of_squares(prediction)

    def _of_squares(self, prediction: Prediction) -> float:
        s = self._settings
        if s.evidence <= 0.0 or s.squares <= 0.0:
            return 0.0
        energy = self._person.rays.squares_energy(prediction, s.surface_noise, s.patch, s.common, AGREES, s.most)
        return s.squares * self.view.weight * energy

    def _seen_past(self, places: np.ndarray) -> Contradicted:
        s = self._settings
        return self._person.rays.seen_past(places, s.surface_noise, AGREES, s.patch)

    def _targets(
        self, node: np.ndarray, target: np.ndarray, precision: np.ndarray, weight: np.ndarray, name: str = Depth.name
    ) -> PointTargets:
        """The term of nodes (P,) drawn to places (P, 3)."""
        body, surface = self.view.body, self.view.surface
        return PointTargets(
            body, surface.joint[node], surface.local[node], target, precision, weight=self.view.weight * weight,
            potential="lorentzian", nu=self._settings.nu, name=name,
        )  # fmt: skip

    def agreement(self, prediction: Prediction) -> float | None:
        """Share of the points that lie on the body's front as the camera sees it."""
        return float(np.mean(self._explained(prediction)))

    def _explained(self, prediction: Prediction) -> np.ndarray:
        """Which points (P,) bool are as far from the camera as the body that is seen there."""
        off = depth_behind(self.view.camera, self._points.places, prediction)
        return np.asarray(np.abs(off) < AGREES * np.hypot(self._points.along, self._settings.surface_noise))

    def pictures(self, shown: ExplainedPose) -> Iterator[CuePicture]:
        """See `Matcher.pictures`."""
        explained, at = self._explained(shown.prediction), self.view.camera.project(self._points.places)
        nodes = self._should_be_seen(shown.prediction)
        past = nodes[self._seen_past(self._places(shown.posed, nodes)).place]
        layers = [
            Dots(self._person.pixels, "muted", 1.0),
            Dots(at[explained], "good", 1.5),
            Dots(at[~explained], "bad", 1.5),
            Dots(shown.prediction.pixels[past], "warn", 1.5),
        ]
        base = cv2.cvtColor(dimmed(self.view.cues.picture), cv2.COLOR_GRAY2BGR)
        legend = [("points on the body as it lies", "good"), ("points before or behind it, or beside", "bad")]
        legend.append(("the body where the camera sees past it", "warn"))
        yield CuePicture(Depth.name, Depth.name, base, layers, legend)
