"""Pictures of boards as known cameras see them: each pixel's ray is intersected with the board and its print sampled
there."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.data.boards.board import CHARUCO, Board
from estimator.data.cameras.camera import Camera

_DETAIL = 40  # px of the print in a square
_MARGIN = 1  # squares of white around it
_FINER = 2  # samples across a pixel
_FLOOR = 128


def board_print(board: Board) -> np.ndarray:
    """The board printed, `_DETAIL` px a square and a white margin, grey (H, W); a dark square comes first."""
    if board.kind == CHARUCO:
        drawn = board._detector.getBoard().generateImage(tuple(_DETAIL * n for n in board.size))
    else:
        columns, rows = (n + 1 for n in board.size)
        dark = (np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 0).astype(np.uint8)
        drawn = np.kron(255 - 225 * dark, np.ones((_DETAIL, _DETAIL), np.uint8)).astype(np.uint8)
    return np.pad(drawn, _MARGIN * _DETAIL, constant_values=255)


def rays_of(camera: Camera) -> np.ndarray:
    """World directions of the rays that sample a camera's picture, computed once for several pictures."""
    width, height = camera.image_size
    place = (np.arange(_FINER) + 0.5) / _FINER - 0.5
    x, y = np.meshgrid((np.arange(width)[:, None] + place).ravel(), (np.arange(height)[:, None] + place).ravel())
    return np.asarray(camera.directions(np.stack([x, y], axis=-1)) @ camera.R_camera_world)


def seen_by(camera: Camera, rays: np.ndarray, board: Board, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) of a board whose own frame has rotation R (3, 3) and place t (3,) [m] in the world."""
    rays = rays @ R
    eye = R.T @ (camera.centre_world - t)
    far = -eye[2] / rays[..., 2]
    at = eye[:2] + far[..., None] * rays[..., :2]
    first = 0.0 if board.kind == CHARUCO else 1.0  # squares before the origin of the board's frame
    print_at = (at / board.square + first + _MARGIN) * _DETAIL - 0.5
    print_at[~(far > 0.0)] = -1e6
    fine = cv2.remap(
        board_print(board), print_at[..., 0].astype(np.float32), print_at[..., 1].astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=_FLOOR,
    )  # fmt: skip
    grey = cv2.resize(fine, camera.image_size, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)


def held_before(
    camera: Camera, rng: np.random.Generator, board: Board, distance: float
) -> tuple[np.ndarray, np.ndarray]:
    """A pose of the board in the world: facing the camera, tilted by up to 40 degrees, its middle near the axis."""
    tilt, turn = np.radians(rng.uniform(10.0, 40.0)), rng.uniform(0.0, 2.0 * np.pi)
    spin = np.radians(rng.uniform(-25.0, 25.0))
    R_cb = (
        cv2.Rodrigues(tilt * np.array([np.cos(turn), np.sin(turn), 0.0]))[0] @ cv2.Rodrigues(np.array([0, 0, spin]))[0]
    )
    depth = distance * rng.uniform(0.85, 1.3)
    aside = rng.uniform(-0.18, 0.18, 2) * depth
    t_cb = np.array([*aside, depth]) - R_cb @ board.points.mean(axis=0)
    to_world = camera.R_camera_world.T
    return to_world @ R_cb, to_world @ (t_cb - camera.t_camera_world)
