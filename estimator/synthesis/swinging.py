"""Boards in the colour of skin that swing behind the person: what moves as hands do and is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.synthesis import scene
from estimator.synthesis.plate import MotionArea

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
    """Boards (count) of about a colour (3,) BGR, behind a place as seen from `azimuth` [rad], as high as chest and
    head of who stands there."""
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
