"""The empty scene as each camera sees it, and screens that hide the person wholly."""

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
        """The radius of the circle around the centre that contains the outline."""
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
    """How far places (..., 2) are to the left of a direction (2,), times its length."""
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


_SHARE = 0.5  # of the way to the nearest that the person may be
_SPECKLE = 0.012  # of the distance: a few pixels
_MARGIN = 1.05  # on the sides that just fill the pictures
_BORDER = 9  # places along each side of a picture, which the lens bends


def screens(cameras: Sequence[Camera], place: MotionArea, rng: np.random.Generator) -> list[scene.Quads]:
    """By camera, a speckled rectangle across its axis, nearer than all of the place and larger than what it sees.

    Cameras that look the same way stand side by side and have one screen, so that stereo finds its depth.
    """
    made: dict[bytes, scene.Quads] = {}
    for camera in cameras:
        way = camera.R_camera_world.round(9).tobytes()
        if way not in made:
            beside = [c for c in cameras if c.R_camera_world.round(9).tobytes() == way]
            made[way] = _screen(beside, place, rng)
    return [made[camera.R_camera_world.round(9).tobytes()] for camera in cameras]


def _screen(cameras: Sequence[Camera], place: MotionArea, rng: np.random.Generator) -> scene.Quads:
    """One before cameras (at least one) that look the same way."""
    R = cameras[0].R_camera_world
    heights = np.array([place.floor, place.floor + place.height])
    ends = np.array([[*corner, height] for corner in place.outline for height in heights]) @ R[2]
    front = max(float(c.origin_world @ R[2]) for c in cameras)
    distance = _SHARE * (float(ends.min()) - front)
    edges = np.concatenate([_edge(c, front + distance) for c in cameras])
    low, high = edges.min(axis=0)[:2], edges.max(axis=0)[:2]
    middle, half = 0.5 * (low + high), 0.5 * _MARGIN * (high - low)
    corner = np.array([*(middle - half), front + distance]) @ R
    return scene.screen(rng, corner, 2.0 * half[0] * R[0], 2.0 * half[1] * R[1], _SPECKLE * distance)


def _edge(camera: Camera, along: float) -> np.ndarray:
    """Places (N, 3) [m], in axes that are the camera's, all around the border of its picture, at z = `along`."""
    width, height = camera.image_size
    x, y = np.linspace(-0.5, width - 0.5, _BORDER), np.linspace(-0.5, height - 0.5, _BORDER)
    pixels = [np.stack([x, np.full(_BORDER, end)], axis=1) for end in y[[0, -1]]]
    pixels += [np.stack([np.full(_BORDER, end), y], axis=1) for end in x[[0, -1]]]
    border, R = np.concatenate(pixels), camera.R_camera_world
    if camera.parallel:
        return camera.rays(border)[0] @ R.T * [1.0, 1.0, 0.0] + [0.0, 0.0, along]
    return camera.directions(border) * (along - camera.centre_world @ R[2]) + camera.centre_world @ R.T


_BEHIND = 0.35  # m from the place to the nearest board


_APART = 0.05  # m between two boards' planes


@dataclass(frozen=True, eq=False)
class SwingingDistractor:
    """A board: quads where it hangs in the middle of its swing; way (3,) [m]: from there to where it turns. seconds: of
    a whole swing. phase [rad]: at time 0."""

    quads: scene.Quads
    way: np.ndarray
    seconds: float
    phase: float

    def at(self, time: float) -> scene.Quads:
        """The board at a time [s]."""
        return scene.moved(self.quads, self.way * np.sin(2.0 * np.pi * time / self.seconds + self.phase))


def swinging_boards(
    rng: np.random.Generator, count: int, colour: np.ndarray, place: MotionArea, azimuth: float
) -> list[SwingingDistractor]:
    """Boards (count) of about a colour (3,) BGR, behind a place as seen from `azimuth` [rad], as high as chest and head
    of a person standing there."""
    made = []
    for k in range(count):
        size, height = rng.uniform([0.08, 0.1], [0.3, 0.35]), rng.uniform(0.7, 1.5)
        board = scene.skin_board(rng, np.array([0.0, -0.5 * size[0], height]), size, colour)
        back = -(place.radius + _BEHIND + _APART * k)
        board = scene.turned(scene.moved(board, np.array([back, rng.uniform(-0.3, 0.3), 0.0])), azimuth)
        way = rng.uniform(0.3, 0.8) * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        shift = np.array([*place.centre, place.floor])
        made.append(
            SwingingDistractor(scene.moved(board, shift), way, rng.uniform(2.0, 4.0), rng.uniform(0.0, 2.0 * np.pi))
        )
    return made
