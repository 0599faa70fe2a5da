"""`calibrate`: from pictures of a board to cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from estimator.data.boards.board import Board, BoardSighting, Shots
from estimator.data.boards.lens import FEWEST_VIEWS, UNSURE, BoardPose, LensFit, fit_lens
from estimator.data.boards.placement import place_cameras
from estimator.data.cameras.camera import Camera
from estimator.data.media.threads import one_thread
from humanoid.support.errors import InputError

MOST_PICTURES = 120  # of a camera that are used, evenly spaced
_LOOKED_AT = 3  # pictures in which another board is searched for
_APART = 3.0  # times the lens's own error, from which placements are doubted

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class BoardView:
    """A view, where its corners should be (N, 2) [px] and how far they are from there, root mean square [px]."""

    view: BoardSighting
    expected: np.ndarray
    error: float


@dataclass(frozen=True)
class BoardCalibration:
    """The cameras found from the pictures of a board.

    cameras: by name; several in the world of the board in frame `origin` (see `estimator.data.boards.placement`), a
    single one so too where an origin was requested, otherwise placed like one without a calibration. views: all with a
    board. lens_errors: root mean square distance of the corners by camera, the board placed in each view alone [px];
    placed_errors: with the board in one place for all cameras, empty for a single one. looked_at: pictures by camera.
    notes: what the user should know.
    """

    cameras: dict[str, Camera]
    views: tuple[BoardView, ...]
    lens_errors: dict[str, float]
    placed_errors: dict[str, float]
    looked_at: dict[str, int]
    origin: int | None
    notes: tuple[str, ...]

    def of(self, camera: str) -> list[BoardView]:
        """The views of a camera, the worst first."""
        return sorted((v for v in self.views if v.view.camera == camera), key=lambda v: -v.error)


@one_thread()
def calibrate(
    shots: Sequence[Shots],
    board: Board,
    *,
    lens: str = "brown",
    origin: int | None = None,
    progress: Progress = lambda done, total: None,
) -> BoardCalibration:
    """Lenses of cameras, and where several of them stand.

    Picture number i of every camera has to be of the same instant where there are several. origin: number of the
    pictures in which the board makes the world; of several cameras those that most of them see unless given.

    Raises
    ------
    InputError: no board, another board, too few or too similar views, cameras that share none, no board at the origin.
    """
    if len(shots) > 1 and not board.has_one_way_up:
        remedy = "one with an odd and an even number of inner corners, as 9x6, or a ChArUco board"
        raise InputError("size", f"{board.description} looks the same upside down to several cameras", remedy=remedy)
    frames = _frames(shots, origin)
    views = _views(shots, board, frames, progress)
    fits = {s.name: fit_lens(s.name, board, views[s.name], s.image_size, lens=lens, source=s.source) for s in shots}
    every = [view for name in fits for view in views[name]]
    notes = [
        f"{name}: the focal length is uncertain by {fit.focal_std:.1f} px: take more views, tilted to all sides"
        for name, fit in fits.items()
        if fit.focal_std > UNSURE * fit.camera.K[0, 0]
    ]
    cameras, placed = {name: fit.camera for name, fit in fits.items()}, dict[str, float]()
    if len(shots) > 1 or origin is not None:
        origin = _origin(fits, every, origin)
        cameras, errors, unsure = place_cameras(fits, board, every, origin)
        placed = errors if len(shots) > 1 else placed
        notes += _doubts(fits, placed) + unsure
    return BoardCalibration(
        cameras=cameras,
        views=tuple(
            _board_view(fits[v.camera].camera, board, v, fits[v.camera].poses[v.frame][0])
            for v in every
            if v.frame in fits[v.camera].poses
        ),
        lens_errors={name: fit.rms for name, fit in fits.items()},
        placed_errors=placed,
        looked_at={s.name: len(frames[s.name]) for s in shots},
        origin=origin,
        notes=tuple(notes),
    )


def _frames(shots: Sequence[Shots], origin: int | None) -> dict[str, list[int]]:
    """Numbers of the pictures that are used, by camera: the same for all, including the origin."""
    count = min(s.count for s in shots)
    if origin is not None and not 0 <= origin < count:
        problem = f"there is no picture {origin} of every camera"
        raise InputError("origin", problem, remedy=f"0 to {count - 1}, counted from 0")
    chosen = set(np.linspace(0, count - 1, min(count, MOST_PICTURES)).round().astype(int).tolist())
    return {s.name: sorted(chosen | ({origin} if origin is not None else set())) for s in shots}


def _views(
    shots: Sequence[Shots], board: Board, frames: Mapping[str, list[int]], progress: Progress
) -> dict[str, list[BoardSighting]]:
    """The pictures of each camera that show the board."""
    total, done = sum(len(frames[s.name]) for s in shots), 0
    views: dict[str, list[BoardSighting]] = {}
    for s in shots:
        views[s.name] = []
        for frame in frames[s.name]:
            pixels = board.corners(s.picture(frame))
            if pixels is not None:
                views[s.name].append(BoardSighting(s.name, frame, s.label(frame), pixels))
            done += 1
            progress(done, total)
        if len(views[s.name]) < FEWEST_VIEWS:
            _check_board(s, board, frames[s.name], {view.frame for view in views[s.name]})
    return views


def _check_board(shots: Shots, board: Board, frames: Sequence[int], seen: Set[int]) -> None:
    """Raise InputError where no picture shows the board, or those that do not show another."""
    problem = f"{board.description} is in {len(seen) or 'none'} of {len(frames)} pictures"
    without = [frame for frame in frames if frame not in seen]
    for i in np.unique(np.linspace(0, len(without) - 1, min(len(without), _LOOKED_AT)).astype(int)):
        other = board.instead(shots.picture(without[i]))
        if other is not None:
            size, label = "{}x{}".format(*other.size), shots.label(without[i])
            option = f"--size {size}" if other.size != board.size else f"--dictionary {other.dictionary}"
            raise InputError(
                shots.source, problem, place=shots.name, remedy=f"{label} shows {other.description}: {option}"
            )
    if seen:
        return
    remedy = "all of it in the picture, flat, sharp, with a white margin; --size counts inner corners of a chessboard,"
    raise InputError(shots.source, problem, place=shots.name, remedy=f"{remedy} squares of a ChArUco board")


def _origin(fits: Mapping[str, LensFit], views: Sequence[BoardSighting], given: int | None) -> int:
    """The frame whose board is the world's origin."""
    seen = {frame: sum(frame in fit.poses for fit in fits.values()) for frame in {v.frame for v in views}}
    if given is None:
        return min(seen, key=lambda frame: (-seen[frame], frame))
    if not seen.get(given):
        raise InputError("origin", f"no camera sees the board in picture {given}", remedy="choose one that shows it")
    return given


def _doubts(fits: Mapping[str, LensFit], placed: Mapping[str, float]) -> list[str]:
    """Notes on cameras that see the board elsewhere than the others do."""
    return [
        f"{name}: corners are {error:.2f} px from where the other cameras see them, {fits[name].rms:.2f} px by itself:"
        " are the pictures of the same instants, and did no camera move?"
        for name, error in placed.items()
        if error > max(1.0, _APART * fits[name].rms)
    ]


def _board_view(camera: Camera, board: Board, view: BoardSighting, pose: BoardPose) -> BoardView:
    there = replace(camera, R_camera_world=pose.R, t_camera_world=pose.t)
    return BoardView(view, there.project(board.points), pose.error)
