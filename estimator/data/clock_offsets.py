"""Cameras that did not start together: the clocks at which their keypoints fit each other best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.agreement import SUSPICIOUS, Pair, pairs_of
from estimator.data.cameras.camera import Camera
from estimator.data.lags import Lags

_LONGEST = 1.0  # offsets looked for [s]
_STEP = 1.0 / 60.0  # finer instants are thinned out to this [s]
_MOST = 1200  # instants used
_STILL = 0.7  # share of the points, the slower ones, that are left out
_FEWEST_LAGS, _SHORTEST = 2, 0.06  # instants, and seconds, that an offset has: less may be a fault of the calibration
_BETTER = 0.85  # what is left of the distance where other clocks are believed


def likely_offsets(cameras: Sequence[Camera], pixels: np.ndarray, times: np.ndarray) -> tuple[float, ...]:
    """Delays (C,) [s] of cameras that started later than most, where these make their keypoints fit much better; else
    none.

    pixels (T, C, L, 2) [px], NaN where missing, assumed at the same times (T,) [s]. The offsets are whole steps between
    instants. Points that hardly move determine no offsets, and then there are none.
    """
    if len(times) < 3:
        return ()
    middle = slice(max(0, (len(times) - _MOST) // 2), (len(times) + _MOST) // 2)
    step = float((times[-1] - times[0]) / (len(times) - 1))
    thinned = max(1, int(_STEP / step + 1e-6))
    step, part = step * thinned, pixels[middle][::thinned]
    most = min(int(_LONGEST / step), len(part) // 4)
    seen = [camera.directions(part[:, c]) for c, camera in enumerate(cameras)]
    distances = _distances(pairs_of(cameras), seen, most)
    if distances is None:
        return ()
    lags = distances.best(len(cameras))
    lags -= max(lags.tolist(), key=lags.tolist().count)  # of several that are as many, the first camera's
    small = np.abs(lags).max() < max(_FEWEST_LAGS, _SHORTEST / step)
    left = distances.of(lags)
    fitting = left <= SUSPICIOUS * max(max(camera.image_size) for camera in cameras)  # not so with another person
    if small or not fitting or left > _BETTER * distances.of(np.zeros_like(lags)):
        return ()
    return tuple(-step * lag if lag else 0.0 for lag in lags.tolist())


def _distances(pairs: Sequence[Pair], seen: Sequence[np.ndarray], most: int) -> Lags | None:
    """Of the pairs that see enough in common at every lag; None without any."""
    moving = [_moving(pixels) for pixels in seen]
    tables = [(pair, _lagged(pair, moving[pair.a], seen[pair.b], most)) for pair in pairs]
    usable = [(pair.a, pair.b, table) for pair, table in tables if np.isfinite(table).all()]
    if not usable:
        return None
    a, b, table = (np.array(column) for column in zip(*usable, strict=True))
    return Lags(a, b, table, most)


def _moving(seen: np.ndarray) -> np.ndarray:
    """Directions (T, L, 3) without the slower ones: what does not move contains no information on a clock."""
    speed = np.full(seen.shape[:2], np.nan)
    speed[2:-2] = np.linalg.norm(seen[4:] - seen[:-4], axis=-1)
    if not np.isfinite(speed).any():
        return np.full_like(seen, np.nan)
    return np.where((speed >= np.nanquantile(speed, _STILL))[..., None], seen, np.nan)


def _lagged(pair: Pair, first: np.ndarray, second: np.ndarray, most: int) -> list[float]:
    """Distances of a pair with the second camera's rays taken -most to most instants later."""

    def lagged(lag: int) -> float:
        i = np.arange(max(0, -lag), len(first) - max(0, lag))
        return pair.distance(first[i], second[i + lag])

    return [lagged(lag) for lag in range(-most, most + 1)]
