"""The room of the built-in clip: cameras, floor, walls and clutter."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.formats.atomic import replacing
from estimator.imaging.camera import Camera
from humanoid.body import Body

_SIZE = (640, 480)
_DISTANCE, _HEIGHT, _AIM = 3.5, 1.35, 0.98  # of the cameras from the middle of the room, and where they look [m]
_AZIMUTHS = {"front_left": 42.0, "front_right": -38.0}  # [deg], seen from above, 0 in front of the person
_FOCAL = 660.0
_DISTORTION = (-0.09, 0.04, 0.0008, -0.0005, 0.0)
_WALLS = (-2.9, 3.9, 3.6, 3.2)  # x of the back and front wall, half the width, height [m]
_FREE_RADIUS = 1.5  # around the person's place [m]


class Quads(NamedTuple):
    """Flat coloured rectangles: corners (N, 4, 3) [m], world frame; colour (N, 3) BGR."""

    corners: np.ndarray
    colour: np.ndarray


def scene_cameras() -> tuple[Camera, ...]:
    """Two cameras 3.5 m from the origin and 80 degrees apart, 640 x 480, with a little lens distortion."""
    return tuple(_camera(name, np.radians(azimuth)) for name, azimuth in _AZIMUTHS.items())


def _camera(name: str, azimuth: float) -> Camera:
    reach = np.sqrt(_DISTANCE**2 - (_HEIGHT - _AIM) ** 2)
    centre = np.array([reach * np.cos(azimuth), reach * np.sin(azimuth), _HEIGHT])
    forward = (np.array([0.0, 0.0, _AIM]) - centre) / _DISTANCE
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R_camera_world = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[_FOCAL, 0.0, _SIZE[0] / 2 - 3.5], [0.0, _FOCAL, _SIZE[1] / 2 + 2.5], [0.0, 0.0, 1.0]])
    return Camera(name, _SIZE, K, np.array(_DISTORTION), R_camera_world, -R_camera_world @ centre)


def cluttered_room(rng: np.random.Generator) -> Quads:
    """Floor boards, walls with pictures, shelves and boxes along the walls, all out of the person's way."""
    back, front, half, height = _WALLS
    depth, width = front - back, 2.0 * half
    origin = np.array([back, -half, 0.0])
    x, y, z = np.eye(3)
    wall = np.array([176.0, 188.0, 196.0])
    parts = [
        _panel(rng, origin, depth * x, width * y, (14, 40), np.array([92.0, 124.0, 158.0]), 16.0),
        _panel(rng, origin, width * y, height * z, (36, 15), wall, 5.0),
        _panel(rng, origin, depth * x, height * z, (34, 15), wall * 0.9, 5.0),
        _panel(rng, origin + width * y, depth * x, height * z, (34, 15), wall * 0.94, 5.0),
    ]
    parts += [_picture(rng, back, half) for _ in range(14)]
    parts += [_box(rng) for _ in range(24)]
    return Quads(np.concatenate([p.corners for p in parts]), np.concatenate([p.colour for p in parts]))


def _panel(
    rng: np.random.Generator,
    corner: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    cells: tuple[int, int],
    colour: np.ndarray,
    spread: float,
) -> Quads:
    """A rectangle of cells (nu, nv) whose colours differ by `spread`; small cells also follow the lens distortion."""
    i, j = np.meshgrid(np.arange(cells[0]), np.arange(cells[1]), indexing="ij")
    a, b = i.ravel()[:, None], j.ravel()[:, None]
    at = [corner + (a + da) / cells[0] * u + (b + db) / cells[1] * v for da, db in ((0, 0), (1, 0), (1, 1), (0, 1))]
    shade = rng.normal(0.0, spread, size=(len(a), 1)) + rng.normal(0.0, 0.3 * spread, size=(len(a), 3))
    return Quads(np.stack(at, axis=1), np.clip(colour + shade, 8.0, 245.0))


def _picture(rng: np.random.Generator, back: float, half: float) -> Quads:
    """A poster on one of the three walls."""
    size = rng.uniform(0.3, 0.8, size=2)
    low = rng.uniform(0.9, 2.0)
    colour = _paint(rng)
    side = int(rng.integers(3))
    if side == 0:
        corner, u = np.array([back + 0.01, rng.uniform(-half, half - size[0]), low]), np.array([0.0, size[0], 0.0])
    else:
        y = (half - 0.01) * (1.0 if side == 1 else -1.0)
        corner, u = np.array([rng.uniform(back, 2.0), y, low]), np.array([size[0], 0.0, 0.0])
    return _panel(rng, corner, u, np.array([0.0, 0.0, size[1]]), (6, 6), colour, 45.0)


def _box(rng: np.random.Generator) -> Quads:
    """A box of furniture behind or beside the person."""
    while True:
        size = rng.uniform([0.25, 0.25, 0.3], [0.8, 0.8, 1.7])
        centre = rng.uniform([-2.6, -3.2], [0.6, 3.2])
        if np.linalg.norm(centre) - 0.5 * np.hypot(size[0], size[1]) > _FREE_RADIUS:
            break
    angle = rng.uniform(-0.4, 0.4)
    u = size[0] * np.array([np.cos(angle), np.sin(angle), 0.0])
    v = size[1] * np.array([-np.sin(angle), np.cos(angle), 0.0])
    w = np.array([0.0, 0.0, size[2]])
    corner = np.array([*centre, 0.0]) - 0.5 * (u + v)
    colour, spread = _paint(rng), rng.uniform(4.0, 16.0)
    faces = [(corner, u, w), (corner + v, u, w), (corner, v, w), (corner + u, v, w), (corner + w, u, v)]
    sides = [
        _panel(rng, at, a, b, (5, 5), colour * light, spread)
        for (at, a, b), light in zip(faces, (0.75, 0.8, 0.7, 1.0, 1.15), strict=True)
    ]
    return Quads(np.concatenate([s.corners for s in sides]), np.concatenate([s.colour for s in sides]))


def _paint(rng: np.random.Generator) -> np.ndarray:
    """A colour (3,) of furniture: of any brightness, none too vivid."""
    return rng.uniform(40.0, 190.0) + 0.35 * (rng.uniform(0.0, 200.0, size=3) - 100.0)


def write_truth(path: str | Path, body: Body, q: np.ndarray, time: np.ndarray) -> None:
    """Write the true motion q (T, nq) at time (T,) [s] as npz, in the layout of a reference.

    landmarks (T, L, 3) [m], landmark_names (L), time (T,), q (T, nq), q_names (nq).
    """
    landmarks = np.array([body.landmarks(body.at(one)) for one in q])
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            landmarks=landmarks,
            landmark_names=np.array(body.landmark_names),
            time=time,
            q=q,
            q_names=np.array(body.q_names),
        )
