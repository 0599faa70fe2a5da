"""Pictures of a pose: a body of random size and clothes in random light, described as the tracked person is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.synthesis.clothing import dressed_at_random, periodic_noise
from estimator.synthesis.raster import paint_cloth
from estimator.vision.person_view import ViewFrame, described
from humanoid.kinematics.body import ROOT_Q, Body, directions_in_world, points_in_world
from humanoid.shape.surface import Surface, surface_of
from humanoid.subject.subject import Subject

_NODES = 1500
_CANVAS = 260  # px of the square that is painted: the square that is cut out of it lies anywhere in it
_SQUARE = 200  # px of that square in the picture, before it is scaled
_ELEVATIONS = 5.0  # degrees, standard deviation about the index's
_DISTANCES = 2.0, 4.5  # m
_STEP = 3  # px between the points that the middle of the person is computed from
_FEET = 0.07  # m above the lowest point: part that depth cues count as floor
_GIRTH, _LENGTH = 0.07, 0.04  # standard deviations of a variant's, as shares
_LIGHT = 0.35, 0.75  # ambient
_UNEVEN = 30.0  # grey values
_WIDER = 3  # px by which blocks of pixels that are compared by stereo widen a person on a side, at most


class Example(NamedTuple):
    """description (bins,): see `estimator.vision.person_view`. q (nq,): the pose, the root in the frame of the view
    (`ViewFrame`). landmarks (L, 3) [m]: of the pose in that frame, about their mean. grey, where (200, 200): the
    cut-out, and where it shows the person."""

    description: np.ndarray
    q: np.ndarray
    landmarks: np.ndarray
    grey: np.ndarray
    where: np.ndarray


class Variant(NamedTuple):
    """A body as in the pictures."""

    body: Body
    surface: Surface


def variants(subject: Subject, count: int, rng: np.random.Generator) -> list[Variant]:
    """Bodies of other lengths, as the subject's proportions allow them, and of other girth."""
    made = []
    for _ in range(count):
        size = 1.0 + _LENGTH * rng.standard_normal()
        scales = {
            p.joint: float(np.clip(size * (1.0 + 0.5 * _LENGTH * rng.standard_normal()), p.scale_min, p.scale_max))
            for p in subject.proportions
        }
        changed = subject.scaled(scales) if scales else subject
        girth = float(np.exp(_GIRTH * rng.standard_normal()))
        body = Body(changed.reshaped({i: flesh.widened(girth) for i, flesh in enumerate(changed.flesh)}))
        made.append(Variant(body, surface_of(body, nodes=_NODES)))
    return made


class ExamplePainter:
    """Paints poses of a body and describes them.

    body: whose poses they are. variants: the bodies in the pictures. elevation [degrees]: approximate angle by which
    the camera looks down. side [m]: of the square that is cut out around the person.
    """

    def __init__(self, body: Body, variants: Sequence[Variant], elevation: float, side: float) -> None:
        self._body, self._variants, self._elevation, self._side = body, variants, elevation, side
        self._grain = periodic_noise(np.random.default_rng(0))

    def example(self, q: np.ndarray, rng: np.random.Generator) -> Example:
        """The example of a pose (nq,) with the root at the origin."""
        body, surface = self._variants[int(rng.integers(len(self._variants)))]
        posed = body.at(q)
        places = points_in_world(posed, surface.joint, surface.local)
        camera = self._camera(0.5 * (places.min(axis=0) + places.max(axis=0)), rng)
        normals = directions_in_world(posed, surface.joint, surface.normal)
        picture, nearness = self._painted(surface, places, normals, camera, rng)
        frame = ViewFrame.at(_seen_places(nearness, camera), camera, np.array([0.0, 0.0, 1.0]))
        description, grey, where = described(picture, _as_seen(nearness > 0.0, rng), camera, frame, self._side)
        in_view = self._in_view(q, frame)
        landmarks = self._body.landmarks(self._body.at(in_view))
        return Example(description, in_view, landmarks - landmarks.mean(axis=0), grey, where)

    def _camera(self, middle: np.ndarray, rng: np.random.Generator) -> Camera:
        """One that looks along x, and somewhat down, at about the middle of the body, (3,)."""
        elevation = np.radians(self._elevation + _ELEVATIONS * rng.standard_normal())
        forward = np.array([np.cos(elevation), 0.0, -np.sin(elevation)])
        right = np.array([0.0, -1.0, 0.0])
        R_camera_world = np.stack([right, np.cross(forward, right), forward])
        distance = rng.uniform(*_DISTANCES)
        centre = middle + 0.1 * rng.standard_normal(3) - distance * forward
        focal, mid = _SQUARE * distance / self._side, 0.5 * (_CANVAS - 1)
        K = np.array([[focal, 0.0, mid], [0.0, focal, mid], [0.0, 0.0, 1.0]])
        return Camera("view", (_CANVAS, _CANVAS), K, np.zeros(5), R_camera_world, -R_camera_world @ centre)

    def _painted(
        self, surface: Surface, places: np.ndarray, normals: np.ndarray, camera: Camera, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Grey picture (H, W) uint8 of the body before an even background, and nearness (H, W) [1/m]."""
        clothes = dressed_at_random(surface, self._grain, rng)
        sun = np.array([-rng.uniform(0.2, 1.0), rng.uniform(-1.0, 1.0), rng.uniform(0.2, 1.0)])
        ambient = rng.uniform(*_LIGHT)
        light = ambient + (1.1 - ambient) * np.clip(normals @ (sun / np.linalg.norm(sun)), 0.0, 1.0)
        image = _background(rng)
        nearness = np.zeros((_CANVAS, _CANVAS))
        depth = places @ camera.R_camera_world[2] + camera.t_camera_world[2]
        paint_cloth(
            image, nearness, camera.project(places), depth, surface.local, clothes.colour, light, surface.faces,
            surface.part[surface.faces[:, 0]], clothes.pattern, clothes.grain,
        )  # fmt: skip
        grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (0, 0), rng.uniform(0.4, 1.0))
        noisy = grey + np.float32(rng.uniform(1.0, 4.0)) * rng.standard_normal(grey.shape, dtype=np.float32)
        return np.clip(noisy + np.float32(0.5), 0, 255).astype(np.uint8), nearness

    def _in_view(self, q: np.ndarray, frame: ViewFrame) -> np.ndarray:
        """A pose (nq,) with its root in the frame of the view; that of a body with a fixed root stays."""
        if not self._body.has_free_root:
            return q
        other = q.copy()
        view_world = pin.SE3(frame.R_world_view, frame.origin).inverse()
        other[ROOT_Q] = pin.SE3ToXYZQUAT(view_world * pin.XYZQUATToSE3(q[ROOT_Q]))
        return other


def _background(rng: np.random.Generator) -> np.ndarray:
    """Uneven, so that the outline stands out from it here more, there less, and in one of two pictures speckled, (H, W,
    3) float32: some of it is mistaken for the person."""
    coarse = rng.uniform(20.0, 230.0) + _UNEVEN * rng.standard_normal((4, 4))
    grey = cv2.resize(coarse.astype(np.float32), (_CANVAS, _CANVAS), interpolation=cv2.INTER_CUBIC)
    if rng.random() < 0.5:
        cells = _CANVAS // int(rng.integers(2, 9))
        speckles = rng.uniform(0.3, 1.5) * _UNEVEN * rng.standard_normal((cells, cells), dtype=np.float32)
        grey = grey + cv2.resize(speckles, (_CANVAS, _CANVAS), interpolation=cv2.INTER_NEAREST)
    return np.repeat(grey[:, :, None], 3, axis=2)


def _as_seen(mask: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A mask (H, W) bool as if from depth: wider than the person by some pixels, different on each side."""
    left, right, above, below = (int(px) for px in rng.integers(0, _WIDER + 1, 4))
    block = np.ones((above + below + 1, left + right + 1), np.uint8)
    return cv2.dilate(mask.astype(np.uint8), block, anchor=(left, above)) > 0


def _seen_places(nearness: np.ndarray, camera: Camera) -> np.ndarray:
    """Places (N, 3) [m] of the surface that is seen, without the feet, as depth has them."""
    rows, columns = np.nonzero(nearness[::_STEP, ::_STEP])
    rows, columns = _STEP * rows, _STEP * columns
    directions = camera.directions(np.stack([columns, rows], axis=1).astype(float))
    along = directions / nearness[rows, columns][:, None]
    places = camera.centre_world + along @ camera.R_camera_world
    above = places[:, 2] > places[:, 2].min() + _FEET
    return places[above] if above.any() else places
