"""Bundle adjustment: poses of cameras and of a board, those that make the corners of all views fit best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np

from estimator.data.boards.board import Board, BoardSighting
from estimator.data.cameras.camera import Camera
from estimator.numerics.newton import Damping, NewtonSettings, descend

Pose: TypeAlias = tuple[np.ndarray, np.ndarray]
_Placed: TypeAlias = tuple[Mapping[str | int, Pose], list[np.ndarray]]  # poses, residuals by view
_SCALE = 1.0  # px, beyond which a corner counts less
_FAR = 1e3  # px, of what is behind a camera
_STEP = 1e-5  # m, of derivatives
_DAMPING = Damping(least=0.0, growth=8.0, shrink=0.125)  # without a least, as a search may have eight steps alone
_LEAST_GAIN = 1e-7  # px^2, and of the cost
_LEAST_NOISE = 0.05  # px: no corner is taken to be seen more exactly


@dataclass(frozen=True)
class Adjustment:
    """Adjusted poses.

    cameras: camera from world, by name. boards: world from board, by frame. The world is the first camera's frame.
    cost: half the sum of squares, soft L1 beyond 1 px [px^2]. noise: standard deviation of a corner's coordinate that
    the residuals show [px]. covariances (6, 6): by what was moved, of its turn [rad] and shift [m], each in the frame
    the pose leads to.
    """

    cameras: dict[str, Pose]
    boards: dict[int, Pose]
    cost: float
    noise: float
    covariances: dict[str | int, np.ndarray]


def adjust(
    lenses: Mapping[str, Camera],
    board: Board,
    views: Sequence[BoardSighting],
    cameras: Mapping[str, Pose],
    boards: Mapping[int, Pose],
    *,
    moved: Sequence[str | int],
    most_steps: int = 50,
) -> Adjustment:
    """Bundle adjustment from these poses, lenses kept, soft L1 beyond 1 px: Levenberg's and Marquardt's steps on normal
    equations that are summed view by view, many times as fast as SciPy's least squares on numeric derivatives.

    lenses: the cameras by name. views: of those cameras and boards alone. moved: cameras and frames whose poses are
    adjusted, the others stay. most_steps: of the search, rejected ones too.
    """
    at = dict[str | int, Pose]([*cameras.items(), *boards.items()])
    place = {what: slice(6 * i, 6 * i + 6) for i, what in enumerate(moved)}
    eyes = {v.camera: replace(lenses[v.camera], R_camera_world=np.eye(3), t_camera_world=np.zeros(3)) for v in views}

    def placed(at: Mapping[str | int, Pose]) -> _Placed:
        return at, [_residuals(eyes[v.camera], at[v.camera], at[v.frame], board, v) for v in views]

    def step(now: _Placed, equations: tuple[np.ndarray, np.ndarray], damping: float) -> _Placed:
        H, g = equations
        x = -np.linalg.lstsq(H + damping * np.diag(np.diag(H) + 1e-9), g, rcond=None)[0]
        return placed({**now[0], **{what: _moved(now[0][what], x[i]) for what, i in place.items()}})

    best = descend(
        placed(at), lambda now: robust_cost(np.concatenate(now[1])),
        lambda now: _normal_equations(eyes, board, views, *now, place), step,
        NewtonSettings(most_steps, _DAMPING, enough=_LEAST_GAIN, share=_LEAST_GAIN),
    ).model  # fmt: skip
    (adjusted, now), (H, g), cost = best.state, best.expansion, best.value
    noise = max(_LEAST_NOISE, float(np.sqrt(2.0 * cost / max(1, sum(map(len, now)) - len(g)))))
    covariance = noise**2 * np.linalg.pinv(H, hermitian=True)
    return Adjustment(
        {name: adjusted[name] for name in cameras}, {frame: adjusted[frame] for frame in boards}, cost, noise,
        {what: covariance[i, i] for what, i in place.items()},
    )  # fmt: skip


def _residuals(eye: Camera, at: Pose, board_pose: Pose, board: Board, view: BoardSighting) -> np.ndarray:
    """As `corner_residuals`; eye: the camera at the origin."""
    R, t = chained(at, board_pose)
    return np.nan_to_num(eye.project(board.points[view.seen] @ R.T + t) - view.pixels[view.seen], nan=_FAR).ravel()


def _normal_equations(
    eyes: Mapping[str, Camera],
    board: Board,
    views: Sequence[BoardSighting],
    at: Mapping[str | int, Pose],
    residuals: Sequence[np.ndarray],
    place: Mapping[str | int, slice],
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss and Newton's Hessian and gradient of the cost by turns and shifts of what is moved; place: its columns."""
    size = 6 * len(place)
    H, g = np.zeros((size, size)), np.zeros(size)
    for view, r in zip(views, residuals, strict=True):
        (R, t), (R_wb, t_wb) = at[view.camera], at[view.frame]
        arm = board.points[view.seen] @ R_wb.T
        turned = (arm + t_wb) @ R.T
        shifts = _STEP * np.concatenate([np.eye(3), -np.eye(3)])
        moved = eyes[view.camera].project((turned + t)[:, None] + shifts)
        by_point = np.nan_to_num((moved[:, :3] - moved[:, 3:]) / (2.0 * _STEP)).swapaxes(1, 2)  # (N, 2, 3)
        blocks = dict[str | int, np.ndarray]()
        if view.camera in place:
            blocks[view.camera] = _by_pose(by_point, turned)
        if view.frame in place:
            blocks[view.frame] = _by_pose(by_point @ R, arm)
        weight = 1.0 / np.sqrt(1.0 + (r / _SCALE) ** 2)
        for a, J in blocks.items():
            g[place[a]] += J.T @ (weight * r)
            for b, other in blocks.items():
                H[place[a], place[b]] += J.T @ (weight[:, None] * other)
    return H, g


def _by_pose(by_point: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Derivatives (2 N, 6) by a turn and a shift of those (N, 2, 3) by points, whose arms (N, 3) [m] turn."""
    return np.concatenate([np.cross(arm[:, None], by_point), by_point], axis=2).reshape(-1, 6)


def corner_residuals(camera: Camera, at: Pose, board_pose: Pose, board: Board, view: BoardSighting) -> np.ndarray:
    """Expected minus detected corners, x and y of each seen one [px].

    camera: its lens. at: the camera from the world. board_pose: the world from the board.
    """
    eye = replace(camera, R_camera_world=np.eye(3), t_camera_world=np.zeros(3))
    return _residuals(eye, at, board_pose, board, view)


def robust_cost(residuals: np.ndarray) -> float:
    """Half the sum of squares [px^2], soft L1 beyond 1 px, as `adjust` has it."""
    return float(np.sum(_SCALE**2 * (np.sqrt(1.0 + (residuals / _SCALE) ** 2) - 1.0)))


def inverse(pose: Pose) -> Pose:
    """The pose the other way: b from a of a from b."""
    return pose[0].T, -pose[0].T @ pose[1]


def chained(first: Pose, second: Pose) -> Pose:
    """a from c of a from b and b from c."""
    return first[0] @ second[0], first[0] @ second[1] + first[1]


def angle_between(a: Pose, b: Pose) -> float:
    """The rotation between two poses [deg]."""
    return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(a[0].T @ b[0]) - 1.0), -1.0, 1.0))))


def _moved(pose: Pose, step: np.ndarray) -> Pose:
    return np.asarray(cv2.Rodrigues(step[:3])[0]) @ pose[0], pose[1] + step[3:]
