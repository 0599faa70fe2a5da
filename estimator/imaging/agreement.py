"""Whether several cameras' keypoints fit each other: wrong sizes and clocks show in the epipolar geometry.

The distance of a pair of keypoints from being projections of one point is Sampson's, the first-order distance to the
nearest pair that is (Hartley and Zisserman, Multiple View Geometry, 2nd edition, 11.4.3), of undistorted points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from estimator.imaging.camera import Camera

SIMPLE_FACTORS = (0.25, 1 / 3, 0.375, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 8 / 3, 3.0, 4.0)
_MOST_FRAMES = 300
_FEWEST = 50  # pairs of points that a median is believed of
_TOO_FAR = 0.01  # of the picture's longer side: a median distance that good keypoints stay below
_SIZE_BETTER, _CLOCK_BETTER = 0.4, 0.75  # what is left of the distance where another size, or clock, is believed
_LONGEST = 1.0  # offsets looked for [s]
_FEWEST_LAGS = 2  # frames: cameras without a trigger are up to one apart


@dataclass(frozen=True)
class Agreement:
    """How well keypoints of several cameras fit each other.

    distance: median Sampson distance of the pairs of cameras, averaged [px]. far: whether good keypoints are nearer.
    factor: of the keypoints' pictures, that would make them fit much better; None without. offsets (C,): seconds that
    the cameras started later than most, where that would make them fit much better; empty without.
    """

    distance: float
    far: bool
    factor: float | None = None
    offsets: tuple[float, ...] = ()


def agreement(
    cameras: Sequence[Camera], pixels: np.ndarray, confidence: np.ndarray, times: np.ndarray
) -> Agreement | None:
    """How well the keypoints pixels (T, C, L, 2) at times (T,) fit each other; None where too few are seen twice.

    A wrong size moves them much further apart than a wrong clock does, so it is looked for first.
    """
    seen = np.where((confidence > 0.0)[..., None], pixels, np.nan)
    picked = np.unique(np.linspace(0, len(seen) - 1, min(len(seen), _MOST_FRAMES)).astype(int))
    pairs = [_Pair(a, b, cameras[a], cameras[b]) for a, b in combinations(range(len(cameras)), 2)]
    distance = _overall(pairs, [_rays(c, seen[picked, i]) for i, c in enumerate(cameras)])
    if not np.isfinite(distance):
        return None
    far = distance > _TOO_FAR * max(max(camera.image_size) for camera in cameras)
    factor = _factor(cameras, pairs, seen[picked], distance) if far else None
    offsets = () if factor is not None else _offsets(cameras, pairs, seen, times)
    return Agreement(distance, far, factor, offsets)


class _Pair:
    """Two cameras a and b and their essential matrix: y' E x = 0 for rays x of a and y of b to one point."""

    def __init__(self, a: int, b: int, first: Camera, second: Camera) -> None:
        self.a, self.b = a, b
        R_second_first = second.R_camera_world @ first.R_camera_world.T
        t = second.t_camera_world - R_second_first @ first.t_camera_world
        length = float(np.linalg.norm(t))
        self.usable = length > 1e-6
        x, y, z = t / length if self.usable else t
        self.E = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ R_second_first
        self.focal = float(np.sqrt(first.K[0, 0] * second.K[0, 0]))

    def distance(self, first: np.ndarray, second: np.ndarray) -> float:
        """Median distance [px] of rays (..., 2); NaN of too few."""
        both = np.isfinite(first).all(axis=-1) & np.isfinite(second).all(axis=-1)
        if not self.usable or np.count_nonzero(both) < _FEWEST:
            return float("nan")
        x, y = (np.concatenate([r[both], np.ones((np.count_nonzero(both), 1))], axis=1) for r in (first, second))
        line, back = x @ self.E.T, y @ self.E
        slope = np.sqrt((line[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1))
        return self.focal * float(np.median(np.abs((y * line).sum(axis=1)) / np.maximum(slope, 1e-12)))


def _rays(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Undistorted image points (..., 2) at depth 1."""
    flat = np.where(np.isfinite(pixels), pixels, 0.0).reshape(-1, 1, 2)
    found = cv2.undistortPoints(flat, camera.K, camera.distortion).reshape(pixels.shape)
    return np.where(np.isfinite(pixels), found, np.nan)


def _overall(pairs: Sequence[_Pair], rays: Sequence[np.ndarray]) -> float:
    """Mean over the pairs that have enough points; NaN where none has."""
    found = np.array([pair.distance(rays[pair.a], rays[pair.b]) for pair in pairs])
    return float(found[np.isfinite(found)].mean()) if np.isfinite(found).any() else float("nan")


def _factor(cameras: Sequence[Camera], pairs: Sequence[_Pair], pixels: np.ndarray, distance: float) -> float | None:
    """Factor on the keypoints, errors counted at the size they were found in, where it makes them fit much better."""

    def scaled(factor: float) -> float:
        rays = [_rays(camera, (pixels[:, c] + 0.5) * factor - 0.5) for c, camera in enumerate(cameras)]
        return _overall(pairs, rays) / max(factor, 1.0)

    factors = np.unique(np.concatenate([np.geomspace(0.2, 5.0, 81), SIMPLE_FACTORS]))
    found = np.array([scaled(factor) for factor in factors])
    best = int(np.nanargmin(found))
    if abs(np.log(factors[best])) < 0.1 or found[best] > _SIZE_BETTER * distance:
        return None
    simple = min(SIMPLE_FACTORS, key=lambda f: abs(np.log(f / factors[best])))
    return simple if abs(np.log(simple / factors[best])) < 0.05 else float(factors[best])


def _offsets(
    cameras: Sequence[Camera], pairs: Sequence[_Pair], pixels: np.ndarray, times: np.ndarray
) -> tuple[float, ...]:
    """Seconds (C,) that the cameras started later than most, where other clocks make them fit much better."""
    if len(times) < 3:
        return ()
    step = float((times[-1] - times[0]) / (len(times) - 1))
    most = min(int(_LONGEST / step), len(times) // 4)
    rays = [_rays(camera, pixels[:, c]) for c, camera in enumerate(cameras)]
    table = np.array([_lagged(pair, rays[pair.a], rays[pair.b], most) for pair in pairs])
    known = np.isfinite(table).all(axis=1)
    a, b = np.array([(pair.a, pair.b) for pair, good in zip(pairs, known, strict=True) if good] or [(0, 0)]).T
    if not known.any():
        return ()
    distances = _Lags(a, b, table[known], most)
    found = distances.best(len(cameras))
    found -= max(found.tolist(), key=found.tolist().count)  # of several, the first camera's
    if distances.of(found) > _CLOCK_BETTER * distances.of(np.zeros_like(found)) or np.abs(found).max() < _FEWEST_LAGS:
        return ()
    return tuple(-step * lag if lag else 0.0 for lag in found.tolist())


def _lagged(pair: _Pair, first: np.ndarray, second: np.ndarray, most: int) -> list[float]:
    """Distances of a pair with the second camera's rays taken -most to most instants later."""
    stride = max(1, len(first) // _MOST_FRAMES)

    def lagged(lag: int) -> float:
        i = np.arange(max(0, -lag), len(first) - max(0, lag), stride)
        return pair.distance(first[i], second[i + lag])

    return [lagged(lag) for lag in range(-most, most + 1)]


@dataclass(frozen=True)
class _Lags:
    """Distances of P pairs of cameras a, b (P,) by how many instants b is taken later than a: table (P, 2 most + 1)."""

    a: np.ndarray
    b: np.ndarray
    table: np.ndarray
    most: int

    def of(self, lags: np.ndarray) -> float:
        """Mean distance where each camera is taken so many instants later, lags (C,)."""
        apart = np.clip(lags[self.b] - lags[self.a], -self.most, self.most)
        return float(self.table[np.arange(len(self.a)), apart + self.most].mean())

    def best(self, count: int) -> np.ndarray:
        """Lags (C,) of the least distance: downhill, one camera after the other, from no lags and from the best lags
        that each camera alone has of the others."""
        starts = [np.zeros(count, dtype=np.int64)]
        for c in range(count):
            own = self.table.argmin(axis=1) - self.most
            lags = np.zeros(count, dtype=np.int64)
            lags[self.b[self.a == c]] = own[self.a == c]
            lags[self.a[self.b == c]] = -own[self.b == c]
            starts.append(lags)
        return min((self._downhill(lags) for lags in starts), key=self.of)

    def _downhill(self, lags: np.ndarray) -> np.ndarray:
        tried = np.arange(-self.most, self.most + 1)
        before = np.inf
        while self.of(lags) < before:
            before = self.of(lags)
            for c in range(len(lags)):
                options = np.repeat(lags[None], len(tried), axis=0)
                options[:, c] = tried
                lags = min((lags, *options), key=self.of)
        return lags
