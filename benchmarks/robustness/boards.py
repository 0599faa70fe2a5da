"""Cameras placed by a small or far board, whose mirrored solutions fit nearly as well: how often placements are wrong.

Rigs of one to four cameras with distorting lenses are drawn; corners of the board are projected exactly and disturbed
by noise. Each camera has views of its own of a near board, for the lens, and the cameras share those of a far one,
which lies on the floor in the first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.support.common import Json, save
from estimator.data.boards.adjustment import Pose, angle_between, chained, inverse
from estimator.data.boards.board import Board, BoardSighting
from estimator.data.boards.lens import LensFit, fit_lens
from estimator.data.boards.placement import R_WORLD_BOARD, place_cameras
from estimator.data.cameras.camera import Camera
from estimator.data.media.threads import one_thread
from kinemode.terminal import report

FLOOR = 0
LENS_VIEWS = 12
BOARDS = ((5, 4), (6, 5), (9, 6))
SIZE = (1280, 720)
TURN, SHIFT = 2.0, 0.04  # degrees, share of the distance: beyond them a placement is wrong
_WIDEST = 70.0  # degrees between a board's normal and the line of sight at which its corners are still found


@dataclass(frozen=True)
class BoardRig:
    """Cameras as they stand, the board, its views by all of them, and the standard deviation of corners [px]."""

    cameras: dict[str, Camera]
    board: Board
    views: list[BoardSighting]
    noise: float

    def fits(self) -> dict[str, LensFit]:
        """The lens of every camera from its views."""
        return {
            name: fit_lens(name, self.board, [v for v in self.views if v.camera == name], SIZE, lens="brown", source="")
            for name in self.cameras
        }


def draw_rig(rng: np.random.Generator, count: int) -> BoardRig:
    """A rig of `count` cameras with 3 to 14 shared views of the board, on the floor in the first."""
    board = Board("chessboard", BOARDS[rng.integers(len(BOARDS))], rng.uniform(0.02, 0.045))
    frames = int(rng.integers(3, 15))
    noise, middle = rng.uniform(0.3, 0.5), board.points.mean(axis=0)
    first, step = rng.uniform(0.0, 360.0), rng.uniform(35.0, 90.0)
    cameras = {f"cam{i}": _camera(rng, f"cam{i}", first + i * step) for i in range(count)}
    views, frame = [], FLOOR
    while frame < frames:
        if frame == FLOOR:
            R = cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(0.0, 2.0 * np.pi)]))[0] @ R_WORLD_BOARD
            at = np.array([*rng.uniform(-0.5, 0.5, 2), 0.0])
        else:
            facing = cameras[f"cam{rng.integers(count)}"].R_camera_world.T
            R = facing @ cv2.Rodrigues(rng.uniform(-0.7, 0.7, 3))[0]
            at = np.array([*rng.uniform(-0.8, 0.8, 2), rng.uniform(0.3, 1.7)])
        every = [_board_sighting(rng, c, board, frame, R, at - R @ middle, noise) for c in cameras.values()]
        seen = [view for view in every if view is not None]
        if len(seen) >= min(2, count) or (frame == FLOOR and seen):
            views += seen
            frame += 1
    for camera in cameras.values():
        near = 0
        while near < LENS_VIEWS:
            R = camera.R_camera_world.T @ cv2.Rodrigues(rng.uniform(-0.7, 0.7, 3))[0]
            place = np.array([*rng.uniform(-0.4, 0.4, 2), 1.0]) * rng.uniform(10.0, 25.0) * board.square
            at = camera.R_camera_world.T @ (place - camera.t_camera_world)
            view = _board_sighting(rng, camera, board, frame, R, at - R @ middle, noise)
            if view is not None:
                views.append(view)
                near, frame = near + 1, frame + 1
    return BoardRig(cameras, board, views, noise)


@dataclass(frozen=True)
class PlacedRig:
    """The quality of placements of a rig's cameras: errors to the first camera and of the world, and the notes."""

    turn: float  # degrees, the worst camera to the first
    shift: float  # of the distance between the two, the same
    floor: float  # degrees, between the floor and the true one
    notes: list[str]

    @property
    def wrong(self) -> bool:
        """Whether cameras stand wrongly to each other, or the floor is wrong."""
        return self.turn > TURN or self.shift > SHIFT or self.floor > TURN

    @property
    def doubted(self) -> bool:
        """Whether the notes doubt it."""
        return any("doubt" in note or "uncertain" in note for note in self.notes)


def judge_rig(true: Mapping[str, Camera], placed: Mapping[str, Camera], notes: list[str]) -> PlacedRig:
    """Compare placed cameras with where they stand, each in the floor's world."""
    (first, a), *others = true.items()
    b = placed[first]
    turns, shifts = [0.0], [0.0]
    for name, camera in others:
        relative = [chained(_pose(c), inverse(_pose(origin))) for c, origin in ((camera, a), (placed[name], b))]
        turns.append(angle_between(*relative))
        there, here = (
            first.R_camera_world @ (second.centre_world - first.centre_world)
            for first, second in ((a, camera), (b, placed[name]))
        )
        shifts.append(float(np.linalg.norm(there - here) / np.linalg.norm(there)))
    up = a.R_camera_world[:, 2] @ b.R_camera_world[:, 2]
    return PlacedRig(max(turns), max(shifts), float(np.degrees(np.arccos(min(1.0, up)))), notes)


@one_thread()
def main(*, rigs: int = 60, seed: int = 0, json: Json = None) -> None:
    """Place the cameras of random rigs, as many of one, two, three and four cameras."""
    results: dict[int, list[PlacedRig]] = {}
    for i in range(rigs):
        count = 1 + i % 4
        rig = draw_rig(np.random.default_rng([seed, i]), count)
        cameras, _, notes = place_cameras(rig.fits(), rig.board, rig.views, FLOOR)
        results.setdefault(count, []).append(judge_rig(rig.cameras, cameras, notes))
    made = report.table(
        "placements by small, far boards",
        "cameras",
        "rigs",
        "wrong",
        "said",
        "right, yet in doubt",
        "floor, median [deg]",
    )
    figures = []
    for count, of in sorted(results.items()):
        wrong = [r for r in of if r.wrong]
        row = {
            "cameras": count, "rigs": len(of), "wrong": len(wrong), "said": sum(r.doubted for r in wrong),
            "doubted": sum(r.doubted and not r.wrong for r in of), "floor": float(np.median([r.floor for r in of])),
        }  # fmt: skip
        figures.append(row)
        made.add_row(*(str(v) if isinstance(v, int) else f"{v:.2f}" for v in row.values()))
    report.console().print(made)
    save(json, {"measure": "boards", "rigs": figures})


def _camera(rng: np.random.Generator, name: str, azimuth: float) -> Camera:
    """A camera 4 to 8 m from the middle, above the floor, aimed at a metre above it."""
    angle, distance = np.radians(azimuth), rng.uniform(4.0, 8.0)
    centre = np.array([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(1.5, 3.0)])
    forward = np.array([*rng.uniform(-0.2, 0.2, 2), rng.uniform(0.5, 0.9)]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    focal = rng.uniform(900.0, 1300.0)
    K = np.array(
        [[focal, 0.0, 640.0 + rng.normal(0.0, 8.0)], [0.0, focal, 360.0 + rng.normal(0.0, 8.0)], [0.0, 0.0, 1.0]]
    )
    lens = np.array([rng.uniform(-0.2, 0.05), rng.uniform(-0.03, 0.06), *rng.normal(0.0, 5e-4, 2), 0.0])
    return Camera(name, SIZE, K, lens, R, -R @ centre)


def _board_sighting(
    rng: np.random.Generator, camera: Camera, board: Board, frame: int, R: np.ndarray, t: np.ndarray, noise: float
) -> BoardSighting | None:
    """The board in this pose in the world as the camera sees it, None where it does not."""
    points = board.points @ R.T + t
    line = points.mean(axis=0) - camera.centre_world
    if R[:, 2] @ line < np.cos(np.radians(_WIDEST)) * np.linalg.norm(line) * (frame != FLOOR):
        return None
    pixels = camera.project(points)
    if not (np.isfinite(pixels).all() and (pixels > 5.0).all() and (pixels < np.array(SIZE) - 6.0).all()):
        return None
    return BoardSighting(camera.name, frame, f"frame {frame}", pixels + rng.normal(0.0, noise, pixels.shape))


def _pose(camera: Camera) -> Pose:
    return camera.R_camera_world, camera.t_camera_world
