"""Keypoints over time as rays and their speeds, and the misfit of two cameras at each lag: rays that do not meet,
speeds that differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.agreement import Pair, pairs_of
from estimator.data.cameras.camera import Camera

_SMOOTHED = 0.02  # standard deviation of the window that rays are averaged over [s]
_APART = 0.03  # time over which a speed is measured, to each side [s]
_SLOW = 0.02  # of the distance, per second: slower points do not move
_BRIDGE = 0.1  # frames further apart are not interpolated [s]


@dataclass(frozen=True)
class MovingRays:
    """Motion seen by one camera: rays (T, L, 3), z = 1, and the speed (T, L) of each [1/s]; NaN where missing."""

    rays: np.ndarray
    speed: np.ndarray

    @property
    def log_speed(self) -> np.ndarray:
        """(T, L): logarithms of the speeds, of what hardly moves alike."""
        return np.asarray(np.log(self.speed + _SLOW))

    @staticmethod
    def of(camera: Camera, pixels: np.ndarray, times: np.ndarray, grid: np.ndarray) -> MovingRays:
        """Rays of pixels (N, L, 2), NaN where missing, at times (N,) [s], to the instants of a grid (T,) [s] of even
        steps. Averaged over 0.02 s: jitter would otherwise count as motion, and be larger between two frames."""
        step = float(grid[1] - grid[0])
        rays = at_times(averaged(camera.directions(pixels), times), times, grid)
        reach = max(1, round(_APART / step))
        speed = np.full(rays.shape[:2], np.nan)
        if len(grid) > 2 * reach:
            speed[reach:-reach] = np.linalg.norm(rays[2 * reach :] - rays[: -2 * reach], axis=-1) / (2 * reach * step)
        return MovingRays(rays, speed)


def speed_disagreement(first: np.ndarray, second: np.ndarray, seen: np.ndarray) -> float:
    """Half the logarithm of the share of variance that the one's `log_speed` (T, L) leaves of the other's, where both
    are seen (T, L); 0 where they disagree."""
    count = np.maximum(seen.sum(axis=0), 1)
    a, b = (np.where(seen, x, 0.0) for x in (first, second))
    a, b = (np.where(seen, x - x.sum(axis=0) / count, 0.0) for x in (a, b))
    size = float(np.sqrt(np.square(a).sum() * np.square(b).sum()))
    alike = float((a * b).sum()) / size if size > 0.0 else 0.0
    return 0.5 * float(np.log(1.0 - np.clip(alike, 0.0, 0.99) ** 2))


def averaged(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Values (N, ...) at times (N,) [s] averaged with their neighbours in time, those that are missing left out."""
    sigma = _SMOOTHED / (float(np.median(np.diff(times))) if len(times) > 1 else 1.0)  # frames
    reach = min(int(np.ceil(2.5 * sigma)), len(values) - 1)
    total, weight = np.zeros_like(values), np.zeros_like(values)
    for k in range(-reach, reach + 1):
        to, of = slice(max(0, k), len(values) + min(0, k)), slice(max(0, -k), len(values) - max(0, k))
        share = np.where(np.isfinite(values[of]), np.exp(-0.5 * (k / sigma) ** 2), 0.0)
        total[to] += share * np.nan_to_num(values[of])
        weight[to] += share
    return np.where(np.isfinite(values), total / np.maximum(weight, 1e-12), np.nan)


def at_times(values: np.ndarray, times: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Values (N, ...) at times (N,) [s] on straight lines between them, at the instants of a grid (T,); NaN outside,
    where a neighbour is missing, and between frames that are far apart."""
    if len(times) < 2:
        return np.full((len(grid), *values.shape[1:]), np.nan)
    after = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    gap = times[after] - times[after - 1]
    share = (grid - times[after - 1]) / gap
    known = (share > -1e-6) & (share < 1.0 + 1e-6) & (gap <= _BRIDGE + 1e-6)
    share = np.where(known, share, np.nan).reshape(-1, *[1] * (values.ndim - 1))
    # a frame counts alone at its own instant, though its neighbour may be missing
    before = np.where(share > 1.0 - 1e-6, 0.0, (1.0 - share) * values[after - 1])
    return np.asarray(before + np.where(share < 1e-6, 0.0, share * values[after]))


_FLOOR = 0.003  # of the picture's longer side: keypoints are not better than this


def pair_courses(
    cameras: Sequence[Camera], pixels: Sequence[np.ndarray], times: Sequence[np.ndarray], step: float
) -> list[PairCourse]:
    """All pairs of cameras that stand apart, on one grid of instants."""
    start, end = min(float(of[0]) for of in times if len(of)), max(float(of[-1]) for of in times if len(of))
    grid = np.arange(start, end + 1.5 * step, step)
    views = [MovingRays.of(*of, grid) for of in zip(cameras, pixels, times, strict=True)]
    floor = _FLOOR * max(max(camera.image_size) for camera in cameras)
    return [PairCourse(p, views[p.a], views[p.b], step, floor) for p in pairs_of(cameras) if p.usable]


class PairCourse:
    """Misfit at each lag of a pair, in instants by which the second camera's rays are delayed."""

    def __init__(self, pair: Pair, first: MovingRays, second: MovingRays, step: float, floor: float) -> None:
        self.pair, self.step, self.count, self._floor = pair, step, len(first.rays), floor
        self._line, back, self._ray = first.rays @ pair.E.T, second.rays @ pair.E, second.rays
        self._slopes = tuple(np.square(line[..., :2]).sum(axis=-1) for line in (self._line, back))
        self._speeds = first.speed, second.speed
        self._logs = first.log_speed, second.log_speed

    def instants(self, lag: int, stride: int) -> np.ndarray:
        """The first camera's instants that have a partner."""
        return np.arange(max(0, -lag), self.count - max(0, lag), stride)

    def rays(self, lag: int, i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Misfit of rays at instants i (I,): the logarithms of the squared distances times their weights, and the
        weights (I, L)."""
        j = i + lag
        weight = np.sqrt(self._speeds[0][i] * self._speeds[1][j])
        across = self.pair.focal * (self._ray[j] * self._line[i]).sum(axis=-1)
        squared = np.square(across) / np.maximum(self._slopes[0][i] + self._slopes[1][j], 1e-20)
        seen = np.isfinite(weight) & np.isfinite(squared)
        weight = np.where(seen, weight, 0.0)
        return weight * np.log(np.where(seen, squared, 0.0) + self._floor**2), weight

    def speeds(self, lag: int, i: np.ndarray, seen: np.ndarray) -> float:
        """Half the logarithm of the share of variance that the one's speeds leave of the other's; 0 where they
        disagree."""
        first, second = self._logs
        return speed_disagreement(first[i], second[i + lag], seen)

    def speeds_by(self, lag: int, i: np.ndarray, seen: np.ndarray, piece: np.ndarray, count: int) -> np.ndarray:
        """As `speeds`, in each of `count` pieces of the time (count,), those that instants i (I,) belong to; speeds are
        beside the landmarks' means over all of them."""
        first, second = (_beside_mean(of, seen) for of in (self._logs[0][i], self._logs[1][i + lag]))
        both, *alone = (
            np.bincount(piece, values.sum(axis=1), count) for values in (first * second, first**2, second**2)
        )
        size = np.sqrt(alone[0] * alone[1])
        alike = np.where(size > 0.0, both / np.where(size > 0.0, size, 1.0), 0.0)
        return np.asarray(0.5 * np.log(1.0 - np.clip(alike, 0.0, 0.99) ** 2))


def _beside_mean(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Values (I, L) beside the mean of each landmark, 0 where they are not seen (I, L)."""
    known = np.where(seen, values, 0.0)
    return np.where(seen, known - known.sum(axis=0) / np.maximum(seen.sum(axis=0), 1), 0.0)
