"""Paints posed bodies and skeletons into an image: shaded triangles, farthest first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from estimator.imaging.camera import Camera
from humanoid.body import Body, PosedBody
from viz import palette
from viz.solids import Skeleton, Solid, body_solids, skeleton

_FINE = 2  # the body is painted this many times larger and then reduced, which smooths its edges
_SHIFT = 4  # binary places of OpenCV's fixed-point coordinates
_NEAR = 0.05  # what is closer to the eye than this is not drawn [m]
_AMBIENT, _DIFFUSE, _RIM = 0.55, 0.55, 0.2


class View(Protocol):
    """Where points of the world appear in an image of `size` (width, height)."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image [px]."""

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World points (..., 3) [m] -> pixels (..., 2) and depths (...) [m]."""

    def axes(self) -> np.ndarray:
        """Right, down and forward of the view in the world, rows of (3, 3)."""


@dataclass(frozen=True)
class CameraView:
    """What a camera sees, lens distortion included, reduced by `scale`."""

    camera: Camera
    scale: float
    size: tuple[int, int]

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `View`."""
        depth = points @ self.camera.R_camera_world[2] + self.camera.t_camera_world[2]
        return self.pixels(self.camera.project(points)), depth

    def pixels(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels of the full image -> pixels of the reduced one (centres at integers in both)."""
        return (pixels + 0.5) * self.scale - 0.5

    def axes(self) -> np.ndarray:
        """See `View`."""
        return self.camera.R_camera_world


@dataclass(frozen=True)
class OrthographicView:
    """A parallel projection; `centre` [m] falls on the middle of the image."""

    R_view_world: np.ndarray
    centre: np.ndarray
    pixels_per_metre: float
    size: tuple[int, int]

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `View`."""
        x = (points - self.centre) @ self.R_view_world.T
        return x[..., :2] * self.pixels_per_metre + (np.array(self.size) - 1) / 2.0, x[..., 2] + 100.0

    def axes(self) -> np.ndarray:
        """See `View`."""
        return self.R_view_world


def camera_view(camera: Camera, longest: int) -> CameraView:
    """The camera's view, its longer side at most `longest` px and both sides even (video coders want that)."""
    scale = min(1.0, longest / max(camera.image_size))
    width, height = (max(2, round(side * scale / 2.0) * 2) for side in camera.image_size)
    return CameraView(camera, scale, (width, height))


class BodyPainter:
    """Draws one body; holds its meshes as flat arrays."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.skeleton: Skeleton = skeleton(body)
        self._set(body_solids(body))

    def _set(self, solids: tuple[Solid, ...]) -> None:
        starts = np.cumsum([0] + [len(s.vertices) for s in solids])[:-1]
        self.local = np.concatenate([s.vertices for s in solids])
        self.joint = np.concatenate([np.full(len(s.vertices), s.joint) for s in solids])
        self.faces = np.concatenate([s.faces + start for s, start in zip(solids, starts, strict=True)])
        self.colour = np.concatenate([np.tile(palette.bgr(palette.SIDES[s.side]), (len(s.faces), 1)) for s in solids])

    def vertices(self, posed: PosedBody) -> np.ndarray:
        """All vertices in the world [m], (V, 3)."""
        return np.einsum("nij,nj->ni", posed.rotations[self.joint], self.local) + posed.translations[self.joint]

    def solid(
        self, image: np.ndarray, view: View, posed: PosedBody, opacity: float, colour: palette.Rgb | None = None
    ) -> None:
        """Blend the shaded body into the image (H, W, 3) uint8 in place."""
        world = self.vertices(posed)
        pixels, depth = view.project(world)
        with np.errstate(invalid="ignore"):
            # NaN compares false: points behind the camera are lost as well
            lost = ~((np.abs(pixels) < 4.0 * max(view.size)).all(axis=1) & (depth > _NEAR))
        corners = pixels[self.faces]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        with np.errstate(invalid="ignore"):
            front = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0.0) & ~lost[self.faces].any(axis=1)
        order = np.flatnonzero(front)
        if len(order) == 0:
            return
        order = order[np.argsort(-depth[self.faces[order]].mean(axis=1))]
        base = self.colour[order] if colour is None else np.tile(palette.bgr(colour), (len(order), 1))
        _blend(image, corners[order], _lit(world, self.faces[order], base, view.axes()), opacity)

    def bones(self, mask: np.ndarray, view: View, posed: PosedBody, strength: float) -> None:
        """Draw the skeleton into a mask (H, W) uint8, as bright as `strength` (0 to 1)."""
        pixels, depth = view.project(self.skeleton.at(posed))
        thickness = max(1, round(max(mask.shape) / 480))
        for i, k in self.skeleton.segments:
            ends = pixels[[i, k]]
            if min(depth[i], depth[k]) > _NEAR and np.isfinite(ends).all() and np.abs(ends).max() < 8000:
                first, second = np.round(ends * 16).astype(int).tolist()
                cv2.line(mask, first, second, int(255 * strength), thickness, cv2.LINE_AA, _SHIFT)


def _lit(world: np.ndarray, faces: np.ndarray, colour: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Colours (F, 3) of faces lit from the viewer's upper left, with darker rims where they turn away."""
    p = world[faces]
    normals = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    seen = normals @ axes.T  # components to the right, down, away
    light = np.array([-0.45, -0.65, -0.62])
    facing = np.clip(-seen[:, 2], 0.0, 1.0)
    strength = _AMBIENT + _DIFFUSE * np.clip(seen @ light, 0.0, 1.0) - _RIM * (1.0 - facing) ** 2
    return np.clip(colour * strength[:, None], 0.0, 255.0)


def _blend(image: np.ndarray, corners: np.ndarray, colour: np.ndarray, opacity: float) -> None:
    """Paint triangles (F, 3, 2) in their order on a layer of their own, and lay that over the image."""
    height, width = image.shape[:2]
    low = np.clip(np.floor(corners.min(axis=(0, 1))) - 2, 0, (width, height)).astype(int)
    high = np.clip(np.ceil(corners.max(axis=(0, 1))) + 3, 0, (width, height)).astype(int)
    if (high - low < 1).any():
        return
    layer = np.zeros(((high[1] - low[1]) * _FINE, (high[0] - low[0]) * _FINE, 4), dtype=np.uint8)
    points = (corners - low + 0.5) * _FINE - 0.5
    fixed = np.round(points * (1 << _SHIFT)).astype(np.int32)
    for triangle, (b, g, r) in zip(fixed, colour.tolist(), strict=True):
        cv2.fillConvexPoly(layer, triangle, (b, g, r, 255.0), cv2.LINE_8, _SHIFT)
    layer = cv2.resize(layer, None, fx=1.0 / _FINE, fy=1.0 / _FINE, interpolation=cv2.INTER_AREA)
    alpha = layer[..., 3]
    part = image[low[1] : high[1], low[0] : high[0]]
    rim = cv2.subtract(cv2.dilate(alpha, np.ones((3, 3), np.uint8)), alpha)
    kept = 1.0 - (alpha * np.float32(opacity) + rim * np.float32(0.5 * opacity)) / np.float32(255.0)
    part[:] = (part * kept[..., None] + layer[..., :3] * np.float32(opacity)).astype(np.uint8)
