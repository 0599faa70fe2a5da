"""Screens that hide the person wholly: before every camera one, for both of a stereo pair the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.synthesis import scene
from estimator.synthesis.plate import MotionArea

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
