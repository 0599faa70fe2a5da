"""What the rays of a depth picture contradict: the body where the camera sees past it, and the person's surface where
the body leaves it uncovered.

Closest pairs let a limb before the trunk borrow the trunk's points, or one in the air those of the nearest other limb;
a ray cannot: it goes through empty space until it meets something (free space: Ganapathi, Plagemann, Koller and Thrun,
*Real-time human pose tracking from range data*, ECCV 2012, section 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.vision.prediction import Prediction
from estimator.vision.stereo import DepthMap, DepthPoints
from humanoid.support.compiled import jit

NOTHING = -1


class Contradicted(NamedTuple):
    """Places of a body that a camera sees past.

    place (C,): which. point (C,): the point of the person's surface that their rays meet behind them, `NOTHING` where
    that is another thing. weight (C,): of each, so that all places in one square of the picture, contradicted or not,
    count 1.
    """

    place: np.ndarray
    point: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class DepthRays:
    """The depth of one camera at one instant, on a grid of its pixels.

    camera: of the depth picture. step [px]: of the grid. first (2,): row and column of the grid's first pixel. depth
    (R, C) [m]: along the optical axis, NaN where unknown, as beside jumps, where the nearer thing is seen too wide.
    noise: as in `DepthMap`. surface (M): the points of the person's surface that are not beside jumps. point (R, C):
    which of these a pixel shows, `NOTHING` where it shows something else.
    """

    camera: Camera
    step: int
    first: np.ndarray
    depth: np.ndarray
    noise: float
    surface: DepthPoints
    point: np.ndarray

    @staticmethod
    def of(
        depth: DepthMap,
        rows: np.ndarray,
        columns: np.ndarray,
        step: int,
        jumps: np.ndarray,
        person: DepthPoints,
        mine: np.ndarray,
    ) -> DepthRays:
        """The depth at every `step`-th pixel, at rows and columns (P,), of which those of `jumps` (P,) bool lie beside
        a jump, and those numbered `mine` (M,) show the points (M) of the person."""
        first = np.array([rows.min(), columns.min()])
        row, column = (rows - first[0]) // step, (columns - first[1]) // step
        surface, sure = person.some(~jumps[mine]), mine[~jumps[mine]]
        values = np.full((row.max() + 1, column.max() + 1), np.nan, np.float32)
        values[row, column] = np.where(jumps, np.nan, depth.depth[rows, columns])
        point = np.full(values.shape, NOTHING, np.int64)
        point[row[sure], column[sure]] = np.arange(len(sure))
        return DepthRays(depth.camera, step, first, values, depth.noise, surface, point)

    def seen_past(self, places: np.ndarray, noise: float, margin: float, patch: float) -> Contradicted:
        """Which of some places (N, 3) [m] in the world, of a surface that differs from the person's by `noise` [m], lie
        before what their rays meet, by more than `margin` standard deviations. patch [px]: side of the squares."""
        cell, inside = self._cells(places)
        row, column = cell.T
        depth = np.where(inside, self.depth[row, column], np.nan)
        distance = places @ self.camera.R_camera_world[2] + self.camera.t_camera_world[2]
        known = np.flatnonzero(np.isfinite(depth))
        std = np.hypot(noise, self.noise * np.square(depth[known]))
        past = known[depth[known] - distance[known] > margin * std]
        weight = np.zeros(len(places))
        weight[known] = one_a_square(cell[known] // self._across(patch))
        return Contradicted(past, self.point[row[past], column[past]], weight[past])

    def _cells(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Row and column (N, 2) of the pixel that shows each place, clipped to the grid, and which lie inside it."""
        pixels = np.nan_to_num(self.camera.project(places), nan=-1e6, posinf=-1e6, neginf=-1e6)
        cell = np.round((pixels[:, ::-1] - self.first) / self.step)
        inside = ((cell >= 0) & (cell < self.depth.shape)).all(axis=1)
        return cell.clip(0, np.array(self.depth.shape) - 1).astype(np.int64), inside

    def _across(self, patch: float) -> int:
        """How many pixels of the grid a square of this side [px] is across."""
        return max(1, round(patch / self.step))

    def share(self, patch: float) -> float:
        """Of one point of the surface in a square of this side [px]."""
        return (self.step / patch) ** 2

    def squares_energy(
        self, body: Prediction, noise: float, patch: float, common: float, margin: float, most: float
    ) -> float:
        """How badly the depth of a body in the directions of the pixels is that of the picture, in nats.

        A square is one measurement, of the mean of what its pixels are off by where both are the person: normal, with
        `common` of the deviation of a pixel and that of the surface, `noise` [m], and at most `most`. So much cost
        squares of the person without the body, and of the body before what is seen by more than `margin` deviations,
        each by the share of its pixels. patch [px]: side of the squares.
        """
        side = self._across(patch)
        corner = (self.first[::-1] - body.frame[:2]) / body.frame[2] + 0.5
        each = self.step / body.frame[2]
        return float(_squares_energy(
            self.depth, self.point, body.buffer, corner, each, side, self.noise, noise, common, margin, most
        ))  # fmt: skip


def one_a_square(square: np.ndarray) -> np.ndarray:
    """Weights (N,) of what lies in squares at row and column (N, 2), those in one square together 1."""
    _, own, count = np.unique(square, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(1.0 / count[own.reshape(-1)])


def depth_behind(camera: Camera, places: np.ndarray, prediction: Prediction) -> np.ndarray:
    """How much farther from a camera the body is than places (N, 3) in the same directions [m], negative where it is
    nearer, infinite where there is no body."""
    cells, inside = prediction.cells(camera.project(places))
    nearness = np.zeros(len(places))
    nearness[inside] = prediction.buffer[cells[inside, 1], cells[inside, 0]]
    depth = places @ camera.R_camera_world[2] + camera.t_camera_world[2]
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / nearness - depth)


@jit
def _squares_energy(depth, point, buffer, corner, each, side, pixel_noise, noise, common, margin, most):  # type: ignore[no-untyped-def]
    """See `DepthRays.squares_energy`, of a picture of depth (R, C) and point (R, C), and the buffer (rows, columns) of
    a body, whose cell for a pixel (r, c) has column and row corner (2,) + each * (c, r). side: of squares, in pixels of
    the grid."""
    rows, columns, outlier, total = depth.shape[0], depth.shape[1], np.exp(-most), 0.0
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            both, wrong, off, far = 0, 0, 0.0, 0.0
            for r in range(top, min(top + side, rows)):
                for c in range(left, min(left + side, columns)):
                    z = depth[r, c]
                    if np.isnan(z):
                        continue
                    u, v, near = corner[0] + each * c, corner[1] + each * r, 0.0
                    if 0.0 <= u < buffer.shape[1] and 0.0 <= v < buffer.shape[0]:
                        near = buffer[int(v), int(u)]
                    if point[r, c] != NOTHING:
                        if near > 0.0:
                            both += 1
                            off += z - 1.0 / near
                            far += z
                        else:
                            wrong += 1
                    elif near > 0.0 and z - 1.0 / near > margin * np.hypot(noise, pixel_noise * z * z):
                        wrong += 1
            if both > 0:
                std = np.hypot(noise, common * pixel_noise * (far / both) ** 2)
                total -= both * np.log((1.0 - outlier) * np.exp(-0.5 * (off / both / std) ** 2) + outlier)
            total += wrong * most
    return total / side**2
