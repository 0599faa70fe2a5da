"""The empty scene as each camera sees it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.synthesis import scene
from estimator.synthesis.clothing import SKIN, wall_grain
from estimator.synthesis.raster import paint, paint_index
from estimator.synthesis.settings import SceneSettings

FINE = 2  # pictures are painted this many times larger and then reduced
_ROOM_REACH, _ROOM_RADIUS = 3.5, 1.5  # cameras' distance and free radius that the room is made for [m]
_OCCLUDER_GAP = 0.45  # [m] between the person and the middle of an occluder
_EMPTY = 90.0  # grey of what no surface covers
_SWING_SECONDS, _SHAKE_HERTZ = 2.5, (3.1, 4.7)  # of the moving background


@dataclass(frozen=True)
class MotionArea:
    """Where the motion takes place [m]: convex outline (M, 2) from above, height of the floor and of the person."""

    outline: np.ndarray
    floor: float
    height: float

    @property
    def centre(self) -> np.ndarray:
        """Middle (2,) of the outline."""
        return np.asarray(0.5 * (self.outline.min(axis=0) + self.outline.max(axis=0)))

    @property
    def radius(self) -> float:
        """Of the circle around the centre that contains the outline."""
        return float(np.linalg.norm(self.outline - self.centre, axis=1).max())


ORIGIN = MotionArea(np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]), 0.0, 1.7)  # of the demonstration


def place_of(points: np.ndarray, floor: float | None = None) -> MotionArea:
    """The place that points (T, N, 3) [m] of a body need; by default the floor is under the lowest of them."""
    flat = points.reshape(-1, 3)
    low, high = flat[:, 2].min(), flat[:, 2].max()
    outline = cv2.convexHull(flat[:, :2].astype(np.float32))[:, 0].astype(float)
    return MotionArea(outline, float(low) if floor is None else floor, float(high - low))


@dataclass(frozen=True)
class Plate:
    """The empty scene in one camera, enlarged: image (H, W, 3) float32, nearness (H, W) as in `raster.paint` (0 where
    there is nothing), floor (H, W) bool."""

    image: np.ndarray
    nearness: np.ndarray
    floor: np.ndarray

    def reduced(self) -> np.ndarray:
        """The picture at the camera's own size, float32."""
        height, width = self.nearness.shape
        return np.asarray(cv2.resize(self.image, (width // FINE, height // FINE), interpolation=cv2.INTER_AREA))


def built_scene(
    settings: SceneSettings, cameras: Sequence[Camera], place: MotionArea, rng: np.random.Generator
) -> tuple[scene.Quads, scene.Quads]:
    """Background and occluders as rectangles in the world."""
    shift = np.array([*place.centre, place.floor])
    seen_from = np.array([c.origin_world for c in cameras]) - shift
    reach = float(np.linalg.norm(seen_from[:, :2], axis=1).max())
    if settings.background == "pillar":
        scale = max(1.0, (place.radius + 0.3) / 1.2)
        behind = scene.moved(scene.pillar_room(rng, azimuth_of(cameras[0], place), seen_from / scale), shift, scale)
    elif settings.background == "black":
        behind = scene.Quads(np.zeros((0, 4, 3)), np.zeros((0, 3)))
    else:
        shell, boxes = scene.cluttered_room(rng)
        scale = max(1.0, reach / _ROOM_REACH, place.radius / _ROOM_RADIUS, scene.enlargement_holding(seen_from))
        boxes = [scene.moved(box, shift, scale) for box in boxes]
        seen = [box for box in boxes if not any(_in_the_way(box, camera, place) for camera in cameras)]
        if settings.boards:
            shell = scene.joined([shell, scene.skin_boards(rng.spawn(1)[0], settings.boards, np.array(SKIN))])
        behind = scene.joined([scene.moved(shell, shift, scale), *seen])
    nothing = scene.Quads(np.zeros((0, 4, 3)), np.zeros((0, 3)))
    if settings.occluder == "none":
        return behind, nothing
    azimuth = azimuth_of(cameras[0], place)
    towards = np.array([np.cos(azimuth), np.sin(azimuth)])
    at = place.centre + (float(((place.outline - place.centre) @ towards).max()) + _OCCLUDER_GAP) * towards
    made = scene.occluder(rng, settings.occluder, at, azimuth, place.height)
    return behind, scene.moved(made, np.array([0.0, 0.0, place.floor]))


def _in_the_way(box: scene.Quads, camera: Camera, place: MotionArea) -> bool:
    """Whether a box may hide the person from a camera: it is nearer, and both overlap as seen from above."""
    centre = camera.origin_world[:2]
    towards = place.centre - centre
    if camera.parallel:  # of the way to the person, what is along the axis counts
        towards = (towards @ camera.R_camera_world[2, :2]) * camera.R_camera_world[2, :2]
        towards = towards / float(np.square(camera.R_camera_world[2, :2]).sum())
    distance = float(np.linalg.norm(towards))
    corners = box.corners.reshape(-1, 3)[:, :2] - centre
    depth = corners @ towards / distance
    if camera.parallel:
        off = _across(place.centre - centre, towards) / distance
        beside = np.abs(_across(corners, towards) / distance - off) < place.radius + 0.1
        return bool(depth.min() < distance and (beside & (depth > 0.0)).any())
    across = np.abs(_across(corners, towards)) / distance
    half = np.tan(np.arcsin(min(0.9, place.radius / distance)))
    return bool(depth.min() < distance and (across < half * np.maximum(depth, 0.0) + 0.1).any())


def _across(flat: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Of places (..., 2) how far to the left of a direction (2,) they are, times its length."""
    return np.asarray(flat[..., 1] * towards[0] - flat[..., 0] * towards[1])


def azimuth_of(camera: Camera, place: MotionArea) -> float:
    """Direction [rad] from which a camera sees a place, from above."""
    x, y = -camera.R_camera_world[2, :2] if camera.parallel else camera.centre_world[:2] - place.centre
    return float(np.arctan2(y, x))


def fine_pixels(camera: Camera, points: np.ndarray, factor: int = FINE) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the picture enlarged `factor` times (N, 2) and depths (N,) [m] of world points (N, 3)."""
    depth = camera.depths(points)
    return (camera.project(points) + 0.5) * factor - 0.5, depth


def painted_plate(
    camera: Camera, quads: scene.Quads, floor: float, rng: np.random.Generator | None, empty: float = _EMPTY
) -> Plate:
    """Paint rectangles; `rng` draws the grain of their surfaces, which is left out without it."""
    width, height = (side * FINE for side in camera.image_size)
    image = np.full((height, width, 3), empty, dtype=np.float32)
    nearness, on_floor = np.zeros((height, width)), np.zeros((height, width), dtype=np.int64)
    pixels, depth = fine_pixels(camera, quads.corners.reshape(-1, 3))
    faces = quad_faces(len(quads.corners))
    paint(image, nearness, pixels, depth, np.repeat(quads.colour, 4, axis=0), faces, camera.parallel)
    flat = np.tile((np.abs(quads.corners[..., 2] - floor) < 1e-6).all(axis=1), 2).astype(np.int64)
    paint_index(on_floor, np.zeros_like(nearness), pixels, depth, faces, flat, False, camera.parallel)
    if rng is not None:
        image *= wall_grain((height, width), rng)
    return Plate(np.clip(image, 0.0, 255.0), nearness, on_floor == 1)


def quad_faces(count: int) -> np.ndarray:
    """Two triangles (2 count, 3) of each rectangle."""
    corner = 4 * np.arange(count)[:, None]
    return np.concatenate([corner + np.array([0, 1, 2]), corner + np.array([0, 2, 3])])


def shifted(plate: Plate, settings: SceneSettings, time: float) -> Plate:
    """The plate of a moving background at a time [s]: far away, as a panning and trembling camera sees it."""
    first, second = (2.0 * np.pi * f * time for f in _SHAKE_HERTZ)
    dx = settings.pan * np.sin(2.0 * np.pi * time / _SWING_SECONDS) + settings.shake * np.sin(first)
    dy = 0.2 * settings.pan * np.sin(1.3 * np.pi * time / _SWING_SECONDS) + settings.shake * np.sin(second + 1.0)
    by = np.array([[1.0, 0.0, FINE * dx], [0.0, 1.0, FINE * dy]])
    size = plate.image.shape[1], plate.image.shape[0]
    return replace(plate, image=cv2.warpAffine(plate.image, by, size, borderMode=cv2.BORDER_REFLECT))
