"""Where several cameras stand that saw one board: a chain of its poses, then everything together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix

from estimator.data.boards.board import Board
from estimator.data.boards.lens import LensFit
from estimator.data.boards.shots import BoardSighting
from estimator.data.cameras.camera import Camera
from humanoid.support.errors import InputError

R_WORLD_BOARD = np.diag([1.0, -1.0, -1.0])
"""The world of a board that lies on the floor, face up: origin at its first inner corner (of a ChArUco board at its
outer corner), x along its columns, y against its rows, z up out of its face."""
MOST_FRAMES = 40  # with boards that hold the cameras together
_SCALE = 1.0  # px, beyond which a corner counts less
_FAR = 1e3  # px, of what is behind a camera

Pose = tuple[np.ndarray, np.ndarray]


def place_cameras(
    fits: Mapping[str, LensFit], board: Board, views: Sequence[BoardSighting], origin: int
) -> tuple[dict[str, Camera], dict[str, float]]:
    """The cameras in the world of the board in frame `origin`, and the root mean square distance of the corners in each
    from where the board is that all of them see [px].

    Lenses are kept; cameras, and the board in every frame that two cameras saw, are moved until the corners of all
    fit best (bundle adjustment, soft L1 beyond 1 px).

    Raises
    ------
    InputError: a camera that shares no board with the others, not even by a chain of them.
    """
    used = _shared(fits, views, origin)
    cameras, boards = _chained(fits, used, origin)
    lost = [name for name in fits if name not in cameras]
    if lost:
        others = ", ".join(name for name in fits if name in cameras) or "any other"
        problem = f"there is no frame in which {', '.join(lost)} and {others} see the board"
        remedy = "carry it through where their views meet; the pictures of all cameras have to be of the same instants"
        raise InputError("calibrate", problem, remedy=remedy)
    refined = _adjusted(fits, board, used, cameras, boards, origin)
    errors = {}
    for name, fit in fits.items():
        distances = [
            _residuals(fit.camera, refined[0][name], refined[1][v.frame], board, v) for v in used if v.camera == name
        ]
        errors[name] = float(np.sqrt(2.0 * np.mean(np.square(np.concatenate(distances)))))
    placed = {
        name: replace(fit.camera, R_camera_world=refined[0][name][0], t_camera_world=refined[0][name][1])
        for name, fit in fits.items()
    }
    return placed, errors


def _shared(fits: Mapping[str, LensFit], views: Sequence[BoardSighting], origin: int) -> list[BoardSighting]:
    """Views of the frames that several cameras saw, and of the origin; evenly some where there are many."""
    posed = [v for v in views if v.frame in fits[v.camera].poses]
    frames = sorted({v.frame for v in posed})
    several = [f for f in frames if sum(v.frame == f for v in posed) > 1]
    kept = (
        {several[i] for i in np.unique(np.linspace(0, len(several) - 1, MOST_FRAMES).astype(int))} if several else set()
    )
    return [v for v in posed if v.frame in kept | {origin}]


def _chained(
    fits: Mapping[str, LensFit], views: Sequence[BoardSighting], origin: int
) -> tuple[dict[str, Pose], dict[int, Pose]]:
    """Poses of cameras (camera from world) and boards (world from board) along the views with the least error."""
    cameras: dict[str, Pose] = {}
    boards: dict[int, Pose] = {origin: (R_WORLD_BOARD, np.zeros(3))}
    left = sorted(views, key=lambda v: fits[v.camera].errors[v.frame])
    while True:
        new = next((v for v in left if (v.camera in cameras) != (v.frame in boards)), None)
        if new is None:
            return cameras, boards
        R_cb, t_cb = fits[new.camera].poses[new.frame]
        if new.frame in boards:
            R_wb, t_wb = boards[new.frame]
            R = R_cb @ R_wb.T
            cameras[new.camera] = R, t_cb - R @ t_wb
        else:
            R, t = cameras[new.camera]
            boards[new.frame] = R.T @ R_cb, R.T @ (t_cb - t)


def _adjusted(
    fits: Mapping[str, LensFit],
    board: Board,
    views: Sequence[BoardSighting],
    cameras: Mapping[str, Pose],
    boards: Mapping[int, Pose],
    origin: int,
) -> tuple[dict[str, Pose], dict[int, Pose]]:
    """All poses, those that make the corners fit best; the board at the origin stays."""
    names, frames = list(cameras), [f for f in boards if f != origin]
    start = np.concatenate([_vector(cameras[n]) for n in names] + [_vector(boards[f]) for f in frames])

    def unpacked(x: np.ndarray) -> tuple[dict[str, Pose], dict[int, Pose]]:
        parts = [_pose(part) for part in x.reshape(-1, 6)]
        moved = dict(zip(frames, parts[len(names) :], strict=True))
        return dict(zip(names, parts, strict=False)), {origin: boards[origin], **moved}

    def residuals(x: np.ndarray) -> np.ndarray:
        at, placed = unpacked(x)
        return np.concatenate(
            [_residuals(fits[v.camera].camera, at[v.camera], placed[v.frame], board, v) for v in views]
        )

    pattern = lil_matrix((len(residuals(start)), len(start)), dtype=np.int8)
    row = 0
    for v in views:
        count = 2 * int(v.seen.sum())
        columns = [6 * names.index(v.camera)]
        columns += [] if v.frame == origin else [6 * (len(names) + frames.index(v.frame))]
        for column in columns:
            pattern[row : row + count, column : column + 6] = 1
        row += count
    solved = least_squares(
        residuals, start, jac_sparsity=pattern, x_scale="jac", loss="soft_l1", f_scale=_SCALE, max_nfev=50
    )
    return unpacked(solved.x)


def _residuals(camera: Camera, at: Pose, board_pose: Pose, board: Board, view: BoardSighting) -> np.ndarray:
    """Where corners are seen less where they should be, x and y of each seen [px]."""
    points = board.points[view.seen] @ board_pose[0].T + board_pose[1]
    there = replace(camera, R_camera_world=at[0], t_camera_world=at[1]).project(points)
    return np.nan_to_num(there - view.pixels[view.seen], nan=_FAR).ravel()


def _vector(pose: Pose) -> np.ndarray:
    return np.concatenate([cv2.Rodrigues(pose[0])[0].ravel(), pose[1]])


def _pose(vector: np.ndarray) -> Pose:
    return np.asarray(cv2.Rodrigues(vector[:3])[0]), vector[3:]
