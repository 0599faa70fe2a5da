"""The cells of space that every view's foreground allows a person in (a visual hull)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from estimator.data.cameras.projection import project_point
from estimator.trackers.loose_limbed.limbs.features import PERSON, UNKNOWN
from estimator.trackers.loose_limbed.limbs.likelihood import LimbView
from humanoid.support.compiled import jit

ALL, MOST = 2, 1
"""Kinds of cells of the hull: foreground in all views that show it, or in all but those that may overlook it."""

_COARSEST = 0.4  # m
_MOST_CELLS = 30_000  # are halved: one camera alone sees a person anywhere along metres of its rays


@dataclass(frozen=True, eq=False)
class VisualHull:
    """Cells of a regular grid.

    low (3,) [m]: corner of the first cell. spacing [m]: a cell's side. state (X, Y, Z) uint8: 0 outside, `MOST`, `ALL`.
    cells (N, 3) int: those that are not outside.
    """

    low: np.ndarray
    spacing: float
    state: np.ndarray
    cells: np.ndarray

    def middles(self, cells: np.ndarray) -> np.ndarray:
        """Middles (N, 3) [m] of cells (N, 3)."""
        return self.low + self.spacing * (cells + 0.5)

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Whether points (N, 3) [m] are in it, (N,) bool."""
        cell = np.floor((points - self.low) / self.spacing).astype(int)
        within = ((cell >= 0) & (cell < self.state.shape)).all(axis=1)
        x, y, z = np.where(within[:, None], cell, 0).T
        return np.asarray(within & (self.state[x, y, z] > 0))


def visual_hull(views: Sequence[LimbView], box: np.ndarray, spacing: float, overlooked: int = 0) -> VisualHull:
    """The hull inside box (2, 3) [m]; all of the box where no view has a foreground map.

    A cell belongs to it if no view that shows its centre has only background within half a cell of it, and if at least
    two views show it where so many have a map: what only one shows is seldom the person, but large. `overlooked` views
    may have only background, because of an object before them, if two others show the person. Views without a map, and
    their unknown places, are ignored. Where there are many cells, as with one camera, they are larger than `spacing`
    [m].
    """
    maps = [(v.camera.arrays, v.foreground, _away(v.foreground)) for v in views if v.foreground.size]
    side = spacing * 2.0 ** math.ceil(math.log2(max(_COARSEST / spacing, 1.0)))
    shape = np.maximum(np.ceil((box[1] - box[0]) / side), 1).astype(int)
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    while True:
        finest = side < 1.5 * spacing or len(cells) > _MOST_CELLS
        reach = 0.5 * side if finest else 0.5 * math.sqrt(3.0) * side
        border = 0.0 if finest else reach  # parts of a cell may be shown though its middle is not
        shown, hits, misses = np.zeros((3, len(cells)), np.int64)
        for camera, foreground, away in maps:
            _count(box[0] + side * (cells + 0.5), reach, border, camera, foreground, away, shown, hits, misses)
        kept = (shown >= min(2, len(maps))) & (misses <= np.where(hits > 1, overlooked, 0)) & ((hits > 0) | (not maps))
        cells, whole = cells[kept], misses[kept] == 0
        if finest or not len(cells):
            break
        cells = (2 * cells[:, None] + np.indices((2, 2, 2)).reshape(3, 8).T).reshape(-1, 3)
        side, shape = 0.5 * side, 2 * shape
    state = np.zeros(shape, np.uint8)
    state[tuple(cells.T)] = np.where(whole, ALL, MOST)
    return VisualHull(box[0], side, state, cells)


def _away(foreground: np.ndarray) -> np.ndarray:
    """Distance of the nearest pixel of the person (H, W) [px]; infinite without any."""
    if not (foreground == PERSON).any():
        return np.full(foreground.shape, np.inf, np.float32)
    return cv2.distanceTransform((foreground != PERSON).astype(np.uint8), cv2.DIST_L2, 3)


@jit
def _count(points, reach, border, camera, foreground, away, shown, hits, misses):  # type: ignore[no-untyped-def]
    """Count in shown, hits and misses (N,) whether one view shows points (N, 3) [m], and the person within `reach` [m]
    of them; those that it shows no more, but what is within `border` [m], are not missed.

    foreground (H, W); away (H, W): see `_away`; camera: see `estimator.data.cameras.projection`."""
    intrinsics, lens, R, t = camera
    height, width = foreground.shape
    for n in range(points.shape[0]):
        u, v, ahead = project_point(points[n], intrinsics, lens, R, t)
        if not ahead:
            continue
        depth = R[2, 0] * points[n, 0] + R[2, 1] * points[n, 1] + R[2, 2] * points[n, 2] + t[2]
        x, y = min(max(u, 0.0), width - 1.0), min(max(v, 0.0), height - 1.0)
        beyond = max(abs(x - u), abs(y - v))
        if beyond > 0.5 + border * intrinsics[0] / depth:
            continue
        shown[n] += 1
        i, j = math.floor(y + 0.5), math.floor(x + 0.5)
        if foreground[i, j] == UNKNOWN:
            continue
        if away[i, j] * depth <= reach * intrinsics[0]:
            hits[n] += 1
        elif beyond <= 0.5:
            misses[n] += 1
