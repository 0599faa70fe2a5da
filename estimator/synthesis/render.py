"""Pictures of a clothed body in a cluttered room."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from estimator.imaging.camera import Camera
from estimator.synthesis.raster import paint
from estimator.synthesis.scene import cluttered_room
from humanoid.body import Body, PosedBody
from humanoid.errors import InputError
from humanoid.flesh import FleshMesh, flesh_meshes

_FINE = 2  # pictures are painted this many times larger and then reduced
_NOISE = 2.5  # of the picture, standard deviation in grey values
_AROUND, _ALONG = 28, 18  # triangles of a solid
_SUN = np.array([0.45, -0.25, 0.86])  # towards the light, world frame
_AMBIENT, _DIFFUSE = 0.5, 0.6
_SHADOW = 0.55
_SKIN, _SHIRT, _TROUSERS, _SHOES, _HAIR = (
    np.array(c, dtype=np.float64)
    for c in ((128, 158, 214), (150, 92, 38), (72, 66, 70), (48, 52, 150), (28, 36, 52))  # BGR
)
_CLOTHES = {
    "pelvis": _TROUSERS, "thigh": _TROUSERS, "shank": _TROUSERS, "foot": _SHOES, "torso": _SHIRT, "upper_arm": _SHIRT,
    "neck": _SKIN, "head": _SKIN, "forearm": _SKIN, "hand": _SKIN,
}  # fmt: skip


class Renderer:
    """Renders one body in front of one room; everything random is drawn once, from `rng`.

    Raises
    ------
    InputError: the subject has no flesh.
    """

    def __init__(self, body: Body, cameras: tuple[Camera, ...], rng: np.random.Generator) -> None:
        if not body.subject.flesh:
            raise InputError(body.subject.source, "has no flesh to render", remedy="add <flesh> to its links")
        meshes = flesh_meshes(body, _AROUND, _ALONG)
        starts = np.cumsum([0] + [len(m.vertices) for m in meshes])[:-1]
        self.cameras = cameras
        self._local = np.concatenate([m.vertices for m in meshes])
        self._joint = np.concatenate([np.full(len(m.vertices), m.joint) for m in meshes])
        self._faces = np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=True)])
        self._normals = np.concatenate([vertex_normals(m.vertices, m.faces) for m in meshes])
        self._colour = np.concatenate([_clothing(m, rng) for m in meshes])
        self._solid = np.split(np.arange(len(self._local)), starts[1:])
        room = cluttered_room(rng)
        self._rooms = [_room_picture(camera, room.corners, room.colour, rng) for camera in cameras]

    def frame(self, posed: PosedBody, camera: int, rng: np.random.Generator) -> np.ndarray:
        """The picture of one camera, (H, W, 3) uint8 BGR; `rng` draws the noise of the sensor."""
        view = self.cameras[camera]
        image, nearness = (array.copy() for array in self._rooms[camera])
        R = posed.rotations[self._joint]
        world = np.einsum("nij,nj->ni", R, self._local) + posed.translations[self._joint]
        normals = np.einsum("nij,nj->ni", R, self._normals)
        self._shadow(image, world, view)
        light = _AMBIENT + _DIFFUSE * np.clip(normals @ _SUN, 0.0, 1.0) + 0.12 * np.clip(normals[:, 2], -1.0, 0.0)
        pixels, depth = _fine_pixels(view, world)
        paint(image, nearness, pixels, depth, self._colour * light[:, None], self._faces)
        small = cv2.resize(image, view.image_size, interpolation=cv2.INTER_AREA)
        noisy = small + _NOISE * rng.standard_normal(small.shape, dtype=np.float32)
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)

    def _shadow(self, image: np.ndarray, world: np.ndarray, camera: Camera) -> None:
        """Darken the floor where the body stands between it and the light."""
        on_floor = world - world[:, 2:] / _SUN[2] * _SUN
        pixels, _ = _fine_pixels(camera, on_floor)
        mask = np.zeros(image.shape[:2], dtype=np.uint8)
        for solid in self._solid:
            hull = cv2.convexHull(pixels[solid].astype(np.float32))
            cv2.fillConvexPoly(mask, np.round(hull).astype(np.int32), 255)
        strength = cv2.blur(mask, (15, 9)).astype(np.float32)[..., None] / np.float32(255.0)
        image *= np.float32(1.0) - np.float32(1.0 - _SHADOW) * strength


def _clothing(mesh: FleshMesh, rng: np.random.Generator) -> np.ndarray:
    """Colours (V, 3) of a solid's vertices: its garment, mottled so that motion can be seen on it."""
    part = next((colour for name, colour in _CLOTHES.items() if mesh.link.endswith(name)), _SHIRT)
    colour = np.tile(part, (len(mesh.vertices), 1))
    if mesh.link == "head":
        x, _, z = (mesh.vertices - mesh.vertices.mean(axis=0)).T
        colour[z > 0.45 * x + 0.035] = _HAIR
    weave = 0.05 if part is _SKIN else 0.13
    return np.clip(colour * (1.0 + weave * rng.standard_normal((len(colour), 1))), 0.0, 255.0)


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Outward unit normals (V, 3) of a closed mesh, weighted by the areas of the faces around each vertex."""
    p = vertices[faces]
    weighted = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], weighted)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _fine_pixels(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the enlarged picture (N, 2) and depths (N,) [m] of world points (N, 3)."""
    depth = points @ camera.R_camera_world[2] + camera.t_camera_world[2]
    return (camera.project(points) + 0.5) * _FINE - 0.5, depth


def _room_picture(
    camera: Camera, corners: np.ndarray, colour: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The empty room, enlarged (H, W, 3) float32, and its nearness (H, W)."""
    width, height = (side * _FINE for side in camera.image_size)
    image = np.full((height, width, 3), 90.0, dtype=np.float32)
    nearness = np.zeros((height, width))
    pixels, depth = _fine_pixels(camera, corners.reshape(-1, 3))
    quad = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([quad + np.array([0, 1, 2]), quad + np.array([0, 2, 3])])
    paint(image, nearness, pixels, depth, np.repeat(colour, 4, axis=0), faces)
    grain = cv2.GaussianBlur(rng.standard_normal((height, width, 1)).astype(np.float32), (0, 0), 3.0)
    image *= np.float32(1.0) + np.float32(0.6) * grain[..., None]
    return np.clip(image, 0.0, 255.0), nearness


def write_video(path: str | Path, frames: Iterable[np.ndarray], fps: float) -> Path:
    """Write BGR frames (H, W, 3) uint8 as an mp4.

    Raises
    ------
    InputError: the file cannot be written, or there is no frame.
    """
    writer: cv2.VideoWriter | None = None
    try:
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
                if not writer.isOpened():
                    raise InputError(path, "cannot be written", remedy="a path ending in .mp4 in an existing folder")
            writer.write(frame)
        if writer is None:
            raise InputError(path, "there is no frame to write")
    finally:
        if writer is not None:
            writer.release()
    return Path(path)
