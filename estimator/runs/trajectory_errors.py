"""Errors of a trajectory, frame by frame, and the frames in which it has lost the body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.runs.evaluation import mpjpe

FAR = 0.25
"""Mean error of a frame's landmarks from which it is lost [m]."""
FAR_PX, FAR_PX_SIZE = 15.0, (640, 480)
"""The same of their images [px], in a picture of this size; in others the same share of the diagonal. CSS says when its
sequences are lost, but neither by which measure nor how large the pictures are."""


def far_px(image_size: tuple[int, int]) -> float:
    """Mean distance in a picture of this size (width, height) from which a frame is lost [px]."""
    return FAR_PX * float(np.hypot(*image_size) / np.hypot(*FAR_PX_SIZE))


class TrajectoryErrors(NamedTuple):
    """Mean error of the landmarks in each of T frames, NaN where pose or truth is unknown.

    aligned (T,): with the roots of both at one place [m]. world (T,): with nothing aligned [m]. pixels (T,): in the
    image, in the camera where it is largest [px]. world and pixels are NaN where trajectory and truth share no world.
    of_limits (T,): the largest error in terms of its limit, of `FAR` in the world and of `far_px` in every camera, or
    where no world is shared of `FAR` once aligned. lost (T,) bool: frames whose truth is known and where that is above
    1, or the pose unknown.
    """

    aligned: np.ndarray
    world: np.ndarray
    pixels: np.ndarray
    of_limits: np.ndarray
    lost: np.ndarray


def trajectory_errors(
    points: np.ndarray, truth: np.ndarray, root: Sequence[int] | None, cameras: Sequence[Camera] | None
) -> TrajectoryErrors:
    """Errors of landmarks points (T, L, 3) against truth (T, L, 3) [m].

    root: see `estimator.runs.evaluation.mpjpe`. cameras: of the world that both are in, None where they share none.
    """
    aligned = mpjpe(points, truth, root)
    known = np.isfinite(truth).all(axis=(1, 2))
    if cameras is None:
        unknown, of_limits = np.full(len(points), np.nan), aligned / FAR
        return TrajectoryErrors(aligned, unknown, unknown, of_limits, known & ~(of_limits <= 1.0))
    world = np.asarray(np.linalg.norm(points - truth, axis=-1).mean(axis=-1))
    images = [_image_error(points, truth, camera) for camera in cameras]  # (T,) each
    in_images = [error / far_px(camera.image_size) for error, camera in zip(images, cameras, strict=True)]
    of_limits = np.max([world / FAR, *in_images], axis=0)
    return TrajectoryErrors(aligned, world, np.max(images, axis=0), of_limits, known & ~(of_limits <= 1.0))


def _image_error(points: np.ndarray, truth: np.ndarray, camera: Camera) -> np.ndarray:
    return np.asarray(np.linalg.norm(camera.project(points) - camera.project(truth), axis=-1).mean(axis=-1))
