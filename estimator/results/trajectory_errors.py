"""How far one trajectory is from the truth, frame by frame, and in which frames it has lost the body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.cameras.camera import Camera
from estimator.results.evaluation import mpjpe

FAR = 0.25
"""Mean error of a frame's landmarks from which it is lost [m]."""
FAR_PX = 15.0
"""The same of their images [px]."""


class TrajectoryErrors(NamedTuple):
    """Mean error of the landmarks in each of T frames, NaN where pose or truth is unknown.

    aligned (T,): with the roots of both at one place [m]. world (T,): with nothing aligned [m]. pixels (T,): in the
    image, in the camera where it is largest [px]. world and pixels are NaN where trajectory and truth share no world.
    lost (T,) bool: frames whose truth is known and whose pose is not within `FAR` and `FAR_PX`, or where no world is
    shared not within `FAR` once aligned; a frame without a pose is lost.
    """

    aligned: np.ndarray
    world: np.ndarray
    pixels: np.ndarray
    lost: np.ndarray


def trajectory_errors(
    points: np.ndarray, truth: np.ndarray, root: Sequence[int] | None, cameras: Sequence[Camera] | None
) -> TrajectoryErrors:
    """Errors of landmarks points (T, L, 3) against truth (T, L, 3) [m].

    root: see `estimator.results.evaluation.mpjpe`. cameras: of the world that both are in, None where they share none.
    """
    aligned = mpjpe(points, truth, root)
    known = np.isfinite(truth).all(axis=(1, 2))
    if cameras is None:
        unknown = np.full(len(points), np.nan)
        return TrajectoryErrors(aligned, unknown, unknown, known & ~(aligned <= FAR))
    world, pixels = _world_error(points, truth), _pixel_error(points, truth, cameras)
    return TrajectoryErrors(aligned, world, pixels, known & ~((world <= FAR) & (pixels <= FAR_PX)))


def _world_error(points: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(points - truth, axis=-1).mean(axis=-1))


def _pixel_error(points: np.ndarray, truth: np.ndarray, cameras: Sequence[Camera]) -> np.ndarray:
    apart = [np.linalg.norm(camera.project(points) - camera.project(truth), axis=-1) for camera in cameras]
    return np.asarray(np.max([distance.mean(axis=-1) for distance in apart], axis=0))
