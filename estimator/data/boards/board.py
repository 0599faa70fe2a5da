"""A flat board of squares, its corners in a picture, and one camera's pictures of it: a video, a folder or picture
files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from estimator.data.media.clip import IMAGE_SUFFIXES, Clip, FolderClip
from estimator.data.media.picture import read_picture
from humanoid.support.errors import InputError

CHESSBOARD, CHARUCO = "chessboard", "charuco"
KINDS = (CHESSBOARD, CHARUCO)
DICTIONARIES = (
    *(f"{bits}_{count}" for bits in ("4X4", "5X5", "6X6", "7X7") for count in (50, 100, 250, 1000)),
    "ARUCO_ORIGINAL",
)
_WIDEST = tuple(name for name in DICTIONARIES if name.endswith(("_1000", "ORIGINAL")))  # they hold the smaller ones
FEWEST_CORNERS = 6  # of a view
_SIDES = (2, 50)  # inner corners
_MARKER = 0.75  # of the square, unless given
_WINDOW = 0.2  # of the shortest side between corners: the largest half-width of a corner's search window
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-4)
_AROUND = ((-1, -1), (1, 1), (-1, 0), (0, -1), (1, 0), (0, 1))  # how people miscount


@dataclass(frozen=True)
class Board:
    """A chessboard or a ChArUco board.

    kind: one of `KINDS`. size: columns and rows; inner corners of a chessboard, squares of a ChArUco board, as OpenCV
    counts them. square, marker [m]: sides. dictionary: of the markers, one of `DICTIONARIES`.

    Raises
    ------
    InputError: impossible sizes and lengths.
    """

    kind: str
    size: tuple[int, int]
    square: float
    marker: float | None = None
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        columns, rows = self.inner
        if not (_SIDES[0] <= min(columns, rows) and max(columns, rows) <= _SIDES[1]):
            shown = "{}x{}".format(*self.size)
            raise InputError(
                "size",
                f"must have {_SIDES[0]} to {_SIDES[1]} inner corners a side, got {shown}",
                remedy="columns x rows, as 9x6",
            )
        if not 0.0 < self.square < 10.0:
            raise InputError(
                "square",
                f"must be above 0 and below 10 m, got {self.square:g}",
                remedy="the side of a square, as 0.025",
            )
        if self.kind == CHARUCO and not 0.0 < self.marker_side < self.square:
            problem = f"{self.marker_side:g} m does not fit as a marker in a square of {self.square:g} m"
            raise InputError("marker", problem, remedy="the side of a marker in metres, less than the square's")

    @property
    def inner(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        less = 1 if self.kind == CHARUCO else 0
        return self.size[0] - less, self.size[1] - less

    @property
    def marker_side(self) -> float:
        """Side of a marker [m]."""
        return _MARKER * self.square if self.marker is None else self.marker

    @property
    def description(self) -> str:
        """The board in words."""
        columns, rows = self.size
        if self.kind == CHARUCO:
            return f"a ChArUco board of {columns} x {rows} squares with markers of {self.dictionary}"
        return f"a chessboard of {columns} x {rows} inner corners"

    @property
    def has_one_way_up(self) -> bool:
        """Whether it looks another way when it is turned by 180 degrees: several cameras then agree on its corners."""
        return self.kind == CHARUCO or sum(self.size) % 2 == 1

    @cached_property
    def points(self) -> np.ndarray:
        """Its inner corners row by row (N, 3) [m]: x along the columns, y along the rows, z into the board, away from
        a viewer in front of it."""
        columns, rows = self.inner
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        first = self.square if self.kind == CHARUCO else 0.0  # OpenCV's ChArUco boards begin at their outer corner
        return np.stack([first + self.square * x, first + self.square * y, np.zeros(x.shape)], axis=-1).reshape(-1, 3)

    @cached_property
    def _detector(self) -> cv2.aruco.CharucoDetector:
        markers = cv2.aruco.getPredefinedDictionary(_dictionary(self.dictionary))
        return cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard(self.size, self.square, self.marker_side, markers))

    def corners(self, picture: np.ndarray, *, quick: bool = False) -> np.ndarray | None:
        """Its inner corners in a picture (H, W, 3) uint8 BGR: pixels (N, 2), NaN where one is not seen, None where too
        few are; of a chessboard all are seen or none. quick: without a second search for blurred chessboards."""
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        pixels = self._charuco(grey) if self.kind == CHARUCO else self._chessboard(grey, quick)
        if pixels is None:
            return None
        clear = 0.5 * (1.0 - self.marker_side / self.square) if self.kind == CHARUCO else _WINDOW
        return _sharpened(grey, pixels, self.inner, min(clear, _WINDOW))

    def _charuco(self, grey: np.ndarray) -> np.ndarray | None:
        corners, ids, _, _ = self._detector.detectBoard(grey)
        if ids is None or len(ids) < FEWEST_CORNERS:
            return None
        pixels = np.full((len(self.points), 2), np.nan)
        pixels[np.ravel(ids)] = np.reshape(corners, (-1, 2))
        seen = self.points[np.isfinite(pixels[:, 0]), :2]
        on_a_line = np.linalg.matrix_rank(seen - seen[0], tol=1e-9) < 2
        return None if on_a_line else pixels

    def _chessboard(self, grey: np.ndarray, quick: bool) -> np.ndarray | None:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        there, corners = cv2.findChessboardCorners(grey, self.size, flags=flags)
        if not there and not quick:  # finds blurred boards too, in thirty times the time
            there, corners = cv2.findChessboardCornersSB(grey, self.size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not there:
            return None
        columns, rows = self.size
        grid = np.reshape(corners, (rows, columns, 2)).astype(float)
        across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if across[0] * down[1] - across[1] * down[0] < 0.0:  # seen from the front x goes right where y goes down
            grid = grid[:, ::-1]
        if self.has_one_way_up and _brightness(grey, grid[:2, :2]) > _brightness(grey, grid[:2, 1:3]):
            grid = grid[::-1, ::-1]  # the first square between corners is dark
        return np.ascontiguousarray(grid.reshape(-1, 2))

    def instead(self, picture: np.ndarray) -> Board | None:
        """Another board that the picture shows, in case of a miscount: one column or row more or less."""
        sizes = [(self.size[0] + x, self.size[1] + y) for x, y in _AROUND] + [(self.size[1], self.size[0])]
        names = [self.dictionary]
        if self.kind == CHARUCO:
            sizes = [self.size]
            names = [name for name in _WIDEST if name.partition("_")[0] != self.dictionary.partition("_")[0]]
        for size in sizes:
            for name in names:
                if min(size) > _SIDES[0] + 1:
                    other = Board(self.kind, size, self.square, self.marker, name)
                    if other.corners(picture, quick=True) is not None:
                        return other
        return None


def _dictionary(name: str) -> int:
    if name not in DICTIONARIES:
        raise InputError("dictionary", f"{name!r} is unknown", remedy=f"one of {', '.join(DICTIONARIES)}")
    return int(getattr(cv2.aruco, f"DICT_{name}"))


def _sharpened(grey: np.ndarray, pixels: np.ndarray, inner: tuple[int, int], clear: float) -> np.ndarray:
    """Corners (N, 2) [px] where the edges around them meet: half as far off as OpenCV's detectors leave them.

    clear: share of a square's side around a corner within which there is nothing else.
    """
    grid = pixels.reshape(inner[1], inner[0], 2)
    sides = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)]
    window = int(np.clip(clear * np.nanmin(np.concatenate(sides)), 2, 11))
    seen = np.isfinite(pixels[:, 0])
    start = pixels[seen].astype(np.float32).reshape(-1, 1, 2)
    better = cv2.cornerSubPix(grey, start, (window, window), (-1, -1), _CRITERIA)[:, 0]
    result = pixels.copy()
    near = np.linalg.norm(better - pixels[seen], axis=1) < window
    result[seen] = np.where(near[:, None], better, pixels[seen])
    return result


def _brightness(grey: np.ndarray, corners: np.ndarray) -> float:
    """Median brightness of the middle of a square with these corners (2, 2, 2) [px]."""
    middle = corners.reshape(4, 2).mean(axis=0)
    inner = middle + 0.4 * (corners.reshape(4, 2)[[0, 1, 3, 2]] - middle)
    mask = np.zeros(grey.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(inner).astype(np.int32), 1)
    inside = grey[mask > 0]
    return float(np.median(inside)) if inside.size else 0.0


@dataclass(frozen=True)
class BoardSighting:
    """The board as a camera saw it.

    camera: its name. frame: number of the picture. label: the picture's name. pixels (N, 2): of the board's corners,
    NaN where one is not seen.
    """

    camera: str
    frame: int
    label: str
    pixels: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """Which corners are seen, (N,)."""
        return np.isfinite(self.pixels[:, 0])


class Shots:
    """The pictures of one camera by number.

    paths: a video or a folder, or picture files in the order given. name: of the camera.

    Raises
    ------
    InputError: no pictures.
    """

    def __init__(self, name: str, paths: Sequence[Path]) -> None:
        self.name, self.paths = name, list(paths)
        alone = self.paths[0] if len(self.paths) == 1 else None
        if alone is not None and (alone.is_dir() or alone.suffix.lower() not in IMAGE_SUFFIXES):
            self._clip: Clip | None = Clip.open(alone)
        else:
            self._clip = None
            wrong = [p for p in self.paths if p.is_dir() or p.suffix.lower() not in IMAGE_SUFFIXES]
            if wrong:
                remedy = "one video or folder for each camera, NAME=PATH, or picture files of one"
                raise InputError(wrong[0], f"cannot go together with other pictures of {name!r}", remedy=remedy)

    @property
    def source(self) -> str:
        """Their label in errors."""
        return str(self.paths[0]) if len(self.paths) == 1 else str(self.paths[0].parent)

    @cached_property
    def count(self) -> int:
        """Their number."""
        if self._clip is None:
            return len(self.paths)
        return len(self._clip.files) if isinstance(self._clip, FolderClip) else self._clip.report.read

    @cached_property
    def image_size(self) -> tuple[int, int]:
        """Width and height [px]."""
        if self._clip is not None:
            return self._clip.image_size
        height, width = read_picture(self.paths[0])[0].shape[:2]
        return width, height

    def picture(self, index: int) -> np.ndarray:
        """A picture (H, W, 3) uint8 BGR; raises InputError where it is of another size than the first."""
        if self._clip is not None:
            return self._clip.frame(index)
        picture = read_picture(self.paths[index])[0]
        if picture.shape[1::-1] != self.image_size:
            sizes = "{} x {} pixels, the first {} x {}".format(*picture.shape[1::-1], *self.image_size)
            raise InputError(self.paths[index], f"is {sizes}", remedy="calibrate with pictures of one size")
        return picture

    def label(self, index: int) -> str:
        """The label of a picture."""
        if isinstance(self._clip, FolderClip):
            return self._clip.files[index].name
        return f"frame {index}" if self._clip is not None else self.paths[index].name

    def close(self) -> None:
        """Let go of the file."""
        if self._clip is not None:
            self._clip.close()
