"""Depth as a cue: the person's points in space, matched to the nodes of the body that should be seen, and back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial import cKDTree

from estimator.cues.base import CameraView, Cue, Matcher, Shown
from estimator.cues.cue_picture import CuePicture, Dots, dimmed
from estimator.cues.depth.floor import Floor, found_floor
from estimator.cues.depth.matching import (
    Pairs,
    closest_nodes,
    closest_points,
    spread_over,
    surface_precision,
)
from estimator.cues.depth.person import nearest_thing
from estimator.cues.depth.settings import IDLE, DepthLikelihoodSettings, DepthSettings
from estimator.cues.depth.sources import DepthSource, depth_source
from estimator.imaging.camera_pictures import CameraPictures
from estimator.imaging.depth_map import DepthMap, Points
from estimator.prediction.prediction import Prediction
from estimator.terms.point_targets import PointTargets
from estimator.terms.term import Term
from estimator.terms.upright import world_up
from humanoid.kinematics.body import PosedBody, directions_in_world, points_in_world

_ON_GRID = 20_000  # pixels that are looked at, about
_JUMP, _FAR = 0.15, 1e3  # m, of the depth from a pixel to the next
_LEAST = 20  # points that say something
_SCENE_FRAMES, _FLOOR_POINTS = 9, 2000
AGREES = 3.0  # standard deviations within which a point lies on the surface


class Grid(NamedTuple):
    """Pixels (P,) of a depth picture that are looked at, every `step`-th, with the directions (P, 3) of their rays."""

    rows: np.ndarray
    columns: np.ndarray
    directions: np.ndarray
    step: int


class DepthScene(NamedTuple):
    """What is known of a clip: where its depth is from, the pixels that are looked at, up (3,), the floor, and the
    farthest that is seen at each of the pixels at some instants (P,) [m], NaN where nothing is."""

    source: DepthSource
    grid: Grid
    up: np.ndarray
    floor: Floor | None
    farthest: np.ndarray


@dataclass(frozen=True, eq=False)
class PersonPoints:
    """The person's surface as seen at one instant.

    points: some of it. pixels (M, 2): of the depth picture's pixels that show the person, in the camera of the cues.
    step [px]: between neighbouring ones.
    """

    points: Points
    pixels: np.ndarray
    step: float

    def mask(self, shape: tuple[int, ...]) -> np.ndarray:
        """Where the person is in a picture of some (height, width) of the cues, bool."""
        mask = np.zeros(shape[:2], np.uint8)
        x, y = np.round(self.pixels).astype(int).T
        inside = (x >= 0) & (x < mask.shape[1]) & (y >= 0) & (y < mask.shape[0])
        mask[y[inside], x[inside]] = 1
        side = 2 * int(np.ceil(0.5 * self.step)) + 1
        return cv2.dilate(mask, np.ones((side, side), np.uint8)) > 0


class Depth(Cue):
    """Points of the person's surface."""

    name = "depth"
    summary = "points of the surface in space, by stereo or a depth camera (ELMO section 3.2)"
    settings = DepthSettings()
    idle = IDLE
    needs_depth = True

    def prepare(self, pictures: CameraPictures, settings: DepthSettings) -> DepthScene | None:
        """Floor and scene, by some frames of a camera that stands still; None where no depth is given."""
        source = depth_source(pictures, settings)
        if source is None:
            return None
        grid, up = _grid(source), world_up((pictures.camera,))
        maps = [source.at(i) for i in pictures.instants(_SCENE_FRAMES)]
        some = [_seen(depth, grid, settings)[0] for depth in maps]
        at_pixels = np.array([depth.depth[grid.rows, grid.columns] for depth in maps])
        farthest = np.fmax.reduce(at_pixels)
        rng = np.random.default_rng(0)
        thinned = [p.some(rng.choice(len(p), min(len(p), _FLOOR_POINTS), replace=False)) for p in some]
        places, along = (np.concatenate([getattr(p, name) for p in thinned]) for name in ("places", "along"))
        return DepthScene(source, grid, up, found_floor(places, along, up, rng), farthest)

    def read(
        self, pictures: CameraPictures, instant: int, settings: DepthSettings, prepared: DepthScene | None
    ) -> PersonPoints | None:
        """See `Cue.read`; None where no person is seen."""
        if prepared is None:
            return None
        grid = prepared.grid
        depth = prepared.source.at(instant)
        points, where = _seen(depth, grid, settings)
        jumps = _jumps(depth, grid)
        if prepared.floor is not None:
            height = prepared.floor.height(points.places)
            above = height > settings.floor + 2.0 * points.along * np.abs(points.rays @ prepared.floor.normal)
            points, where = points.some(above), where[above]
        area = np.square(grid.step * points.across)
        values = depth.depth[grid.rows[where], grid.columns[where]]
        moved = prepared.farthest[where] - values > _JUMP + 3.0 * depth.noise * np.square(prepared.farthest[where])
        mine = nearest_thing(points, area, prepared.up, settings.gap, jumps[where], moved, len(grid.rows))
        if np.count_nonzero(mine) < _LEAST:
            return None
        points = points.some(mine)
        pixels = pictures.camera.project(points.places)
        return PersonPoints(points.some(spread_over(len(points), settings.points)), pixels, float(grid.step))

    def match(self, view: CameraView) -> Matcher:
        """See `Cue.match`."""
        return DepthMatcher(view)


class DepthMatcher(Matcher):
    """The person's points of one picture."""

    def __init__(self, view: CameraView) -> None:
        super().__init__(view)
        assert isinstance(view.likelihood, DepthLikelihoodSettings)
        self._settings = view.likelihood
        self._points: Points = view.cues[Depth.name].points

    def terms(self, posed: PosedBody, prediction: Prediction) -> list[Term]:
        """The closest pairs, from the nodes that should be seen to the points and back (ELMO eq. 1)."""
        if self._settings.depth_evidence <= 0.0:
            return []
        both = self._pairs(posed, prediction)
        s, surface = self._settings, self.view.surface
        node, point = (np.concatenate(parts) for parts in zip(*both, strict=True))
        joint, points = surface.joint[node], self._points.some(point)
        normals = directions_in_world(posed, joint, surface.normal[node])
        each = 0.5 * self.view.weight * s.depth_evidence
        weight = np.concatenate([np.full(len(pairs.node), each / len(pairs.node)) for pairs in both])
        precision = surface_precision(points, normals, s.depth_noise, s.depth_slide)
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
                nu=s.depth_nu,
                name=Depth.name,
            )
        ]

    def _pairs(self, posed: PosedBody, prediction: Prediction) -> tuple[Pairs, Pairs]:
        """From nodes to points and back. A body of which nothing is in the picture pays with all its nodes: what is
        seen is somebody's."""
        surface = self.view.surface
        nodes = np.flatnonzero(prediction.visible) if prediction.visible.any() else np.arange(len(surface.joint))
        places = points_in_world(posed, surface.joint[nodes], surface.local[nodes])
        return closest_points(self._tree, places, nodes), closest_nodes(self._points, places, nodes)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._points.places)

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
        return np.asarray(away < AGREES * np.hypot(points.along, self._settings.depth_noise))

    def pictures(self, shown: Shown) -> Iterator[CuePicture]:
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


def _grid(source: DepthSource) -> Grid:
    width, height = source.camera.image_size
    step = max(1, round(np.sqrt(width * height / _ON_GRID)))
    rows, columns = (x.ravel() for x in np.mgrid[step // 2 : height : step, step // 2 : width : step])
    directions = source.camera.directions(np.stack([columns, rows], axis=1).astype(float))
    return Grid(rows, columns, directions, step)


def _jumps(depth: DepthMap, grid: Grid) -> np.ndarray:
    """Which of the grid's pixels (P,) lie at a jump of the depth: what is seen there may lie between two things."""
    rows, columns = grid.rows // grid.step, grid.columns // grid.step
    values = np.full((rows.max() + 1, columns.max() + 1), np.nan, np.float32)
    values[rows, columns] = depth.depth[grid.rows, grid.columns]
    around, known = np.ones((3, 3), np.uint8), np.isfinite(values)
    far = cv2.dilate(np.where(known, values, np.float32(0.0)), around)
    near = cv2.erode(np.where(known, values, np.float32(_FAR)), around)
    jump = far - near > _JUMP + 3.0 * depth.noise * np.square(near)
    return np.asarray(jump[rows, columns])


def _seen(depth: DepthMap, grid: Grid, settings: DepthSettings) -> tuple[Points, np.ndarray]:
    """The places that a depth picture shows, and which of the grid's pixels these are."""
    values = depth.depth[grid.rows, grid.columns]
    where = np.flatnonzero(np.isfinite(values) & (values < settings.farthest))
    return depth.points(grid.rows[where], grid.columns[where], grid.directions[where]), where
