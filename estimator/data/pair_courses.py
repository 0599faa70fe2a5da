"""Misfit at each lag between two cameras: rays of moving points that do not meet, and speeds that differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.agreement import Pair, pairs_of
from estimator.data.cameras.camera import Camera
from estimator.data.moving_rays import MovingRays, speed_disagreement

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
