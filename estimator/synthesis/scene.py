"""The scene around the person: floor, walls, clutter, a pillar, occluders; and the truth as a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from humanoid.kinematics.body import Body
from humanoid.support.files import replacing

_WALLS = (-2.9, 3.9, 3.6, 3.2)  # x of the back and front wall, half the width, height [m]
_PILLAR = -1.2  # x of the pillar; rails and wall are 5 and 10 cm behind it [m]
_BEFORE_WALL = 0.1  # that a camera stays away from a wall, at the room's own size [m]
_FREE_RADIUS = 1.5  # around the person's place [m]
_SPECKLE = 0.3  # standard deviation of the logarithm of the brightness
_X, _Y, _Z = np.eye(3)


class Quads(NamedTuple):
    """Flat coloured rectangles: corners (N, 4, 3) [m], world frame; colour (N, 3) BGR."""

    corners: np.ndarray
    colour: np.ndarray


def cluttered_room(rng: np.random.Generator) -> tuple[Quads, list[Quads]]:
    """Floor boards and walls with pictures; and boxes of furniture, out of the person's way."""
    back, front, half, height = _WALLS
    depth, width = front - back, 2.0 * half
    origin = np.array([back, -half, 0.0])
    wall = np.array([176.0, 188.0, 196.0])
    parts = [
        _panel(rng, origin, depth * _X, width * _Y, (14, 40), np.array([92.0, 124.0, 158.0]), 16.0),
        _panel(rng, origin, width * _Y, height * _Z, (36, 15), wall, 5.0),
        _panel(rng, origin, depth * _X, height * _Z, (34, 15), wall * 0.9, 5.0),
        _panel(rng, origin + width * _Y, depth * _X, height * _Z, (34, 15), wall * 0.94, 5.0),
    ]
    parts += [_picture(rng, back + 0.002 * i, half - 0.002 * i) for i in range(14)]  # no two in one plane
    boxes = [_box(rng) for _ in range(24)]
    parts.append(_panel(rng, origin + depth * _X, width * _Y, height * _Z, (36, 15), wall * 0.97, 5.0))
    return joined(parts), boxes


def enlargement_holding(cameras: np.ndarray) -> float:
    """How many times larger `cluttered_room` has to be for the back wall to stand behind cameras (C, 3) [m], too.

    Only that wall is considered: with the room enlarged by the cameras' distance they are before the other three.
    """
    return float(np.max(-cameras[:, 0])) / (-_WALLS[0] - _BEFORE_WALL)


def skin_boards(rng: np.random.Generator, count: int, colour: np.ndarray) -> Quads:
    """Boards (count) of about a colour (3,) BGR on the back wall of `cluttered_room`, behind and beside the person."""
    parts = []
    for k in range(count):
        size = rng.uniform([0.08, 0.08], [0.4, 0.5])
        corner = np.array([_WALLS[0] + 0.06 + 0.004 * k, *rng.uniform([-0.9, 0.6], [0.6, 1.9])])
        parts.append(skin_board(rng, corner, size, colour))
    return joined(parts)


def skin_board(rng: np.random.Generator, corner: np.ndarray, size: np.ndarray, colour: np.ndarray) -> Quads:
    """One across the x axis: corner (3,), width and height (2,) [m], of about a colour (3,) BGR."""
    u, v = np.array([0.0, size[0], 0.0]), np.array([0.0, 0.0, size[1]])
    return _panel(rng, corner, u, v, (4, 4), colour * rng.uniform(0.85, 1.1), 6.0)


def pillar_room(rng: np.random.Generator, azimuth: float, cameras: np.ndarray) -> Quads:
    """A dark wall 1.3 m behind the person as seen from `azimuth` [rad], with a bright pillar to the right and rails;
    farther where cameras (C, 3) [m] would else stand behind it."""
    behind = -(cameras[:, :2] @ np.array([np.cos(azimuth), np.sin(azimuth)]))
    back = max(0.0, float(behind.max()) + _BEFORE_WALL + _PILLAR)
    floor = _panel(rng, np.array([-9.0, -9.0, 0.0]), 18.0 * _X, 18.0 * _Y, (36, 36), np.full(3, 62.0), 4.0)
    wall = _panel(
        rng, np.array([_PILLAR - 0.1 - back, -9.0, 0.0]), 18.0 * _Y, 6.0 * _Z, (60, 20), np.full(3, 46.0), 4.0
    )
    pillar = _panel(rng, np.array([_PILLAR - back, 0.08, 0.0]), 0.28 * _Y, 6.0 * _Z, (3, 60), np.full(3, 226.0), 4.0)
    rails = [
        _panel(rng, np.array([_PILLAR - 0.05 - back, -9.0, z]), 18.0 * _Y, 0.05 * _Z, (180, 1), np.full(3, 205.0), 4.0)
        for z in (0.45, 0.95, 1.45, 1.95)
    ]
    return turned(joined([floor, wall, *rails, pillar]), azimuth)


def occluder(rng: np.random.Generator, kind: str, place: np.ndarray, azimuth: float, height: float) -> Quads:
    """A "post" or a low "box" on the floor at `place` (2,) [m], facing `azimuth` [rad]; `height` [m] of the person."""
    size = np.array([0.09, 0.09, 1.4 * height] if kind == "post" else [0.25, 0.7, 0.42 * height])
    sides = _cuboid(rng, -0.5 * np.array([size[0], size[1], 0.0]), size, np.array([70.0, 120.0, 105.0]), 12.0)
    return moved(turned(sides, azimuth), np.array([*place, 0.0]))


def screen(rng: np.random.Generator, corner: np.ndarray, u: np.ndarray, v: np.ndarray, speckle: float) -> Quads:
    """A rectangle from a corner (3,) along its sides (3,) [m], speckled in cells of `speckle` [m]."""
    panel = _panel(rng, corner, u, v, (10, 8), np.array([150.0, 140.0, 128.0]), 14.0)
    return speckled(panel, rng, speckle)


def joined(parts: Sequence[Quads]) -> Quads:
    """Several groups as one, in their order."""
    return Quads(np.concatenate([p.corners for p in parts]), np.concatenate([p.colour for p in parts]))


def speckled(quads: Quads, rng: np.random.Generator, size: float) -> Quads:
    """The same surfaces in cells of about `size` [m] that differ in brightness, so that no two places look alike."""
    corner, sides = quads.corners[:, 0], (quads.corners[:, 1:4:2] - quads.corners[:, :1])  # (N, 2, 3)
    cells = np.maximum(1, np.round(np.linalg.norm(sides, axis=2) / size)).astype(int)
    parts = []
    for i, j in np.unique(cells, axis=0):
        alike = np.flatnonzero((cells == (i, j)).all(axis=1))
        a, b = (x.ravel() for x in np.meshgrid(np.arange(i), np.arange(j), indexing="ij"))
        at = [
            ((a + da) / i)[:, None] * sides[alike, None, 0] + ((b + db) / j)[:, None] * sides[alike, None, 1]
            for da, db in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
        corners = np.stack(at, axis=2) + corner[alike, None, None]
        light = np.exp(_SPECKLE * rng.standard_normal((len(alike), i * j, 1)))
        colour = np.clip(quads.colour[alike, None] * light, 8.0, 245.0)
        parts.append(Quads(corners.reshape(-1, 4, 3), colour.reshape(-1, 3)))
    return joined(parts)


def turned(quads: Quads, angle: float) -> Quads:
    """Turned about the world's z axis by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return Quads(quads.corners @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T, quads.colour)


def moved(quads: Quads, shift: np.ndarray, scale: float = 1.0) -> Quads:
    """Enlarged about the origin, then moved by `shift` (3,) [m]."""
    return Quads(scale * quads.corners + shift, quads.colour)


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
    corner = np.array([-0.5 * size[0], -0.5 * size[1], 0.0])
    colour, spread = _paint(rng), rng.uniform(4.0, 16.0)
    return moved(turned(_cuboid(rng, corner, size, colour, spread), angle), np.array([*centre, 0.0]))


def _cuboid(rng: np.random.Generator, corner: np.ndarray, size: np.ndarray, colour: np.ndarray, spread: float) -> Quads:
    """Four sides and the top of a box along the axes."""
    u, v, w = np.diag(size)
    faces = [(corner, u, w), (corner + v, u, w), (corner, v, w), (corner + u, v, w), (corner + w, u, v)]
    lights = (0.75, 0.8, 0.7, 1.0, 1.15)
    return joined(
        [_panel(rng, at, a, b, (5, 5), colour * light, spread) for (at, a, b), light in zip(faces, lights, strict=True)]
    )


def _paint(rng: np.random.Generator) -> np.ndarray:
    """A colour (3,) of furniture: of any brightness, none too vivid."""
    return rng.uniform(40.0, 190.0) + 0.35 * (rng.uniform(0.0, 200.0, size=3) - 100.0)


def write_truth(path: str | Path, body: Body, q: np.ndarray, time: np.ndarray) -> None:
    """Write the true motion q (T, nq) at time (T,) [s] as npz, in the layout of a reference.

    landmarks (T, L, 3) [m], landmark_names (L), time (T,), q (T, nq), q_names (nq).
    """
    landmarks = np.array([body.landmarks(body.at(pose)) for pose in q])
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            landmarks=landmarks,
            landmark_names=np.array(body.landmark_names),
            time=time,
            q=q,
            q_names=np.array(body.q_names),
        )
