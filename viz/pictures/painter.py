"""Paints posed bodies and skeletons into an image: shaded triangles with a depth buffer, lines over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.projection import AWAY
from estimator.synthesis.raster import paint
from humanoid.kinematics.body import Body, PosedBody, points_in_world
from viz import palette
from viz.solids.body_solids import BoneSegments, body_solids, drawing_notes, skeleton
from viz.solids.solid import DrawnMesh, sides_among

_FINE = 2  # the body is painted this many times larger and then reduced, which smooths its edges
_SHIFT = 4  # binary places of OpenCV's fixed-point coordinates
_NEAR = 0.05  # what is closer to the eye than this is not drawn [m]
_AMBIENT, _DIFFUSE, _RIM = 0.55, 0.55, 0.2
_LIGHT = np.array([-0.45, -0.65, -0.62])  # towards the viewer's upper left
_SQUARE = 0.02  # logarithm of the aspect of pixels up to which they count as square: lenses are calibrated so well


class ImageProjection(Protocol):
    """Projection of points of the world into an image of `size` (width, height)."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image [px]."""

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World points (..., 3) [m] -> pixels (..., 2) and depths (...) [m]."""

    def axes(self) -> np.ndarray:
        """Right, down and forward of the view in the world, rows of (3, 3)."""


@dataclass(frozen=True)
class CameraProjection:
    """A camera's view with lens distortion, reduced by `scale` across and down."""

    camera: Camera
    scale: tuple[float, float]
    size: tuple[int, int]

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `ImageProjection`."""
        depth = self.camera.depths(points)
        return self.pixels(self.camera.project(points)), depth + AWAY if self.camera.parallel else depth

    def pixels(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels of the full image -> pixels of the reduced one (centres at integers in both)."""
        return np.asarray((pixels + 0.5) * np.array(self.scale) - 0.5)

    def axes(self) -> np.ndarray:
        """See `ImageProjection`."""
        return self.camera.R_camera_world


@dataclass(frozen=True)
class OrthographicView:
    """A parallel projection; `centre` [m] falls on the middle of the image."""

    R_view_world: np.ndarray
    centre: np.ndarray
    pixels_per_metre: float
    size: tuple[int, int]

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `ImageProjection`."""
        x = (points - self.centre) @ self.R_view_world.T
        return x[..., :2] * self.pixels_per_metre + (np.array(self.size) - 1) / 2.0, x[..., 2] + 100.0

    def axes(self) -> np.ndarray:
        """See `ImageProjection`."""
        return self.R_view_world


def camera_view(camera: Camera, longest: int) -> CameraProjection:
    """The camera's view, its longer side at most `longest` px and both sides even (video coders require that).

    Pixels that are not square, by the camera's focal lengths, become so.
    """
    aspect = camera.K[1, 1] / camera.K[0, 0]
    stretch = np.array([aspect if abs(np.log(aspect)) > _SQUARE else 1.0, 1.0])
    sides = np.array(camera.image_size) * stretch
    scale = min(1.0, longest / sides.max()) * stretch
    width, height = (max(2, round(side / 2.0) * 2) for side in np.array(camera.image_size) * scale)
    return CameraProjection(camera, (float(scale[0]), float(scale[1])), (width, height))


class BodyPainter:
    """Draws one body; holds its meshes as flat arrays.

    Attributes
    ----------
    local (V, 3) [m], normal (V, 3), joint (V,): vertices in the frames of their joints. faces (F, 3).
    colour (V, 3): BGR. sides: the sides that are distinguished by colour. notes: see
    `viz.solids.body_solids.drawing_notes`.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.skeleton: BoneSegments = skeleton(body)
        self.notes = drawing_notes(body)
        solids = body_solids(body)
        self.sides = sides_among([*(s.name for s in solids if s.colour is None), *body.landmark_names])
        self._set(solids)

    def _set(self, solids: tuple[DrawnMesh, ...]) -> None:
        counts = [len(s.vertices) for s in solids]
        starts = np.cumsum([0, *counts[:-1]])
        self.local = np.concatenate([s.vertices for s in solids])
        self.normal = np.concatenate([s.shading() for s in solids])
        self.joint = np.repeat([s.joint for s in solids], counts)
        self.faces = np.concatenate([s.faces + start for s, start in zip(solids, starts, strict=True)])
        self._corners = tuple(np.ascontiguousarray(self.faces.T))
        self.colour = np.repeat([palette.bgr(s.paint) for s in solids], counts, axis=0).astype(np.float64)
        self._closed_vertex = np.repeat([s.closed for s in solids], counts)
        self._closed = self._closed_vertex[self.faces[:, 0]]

    def vertices(self, posed: PosedBody) -> np.ndarray:
        """All vertices in the world [m], (V, 3)."""
        return points_in_world(posed, self.joint, self.local)

    def solid(
        self,
        image: np.ndarray,
        view: ImageProjection,
        posed: PosedBody,
        opacity: float,
        colour: palette.Rgb | None = None,
    ) -> None:
        """Blend the shaded body into the image (H, W, 3) uint8 in place."""
        pixels, depth = view.project(self.vertices(posed))
        faces = self.faces[self._visible(pixels, depth, 4.0 * max(view.size))]
        if len(faces) > 0:
            base = (
                self.colour if colour is None else np.tile(np.array(palette.bgr(colour), np.float64), (len(depth), 1))
            )
            _blend(image, pixels, depth, self._lit(posed, base, view.axes()), faces, opacity)

    def _visible(self, pixels: np.ndarray, depth: np.ndarray, farthest: float) -> np.ndarray:
        """Faces (F,) in front of the viewer, not too far outside; of closed solids only those turned to the viewer."""
        x, y = np.ascontiguousarray(pixels.T)
        a, b, c = self._corners
        with np.errstate(invalid="ignore"):  # NaN compares false: points behind the camera are lost as well
            seen = (np.abs(x) < farthest) & (np.abs(y) < farthest) & (depth > _NEAR)
            front = (x[b] - x[a]) * (y[c] - y[a]) < (y[b] - y[a]) * (x[c] - x[a])
        return np.asarray((front | ~self._closed) & seen[a] & seen[b] & seen[c])

    def _lit(self, posed: PosedBody, colour: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """Colours (V, 3) lit from the viewer's upper left, with darker rims where the surface turns away."""
        turned = np.einsum("ij,njk->nik", axes, posed.rotations)  # R_view_joint
        seen = np.einsum("nij,nj->ni", turned[self.joint], self.normal)  # components to the right, down, away
        seen[~self._closed_vertex & (seen[:, 2] > 0.0)] *= -1.0  # what is open shows its inner side
        facing = np.clip(-seen[:, 2], 0.0, 1.0)
        strength = _AMBIENT + _DIFFUSE * np.clip(seen @ _LIGHT, 0.0, 1.0) - _RIM * (1.0 - facing) ** 2
        return np.asarray(np.clip(colour * strength[:, None], 0.0, 255.0))

    def bones(self, mask: np.ndarray, view: ImageProjection, posed: PosedBody, strength: float) -> None:
        """Draw the skeleton into a mask (H, W) uint8, as bright as `strength` (0 to 1)."""
        pixels, depth = view.project(self.skeleton.at(posed))
        thickness = max(1, round(max(mask.shape) / 480))
        for i, k in self.skeleton.segments:
            ends = pixels[[i, k]]
            if min(depth[i], depth[k]) > _NEAR and np.isfinite(ends).all() and np.abs(ends).max() < 8000:
                first, second = np.round(ends * 16).astype(int).tolist()
                cv2.line(mask, first, second, int(255 * strength), thickness, cv2.LINE_AA, _SHIFT)


def _blend(
    image: np.ndarray, pixels: np.ndarray, depth: np.ndarray, colour: np.ndarray, faces: np.ndarray, opacity: float
) -> None:
    """Paint triangles, the nearest in front, on a layer of their own, and lay that over the image."""
    height, width = image.shape[:2]
    used = pixels[faces.reshape(-1)]
    low = np.clip(np.floor(used.min(axis=0)) - 2, 0, (width, height)).astype(int)
    high = np.clip(np.ceil(used.max(axis=0)) + 3, 0, (width, height)).astype(int)
    if (high - low < 1).any():
        return
    shape = ((high[1] - low[1]) * _FINE, (high[0] - low[0]) * _FINE)
    layer, nearness = np.zeros((*shape, 3)), np.zeros(shape)
    paint(layer, nearness, (pixels - low + 0.5) * _FINE - 0.5, depth, colour, faces)
    layer = cv2.resize(layer, None, fx=1.0 / _FINE, fy=1.0 / _FINE, interpolation=cv2.INTER_AREA)
    painted = (nearness > 0.0).astype(np.uint8) * 255
    alpha = cv2.resize(painted, None, fx=1.0 / _FINE, fy=1.0 / _FINE, interpolation=cv2.INTER_AREA)
    part = image[low[1] : high[1], low[0] : high[0]]
    rim = cv2.subtract(cv2.dilate(alpha, np.ones((3, 3), np.uint8)), alpha)
    kept = 1.0 - (alpha * np.float32(opacity) + rim * np.float32(0.5 * opacity)) / np.float32(255.0)
    part[:] = (part * kept[..., None] + layer * opacity).astype(np.uint8)
