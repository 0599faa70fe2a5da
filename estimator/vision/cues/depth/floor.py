"""The floor that a person stands on, so that it is not taken for a part of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

TILT = 20.0  # degrees that the floor may differ from level: a camera may not know exactly which way is up
_TRIES = 1000
_LOWEST = 0.25  # share of all points
_NEAR = 0.04  # m of the floor, beside the noise of a point
_BELOW = 0.15  # m
_NARROW = 0.1  # m, standard deviation across a strip that is no floor
_MOST_BELOW, _LEAST_ON = 0.05, 0.03  # shares of all points that may lie so far below a floor, and have to lie on it


class Floor(NamedTuple):
    """Places x of a plane: normal . x = offset [m]; normal (3,): unit, upwards."""

    normal: np.ndarray
    offset: float

    def height(self, places: np.ndarray) -> np.ndarray:
        """Of places (N, 3) above it [m]."""
        return np.asarray(places @ self.normal - self.offset)


def found_floor(places: np.ndarray, std: np.ndarray, up: np.ndarray, rng: np.random.Generator) -> Floor | None:
    """The nearly level plane with most of the places (N, 3) on it and hardly any below it, None where there is none; of
    two the more level one, unless it has much fewer.

    std (N,): of the places [m]. up (3,): about.
    """
    best, most = None, _LEAST_ON * len(places)
    if len(places) < 3:
        return None
    level = places @ up
    low = np.flatnonzero(level <= np.quantile(level, _LOWEST))  # where it is, whatever else there may be more of
    for chosen in rng.integers(0, len(low), (_TRIES, 3)):
        floor = _through(places[low[chosen]], up)
        if floor is None:
            continue
        height = floor.height(places)
        tilt = np.degrees(np.arccos(min(1.0, float(floor.normal @ up))))
        on = float(np.count_nonzero(np.abs(height) < _NEAR + std)) * (1.0 - tilt / TILT)
        if on > most and np.count_nonzero(height < -_BELOW - 2.0 * std) <= _MOST_BELOW * len(places):
            best, most = floor, on
    return best if best is None else _refined(best, places, std, up)


def _through(three: np.ndarray, up: np.ndarray) -> Floor | None:
    """The plane through three places (3, 3), unless it is steep."""
    normal = np.cross(three[1] - three[0], three[2] - three[0])
    length = np.linalg.norm(normal)
    if length < 1e-9:
        return None
    normal = normal / length * (1.0 if normal @ up > 0.0 else -1.0)
    if normal @ up < np.cos(np.radians(TILT)):
        return None
    return Floor(normal, float(normal @ three.mean(axis=0)))


def _refined(floor: Floor, places: np.ndarray, std: np.ndarray, up: np.ndarray) -> Floor | None:
    """Least squares over the places on it; None where these are a strip, as the lower end of a wall."""
    near = np.abs(floor.height(places)) < _NEAR + std
    on, weight = places[near], 1.0 / np.square(_NEAR + std[near])
    centre = np.average(on, axis=0, weights=weight)
    _, lengths, axes = np.linalg.svd(np.sqrt(weight)[:, None] * (on - centre), full_matrices=False)
    if lengths[1] < _NARROW * np.sqrt(weight.sum()):
        return None
    normal = axes[2] * (1.0 if axes[2] @ up > 0.0 else -1.0)
    return Floor(normal, float(normal @ centre)) if normal @ up >= np.cos(np.radians(TILT)) else floor
