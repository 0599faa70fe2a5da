"""One camera's lens from views of a board (Zhang 2000), by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.boards.board import Board, BoardSighting
from estimator.data.cameras.camera import Camera, guessed_camera
from humanoid.support.errors import InputError

LENSES = ("brown", "rational", "fisheye")
FEWEST_VIEWS, MOST_VIEWS = 5, 40
LEAST_TILT = 8.0  # degrees between the boards of the two views that differ most
NEAR = 0.4  # of the size of the largest board in a picture: smaller ones do not shape the lens
UNSURE = 0.01  # of the focal length: standard deviation from which it is doubted
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-9)


class BoardPose(NamedTuple):
    """Rotation (3, 3) and translation (3,) [m] of the board in the camera's frame, and the root mean square distance of
    its corners from where they are seen [px]."""

    R: np.ndarray
    t: np.ndarray
    error: float


@dataclass(frozen=True)
class LensFit:
    """A camera as the board shows it, at the origin.

    camera: K and distortion. poses: of the board by frame, see `board_poses`. focal_std [px].
    """

    camera: Camera
    poses: dict[int, list[BoardPose]]
    focal_std: float

    @property
    def rms(self) -> float:
        """The RMS error of all views [px]."""
        return float(np.sqrt(np.mean([best.error**2 for best, *_ in self.poses.values()])))


def fit_lens(
    name: str, board: Board, views: Sequence[BoardSighting], size: tuple[int, int], *, lens: str, source: str
) -> LensFit:
    """The lens of a camera with pictures of `size` [px].

    views: those with a board. lens: one of `LENSES`: Brown's 5 coefficients, the rational model's 8, a fisheye's 4.

    Raises
    ------
    InputError: too few views, or all with the board at one tilt, which does not determine the focal length.
    """
    if len(views) < FEWEST_VIEWS:
        problem = f"{len(views)} pictures show {board.description}, at least {FEWEST_VIEWS} are needed"
        remedy = "10 to 20, near and far, tilted to all sides, up to the corners of the picture"
        raise InputError(source, problem, place=name, remedy=remedy)
    near = _near(views)
    some = [near[i] for i in np.unique(np.linspace(0, len(near) - 1, min(len(near), MOST_VIEWS)).astype(int))]
    points = [np.ascontiguousarray(board.points[v.seen][:, None], dtype=np.float64) for v in some]
    pixels = [np.ascontiguousarray(v.pixels[v.seen][:, None], dtype=np.float64) for v in some]
    try:
        K, distortion, turns, std = (_fisheye if lens == "fisheye" else _pinhole)(points, pixels, size, lens)
    except cv2.error as error:
        problem = f"no {lens} lens fits the corners: {error.err or 'OpenCV found none'}"
        raise InputError(source, problem, place=name, remedy="more views, tilted; or another --lens") from None
    _check_tilts(turns, name, source)
    guess = guessed_camera(name, size)
    camera = replace(guess, K=K, distortion=distortion, fisheye=lens == "fisheye")
    poses = {}
    for view in views:
        placed = board_poses(camera, board, view)
        if placed:
            poses[view.frame] = placed
    return LensFit(camera, poses, std)


def _near(views: Sequence[BoardSighting]) -> list[BoardSighting]:
    """The views in which the board is not small beside the others: small ones hardly constrain the lens, and where
    OpenCV starts one mirrored it settles on a wrong focal length."""
    sizes = np.array([np.linalg.norm(np.ptp(v.pixels[v.seen], axis=0)) for v in views])
    least = min(NEAR * sizes.max(), np.sort(sizes)[-FEWEST_VIEWS])
    return [v for v, size in zip(views, sizes, strict=True) if size >= least]


def _pinhole(
    points: list[np.ndarray], pixels: list[np.ndarray], size: tuple[int, int], lens: str
) -> tuple[np.ndarray, np.ndarray, Sequence[np.ndarray], float]:
    """K, distortion, the board's rotation vectors and the focal length's standard deviation [px]."""
    count = 8 if lens == "rational" else 5
    flags = cv2.CALIB_RATIONAL_MODEL if lens == "rational" else 0
    singles = [p.astype(np.float32) for p in points], [p.astype(np.float32) for p in pixels]
    _, K, distortion, turns, _, std, _, _ = cv2.calibrateCameraExtended(
        *singles, size, np.zeros((3, 3)), np.zeros(count), flags=flags, criteria=_CRITERIA
    )
    return np.asarray(K), np.ravel(distortion)[:count].copy(), turns, float(np.ravel(std)[:2].max())


def _fisheye(
    points: list[np.ndarray], pixels: list[np.ndarray], size: tuple[int, int], lens: str
) -> tuple[np.ndarray, np.ndarray, Sequence[np.ndarray], float]:
    """As `_pinhole`; OpenCV gives no standard deviation, so none."""
    names = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2  # OpenCV 5 moved them
    flags = names.CALIB_RECOMPUTE_EXTRINSIC | names.CALIB_FIX_SKEW
    flat = [p.reshape(1, -1, 3) for p in points], [p.reshape(1, -1, 2) for p in pixels]  # the layout it takes
    _, K, distortion, turns, _ = cv2.fisheye.calibrate(
        *flat, size, np.zeros((3, 3)), np.zeros(4), flags=flags, criteria=_CRITERIA
    )
    return np.asarray(K), np.ravel(distortion).copy(), turns, 0.0


def board_poses(camera: Camera, board: Board, view: BoardSighting) -> list[BoardPose]:
    """The poses in which the board looks as in the view, the better one first: at most two, of which the second is the
    mirrored solution (Collins and Bartoli, "Infinitesimal plane-based pose estimation", IJCV 2014); none where the
    corners make none."""
    rays = camera.directions(view.pixels[view.seen])[:, :2]
    good = np.isfinite(rays).all(axis=1)
    points = board.points[view.seen][good]
    if len(points) < 4:
        return []
    poses: list[BoardPose] = []
    try:
        _, turns, places, _ = cv2.solvePnPGeneric(points, rays[good], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
        for start in zip(turns, places, strict=True):
            turn, t = cv2.solvePnPRefineLM(points, rays[good], np.eye(3), None, *start)
            if np.isfinite(turn).all() and t[2, 0] > 0.0:
                R, t = cv2.Rodrigues(turn)[0], t[:, 0]
                there = replace(camera, R_camera_world=R, t_camera_world=t).project(board.points)
                distance = np.linalg.norm(there - view.pixels, axis=1)[view.seen]
                poses.append(BoardPose(R, t, float(np.sqrt(np.nanmean(distance**2)))))
    except cv2.error:
        pass
    return sorted(poses, key=lambda pose: pose.error)


def _check_tilts(turns: Sequence[np.ndarray], name: str, source: str) -> None:
    """Raise InputError where all views show the board at one tilt; turns (3, 1): its rotation vectors in the camera."""
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    widest = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0).min())))
    if widest < LEAST_TILT:
        problem = f"the board has one tilt in all {len(turns)} views (within {widest:.1f} degrees)"
        remedy = "the focal length cannot be measured: take views tilted by 20 to 45 degrees to several sides"
        raise InputError(source, problem, place=name, remedy=remedy)
