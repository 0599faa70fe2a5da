"""Whether several cameras' keypoints fit each other: wrong sizes, and wrong clocks, show in the epipolar geometry.

The distance of a pair of keypoints from being projections of one point is Sampson's, the first-order distance to the
nearest pair that is (Hartley and Zisserman, Multiple View Geometry, 2nd edition, 11.4.3), of undistorted points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.epipolar import essential_matrix, sampson

SIMPLE_FACTORS = (0.25, 1 / 3, 0.375, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 8 / 3, 3.0, 4.0)
_MOST_FRAMES = 300
_FEWEST = 50  # fewest pairs of points for a median
SUSPICIOUS, _TOO_FAR = 0.01, 0.02  # of the picture's longer side: median distances; good keypoints stay below both
_ALL_ORDERS = 4  # cameras of which every order is tried
_BETTER = 0.4  # share of the distance below which another size is believed


@dataclass(frozen=True)
class Agreement:
    """Agreement of keypoints of several cameras.

    distance: median Sampson distance of the pairs of cameras, averaged [px]. far: whether it is far too large.
    factor: on the keypoints of doubtful size, with which all would fit much better; None without.
    """

    distance: float
    far: bool
    factor: float | None = None


def agreement(cameras: Sequence[Camera], pixels: np.ndarray, doubtful: Sequence[bool]) -> Agreement | None:
    """Agreement of the keypoints pixels (T, C, L, 2), NaN where missing; None where few are seen twice.

    doubtful (C): the cameras whose keypoints may be of pictures of another size, the same share of all of them.
    """
    picked = np.unique(np.linspace(0, len(pixels) - 1, min(len(pixels), _MOST_FRAMES)).astype(int))
    some, pairs = pixels[picked], pairs_of(cameras)
    distance = _overall(pairs, [camera.directions(some[:, c]) for c, camera in enumerate(cameras)])
    if not np.isfinite(distance):
        return None
    share = distance / max(max(camera.image_size) for camera in cameras)
    factor = _factor(cameras, some, doubtful, distance) if share > SUSPICIOUS else None
    return Agreement(distance, share > _TOO_FAR, factor)


def likely_order(cameras: Sequence[Camera], pixels: np.ndarray) -> tuple[int, ...] | None:
    """Order of the cameras whose keypoints, pixels (T, C, L, 2), fit each camera much better than its own, which
    reveals exchanged files or names. None where no order does; with more than four cameras at most two are
    exchanged."""
    count = len(cameras)
    picked = np.unique(np.linspace(0, len(pixels) - 1, min(len(pixels), _MOST_FRAMES)).astype(int))
    some, pairs, own = pixels[picked], pairs_of(cameras), tuple(range(count))
    swaps = [_swapped(own, *c) for c in combinations(own, 2)]
    orders = list(permutations(own)) if count <= _ALL_ORDERS else [own, *swaps]
    distances = [_overall(pairs, [c.directions(some[:, k]) for c, k in zip(cameras, o, strict=True)]) for o in orders]
    best = int(np.nanargmin(distances)) if np.isfinite(distances).any() else 0
    share = distances[best] / max(max(camera.image_size) for camera in cameras)
    return orders[best] if best and distances[best] < _BETTER * distances[0] and share < SUSPICIOUS else None


def _swapped(order: tuple[int, ...], a: int, b: int) -> tuple[int, ...]:
    return tuple(b if k == a else a if k == b else k for k in order)


class Pair:
    """Two cameras a and b and their essential matrix: y' E x = 0 for rays x of a and y of b to one point."""

    def __init__(self, a: int, b: int, first: Camera, second: Camera) -> None:
        self.a, self.b = a, b
        self.usable = float(np.linalg.norm(second.centre_world - first.centre_world)) > 1e-6
        self.E = essential_matrix(first, second)
        self.focal = float(np.sqrt(first.K[0, 0] * second.K[0, 0]))

    def distance(self, first: np.ndarray, second: np.ndarray) -> float:
        """Median distance [px] of directions (..., 3); NaN of too few."""
        both = np.isfinite(first).all(axis=-1) & np.isfinite(second).all(axis=-1)
        if not self.usable or np.count_nonzero(both) < _FEWEST:
            return float("nan")
        return self.focal * float(np.median(sampson(self.E, first[both], second[both])))


def pairs_of(cameras: Sequence[Camera]) -> list[Pair]:
    """Every pair of cameras, the earlier one first."""
    return [Pair(a, b, cameras[a], cameras[b]) for a, b in combinations(range(len(cameras)), 2)]


def _overall(pairs: Sequence[Pair], seen: Sequence[np.ndarray]) -> float:
    """Mean over the pairs that have enough points; NaN where none has."""
    distances = np.array([pair.distance(seen[pair.a], seen[pair.b]) for pair in pairs])
    return float(distances[np.isfinite(distances)].mean()) if np.isfinite(distances).any() else float("nan")


def _factor(cameras: Sequence[Camera], pixels: np.ndarray, doubtful: Sequence[bool], distance: float) -> float | None:
    """Factor on the keypoints, errors counted at the size they were found in, where it makes them fit much better."""
    pairs = pairs_of(cameras)

    def scaled(factor: float) -> float:
        seen = [
            camera.directions((pixels[:, c] + 0.5) * (factor if doubtful[c] else 1.0) - 0.5)
            for c, camera in enumerate(cameras)
        ]
        return _overall(pairs, seen) / factor

    factors = np.unique(np.concatenate([np.geomspace(0.2, 5.0, 81), SIMPLE_FACTORS]))
    distances = np.array([scaled(factor) for factor in factors])
    best = int(np.nanargmin(distances))
    if abs(np.log(factors[best])) < 0.1 or distances[best] > _BETTER * distance:
        return None
    simple = min(SIMPLE_FACTORS, key=lambda f: abs(np.log(f / factors[best])))
    return simple if abs(np.log(simple / factors[best])) < 0.05 else float(factors[best])
