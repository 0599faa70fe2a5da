"""A person's picture, cut out so that it depends neither on where they stand nor on how far away, and its edge
direction histograms, by which it is found in an index of examples.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.threads import one_thread

SIDE = 200  # px of the square picture that they are made of
DIRECTIONS = 4
WINDOWS = (8, 16, 32)  # px, each at steps of half its size
_FINE = 3.0  # px, standard deviation of the smoothing: edges of clothes are finer than those of limbs, and chance
LEAST_CONTRAST = 5.0  # grey values across an edge of the smoothed picture, over a pixel
_FINE_OUTLINE, _LEAST_OUTLINE = 1.0, 40.0  # the same for the picture of where the person is, 0 and 255
_SLOPE_OF_STEP = 4.0  # Sobel's answer to a step of one grey value beside it


def bin_count() -> int:
    """Bins of a histogram: 13,076."""
    return sum((SIDE // (size // 2)) ** 2 for size in WINDOWS) * DIRECTIONS


def edge_histogram(picture: np.ndarray, where: np.ndarray | None = None) -> np.ndarray:
    """Histogram of edge pixels by direction in each window, (bins,) uint16 (Shakhnarovich, Viola, Darrell 2003, section
    4; ELMO section 4).

    A bin is a window and a direction. Windows of 8, 16 and 32 px begin at every multiple of half their size for which
    such a step still fits into the picture, and are cut at its border: (50^2 + 25^2 + 12^2) x 4 bins, ordered by
    size, row, column and direction. Directions are those of the edge's normal to the nearest 45 degrees, light to dark
    and dark to light the same: horizontal, falling, vertical, rising.

    picture (200, 200) uint8, grey. where (200, 200) bool: where the person is; only edges there count, and the outline
    is one however alike person and background are. Without it all edges count.

    Raises
    ------
    ValueError: the picture has another size or kind.
    """
    if picture.shape != (SIDE, SIDE) or picture.dtype != np.uint8:
        raise ValueError(f"the picture is {picture.dtype} {picture.shape}, not uint8 {(SIDE, SIDE)}")
    sums = [cv2.integral(edges) for edges in edges_by_direction(picture, where)]
    return np.concatenate([_counts(sums, size) for size in WINDOWS])


def edges_by_direction(picture: np.ndarray, where: np.ndarray | None) -> list[np.ndarray]:
    """Masks (H, W) uint8 of the edge pixels of each direction: thin, and strong enough to be seen; see
    `edge_histogram`."""
    edges, dx, dy = _edges(picture, _FINE, LEAST_CONTRAST)
    if where is not None:
        outline, *slope = _edges(where.astype(np.uint8) * np.uint8(255), _FINE_OUTLINE, _LEAST_OUTLINE)
        edges = (edges & where) | outline
        dx, dy = (np.where(outline, of_outline, of_all) for of_outline, of_all in zip(slope, (dx, dy), strict=True))
    angle = cv2.phase(dx.astype(np.float32), dy.astype(np.float32))
    direction = np.round(angle * (DIRECTIONS / np.pi)).astype(np.int64) % DIRECTIONS
    return [(edges & (direction == k)).astype(np.uint8) for k in range(DIRECTIONS)]


def _edges(picture: np.ndarray, fine: float, contrast: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where there are edges (H, W) bool, and the slope along columns and rows, of a picture smoothed by `fine` [px]."""
    smooth = cv2.GaussianBlur(picture, (0, 0), fine)
    dx, dy = (cv2.Sobel(smooth, cv2.CV_16S, *order) for order in ((1, 0), (0, 1)))
    strong = _SLOPE_OF_STEP * contrast
    return cv2.Canny(dx, dy, 0.5 * strong, strong, L2gradient=True) > 0, dx, dy


def _counts(sums: list[np.ndarray], size: int) -> np.ndarray:
    """Sums over all windows of a size, from integral images (H + 1, W + 1) of each direction."""
    step = size // 2
    first = step * np.arange(SIDE // step)
    last = np.minimum(first + size, SIDE)
    of_windows = [
        s[np.ix_(last, last)] - s[np.ix_(first, last)] - s[np.ix_(last, first)] + s[np.ix_(first, first)] for s in sums
    ]
    return np.stack(of_windows, axis=-1).ravel().astype(np.uint16)


@dataclass(frozen=True)
class ViewFrame:
    """A frame at a person, turned to the camera.

    origin (3,): the middle of the surface that is seen, in the world [m]. R_world_view (3, 3): its axes x away from the
    camera, level; y to the left; z up.
    """

    origin: np.ndarray
    R_world_view: np.ndarray

    @staticmethod
    def at(places: np.ndarray, camera: Camera, up: np.ndarray) -> ViewFrame:
        """Frame of the places (N, 3) in the world [m] of a person's surface that a camera sees, one or more; up (3,).

        Their median is where most of the person is, whatever one arm does.
        """
        origin = np.median(places, axis=0)
        away = origin - camera.centre_world
        forward = away - (away @ up) * up
        length = float(np.linalg.norm(forward))
        if length < 1e-6 * np.linalg.norm(away):  # seen from right above: any heading will do
            forward, length = camera.R_camera_world[1] - (camera.R_camera_world[1] @ up) * up, 1.0
        forward = forward / length
        return ViewFrame(origin, np.stack([forward, np.cross(up, forward), up], axis=1))

    def elevation(self, camera: Camera) -> float:
        """Angle by which the camera looks down on the person [degrees]."""
        towards = self.R_world_view.T @ (camera.centre_world - self.origin)
        return float(np.degrees(np.arctan2(towards[2], -towards[0])))


def described(
    grey: np.ndarray, mask: np.ndarray, camera: Camera, frame: ViewFrame, side: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The edge direction histogram (bins,) of a person, the cut-out (200, 200) uint8 that it is of, and where it shows
    them, (200, 200) bool.

    grey (H, W) uint8, mask (H, W) bool of the person: of the camera. side [m]: of the square, at the person's depth.
    """
    square, where = cut_out(grey, mask, camera, frame, side)
    return edge_histogram(square, where), square, where


def square_transform(camera: Camera, frame: ViewFrame, side: float) -> np.ndarray:
    """Transform (2, 3) from pixels of the camera's picture to those of the square around a person: scaled, then
    moved."""
    u, v = camera.project(frame.origin)
    depth = float(camera.R_camera_world[2] @ frame.origin + camera.t_camera_world[2])
    scale = SIDE / (side * camera.K[0, 0] / depth)
    middle = 0.5 * (SIDE - 1)
    return np.array([[scale, 0.0, middle - scale * u], [0.0, scale, middle - scale * v]])


@one_thread()
def cut_out(
    grey: np.ndarray, mask: np.ndarray, camera: Camera, frame: ViewFrame, side: float
) -> tuple[np.ndarray, np.ndarray]:
    """The grey square (200, 200) uint8 around a person, and where it shows them, (200, 200) bool."""
    to_square = square_transform(camera, frame, side)
    scale = to_square[0, 0]
    if scale < 1.0:  # pixels that fall together are averaged
        grey = cv2.GaussianBlur(grey, (0, 0), 0.5 / scale)
    square = cv2.warpAffine(grey, to_square, (SIDE, SIDE), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    shown = cv2.warpAffine(mask.astype(np.uint8), to_square, (SIDE, SIDE), flags=cv2.INTER_NEAREST)
    return np.asarray(square), shown > 0
