"""Pictures of a clothed body in a scene, with exact masks and depths."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.projection import AWAY
from estimator.synthesis import scene
from estimator.synthesis.clothing import LONG_SLEEVES, SKIN, Clothes, dressed
from estimator.synthesis.plate import (
    FINE,
    ORIGIN,
    MotionArea,
    Plate,
    azimuth_of,
    built_scene,
    fine_pixels,
    painted_plate,
    quad_faces,
    screens,
    shifted,
    swinging_boards,
)
from estimator.synthesis.raster import paint, paint_cloth, paint_index
from estimator.synthesis.scene import joined
from estimator.synthesis.settings import SceneSettings
from humanoid.kinematics.body import Body, PosedBody, directions_in_world, points_in_world
from humanoid.shape.surface import surface_of

_NODES = 6000
_SPECKLES = 0.04  # m


class Maps(NamedTuple):
    """Geometry seen at each pixel's centre.

    depth (H, W): along the optical axis [m], infinite where there is nothing. part (H, W) int: index of the visible
    part of the body into `Renderer.parts`, -1 elsewhere. mask (H, W) bool: where the body is visible.
    """

    depth: np.ndarray
    part: np.ndarray
    mask: np.ndarray


class _Placed(NamedTuple):
    """The body's nodes at one instant: world points, brightness, enlarged pixels, depths, shadow's pixels."""

    light: np.ndarray
    pixels: np.ndarray
    depth: np.ndarray
    shadow: np.ndarray | None


class Renderer:
    """Renders one body in one scene; everything random but the sensor's noise is drawn once, from `rng`.

    cameras: see `estimator.synthesis.views`; a parallel one shows what is beyond its plane. settings: see
    `SceneSettings`. place: where the motion takes place. parts: the links that the body's parts cover. dress: what the
    body wears, `estimator.synthesis.clothing`, of its surface and a random generator; of `dressed`, with the sleeves of
    the settings.

    Raises
    ------
    InputError: the subject has no surface, see `humanoid.shape.surface.surface_of`.
    """

    def __init__(
        self,
        body: Body,
        cameras: Sequence[Camera],
        rng: np.random.Generator,
        settings: SceneSettings | None = None,
        place: MotionArea = ORIGIN,
        dress: Callable[..., Clothes] = dressed,
    ) -> None:
        settings = settings or SceneSettings()
        self.settings = replace(settings, background=settings.background or "room")
        self.cameras, self._place = tuple(cameras), place
        self._surface = surface_of(body, nodes=_NODES)
        self.parts = self._surface.links
        self._face_part = self._surface.part[self._surface.faces[:, 0]]
        clothes_rng, rng = rng.spawn(2)  # the room is the same, whichever person stands in it
        others = {"others": LONG_SLEEVES} if dress is dressed and self.settings.sleeves == "long" else {}
        self._clothes = dress(self._surface, clothes_rng, **others)
        self._behind, self._before = built_scene(self.settings, self.cameras, place, rng)
        self._plates = self._painted_plates(rng)
        if self.settings.background == "moving":
            nothing = np.zeros_like(self._plates[0].nearness)
            self._plates = [Plate(p.image, nothing, nothing > 0.0) for p in self._plates]
        else:
            self._plates = [self._with_occluders(p, c) for p, c in zip(self._plates, self.cameras, strict=True)]
        self._reduced = [p.reduced() for p in self._plates]
        # the scene is the same, whenever the person is hidden
        self._screens = screens(self.cameras, place, rng.spawn(1)[0]) if settings.hidden else []
        covered = zip(self._plates, self.cameras, self._screens, strict=False)
        self._screened = [_covered(plate, camera, quads) for plate, camera, quads in covered]
        count, towards = self.settings.swinging, azimuth_of(self.cameras[0], place)
        self._swinging = swinging_boards(rng.spawn(1)[0], count, np.array(SKIN), place, towards) if count else []

    def frame(
        self, poses: PosedBody | Sequence[PosedBody], camera: int, rng: np.random.Generator, time: float = 0.0
    ) -> np.ndarray:
        """The picture of one camera, (H, W, 3) uint8 BGR.

        poses: the body while the shutter is open; one pose gives a picture without motion blur. camera: its index.
        rng: draws the noise of the sensor. time [s]: of the moving background, and whether a screen hides the person.
        """
        poses = [poses] if isinstance(poses, PosedBody) else poses
        view = self.cameras[camera]
        placed = [self._placed(posed, view) for posed in poses]
        plate = self._plate(camera, time)
        moving = self.settings.background == "moving" or bool(self._swinging)
        rows, columns = _window(placed, plate.nearness.shape, whole=moving)
        total = np.zeros_like(plate.image[rows, columns])
        for person in placed:
            total += self._painted(person, plate, rows, columns, parallel=view.parallel)
        total *= np.float32(1.0 / len(placed))
        picture = plate.reduced() if self.settings.hides(time) else self._reduced[camera].copy()
        half = (total.shape[1] // FINE, total.shape[0] // FINE)
        picture[_halved(rows), _halved(columns)] = cv2.resize(total, half, interpolation=cv2.INTER_AREA)
        return self._exposed(picture, rng)

    def plate(self, camera: int, time: float = 0.0) -> np.ndarray:
        """The empty scene without noise, and without a screen, (H, W, 3) uint8 BGR."""
        picture = (
            self._scenery(camera, time).reduced() if self.settings.background == "moving" else self._reduced[camera]
        )
        return self._exposed(picture.copy(), None)

    def maps(self, posed: PosedBody, camera: int, time: float = 0.0) -> Maps:
        """Exact depth and visible part at the centre of every pixel, without blur, at a time [s]."""
        view = self.cameras[camera]
        width, height = view.image_size
        nearness, part = np.zeros((height, width)), np.full((height, width), -1, dtype=np.int64)
        solid = self._before if self.settings.background == "moving" else joined([self._behind, self._before])
        solid = joined([solid, *(board.at(time) for board in self._swinging)])
        if self.settings.hides(time):
            solid = joined([solid, self._screens[camera]])
        pixels, depth = fine_pixels(view, solid.corners.reshape(-1, 3), 1)
        faces = quad_faces(len(solid.corners))
        paint_index(part, nearness, pixels, depth, faces, np.full(len(faces), -1), False, view.parallel)
        pixels, depth = fine_pixels(view, self._world(posed), 1)
        paint_index(part, nearness, pixels, depth, self._surface.faces, self._face_part, True, view.parallel)
        there = 2.0 * AWAY - nearness if view.parallel else 1.0 / np.maximum(nearness, 1e-12)
        seen = np.where(nearness > 0.0, there, np.inf)
        return Maps(seen, part, part >= 0)

    def _painted_plates(self, rng: np.random.Generator) -> list[Plate]:
        """The scene behind the person, by camera; speckles are alike in all, being the surfaces' own, grain is not."""
        floor, background = self._place.floor, self.settings.background
        if background == "textured":
            speckled = scene.speckled(self._behind, rng, _SPECKLES)
            return [painted_plate(c, speckled, floor, None) for c in self.cameras]
        empty = 0.0 if background == "black" else 90.0
        return [painted_plate(c, self._behind, floor, rng, empty) for c in self.cameras]

    def _plate(self, camera: int, time: float) -> Plate:
        """The scene behind the person, or in front of a hidden one."""
        plate = self._screened[camera] if self.settings.hides(time) else self._scenery(camera, time)
        for board in self._swinging:
            plate = _covered(plate, self.cameras[camera], board.at(time))
        return plate

    def _scenery(self, camera: int, time: float) -> Plate:
        plate = self._plates[camera]
        if self.settings.background != "moving":
            return plate
        return self._with_occluders(shifted(plate, self.settings, time), self.cameras[camera])

    def _with_occluders(self, plate: Plate, camera: Camera) -> Plate:
        return _covered(plate, camera, self._before)

    def _world(self, posed: PosedBody) -> np.ndarray:
        return points_in_world(posed, self._surface.joint, self._surface.local)

    def _placed(self, posed: PosedBody, view: Camera) -> _Placed:
        s, world = self.settings, self._world(posed)
        normals = directions_in_world(posed, self._surface.joint, self._surface.normal)
        sun = _towards_light(s)
        light = s.ambient + s.diffuse * np.clip(normals @ sun, 0.0, 1.0) + 0.12 * np.clip(normals[:, 2], -1.0, 0.0)
        shadow = None
        if s.shadow > 0.0 and s.background in ("room", "textured", "pillar"):
            shadow, _ = fine_pixels(view, world - (world[:, 2:] - self._place.floor) / sun[2] * sun)
        return _Placed(light, *fine_pixels(view, world), shadow)

    def _painted(self, placed: _Placed, plate: Plate, rows: slice, columns: slice, *, parallel: bool) -> np.ndarray:
        """A window of the enlarged picture of one instant."""
        image, nearness = plate.image[rows, columns].copy(), plate.nearness[rows, columns].copy()
        origin = np.array([columns.start, rows.start], dtype=float)
        if placed.shadow is not None:
            self._shade(image, placed.shadow - origin, plate.floor[rows, columns])
        paint_cloth(
            image, nearness, placed.pixels - origin, placed.depth, self._surface.local, self._clothes.colour,
            placed.light, self._surface.faces, self._face_part, self._clothes.pattern, self._clothes.grain, parallel,
        )  # fmt: skip
        return image

    def _shade(self, image: np.ndarray, pixels: np.ndarray, floor: np.ndarray) -> None:
        """Darken the floor where the body stands between it and the light."""
        mask = np.zeros(image.shape[:2], dtype=np.uint8)
        for part in range(len(self.parts)):
            hull = cv2.convexHull(pixels[self._surface.part == part].astype(np.float32))
            if np.isfinite(hull).all():
                cv2.fillConvexPoly(mask, np.round(hull).astype(np.int32), 255)
        strength = cv2.blur(mask, (15, 9)).astype(np.float32)[..., None] / np.float32(255.0)
        image *= np.float32(1.0) - np.float32(self.settings.shadow) * strength * floor[..., None]

    def _exposed(self, picture: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        """Lens blur and the sensor's noise."""
        if self.settings.lens_blur > 0.0:
            picture = cv2.GaussianBlur(picture, (0, 0), self.settings.lens_blur)
        if rng is not None and self.settings.noise > 0.0:
            picture += np.float32(self.settings.noise) * rng.standard_normal(picture.shape, dtype=np.float32)
        return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def _covered(plate: Plate, camera: Camera, quads: scene.Quads) -> Plate:
    """A plate with rectangles before it."""
    if not len(quads.corners):
        return plate
    image, nearness = plate.image.copy(), plate.nearness.copy()
    pixels, depth = fine_pixels(camera, quads.corners.reshape(-1, 3))
    colour = np.repeat(quads.colour, 4, axis=0)
    paint(image, nearness, pixels, depth, colour, quad_faces(len(quads.corners)), camera.parallel)
    return Plate(image, nearness, plate.floor & (nearness == plate.nearness))


def _towards_light(settings: SceneSettings) -> np.ndarray:
    a, e = np.radians(settings.light_azimuth), np.radians(settings.light_elevation)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _window(placed: Sequence[_Placed], shape: tuple[int, ...], *, whole: bool) -> tuple[slice, slice]:
    """Rows and columns of the enlarged picture that the body and its shadow can change, in whole final pixels."""
    height, width = shape
    if whole:
        return slice(0, height), slice(0, width)
    points = np.concatenate([p for person in placed for p in (person.pixels, person.shadow) if p is not None])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return slice(0, FINE), slice(0, FINE)
    low = np.clip(points.min(axis=0) - 16.0, 0.0, [width - FINE, height - FINE]).astype(int) // FINE * FINE
    high = np.clip(points.max(axis=0) + 16.0, low + FINE, [width, height]).astype(int) // FINE * FINE
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _halved(fine: slice) -> slice:
    return slice(fine.start // FINE, fine.stop // FINE)
