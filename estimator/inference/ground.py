"""The floor under a person's feet: a plane through the places where points of the feet stand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.numerics.vectors import axes_across

_SCATTER = 0.02  # m: of points on one floor; those farther off stand on a box, or do not stand
_NU = 2.0
_OFFSET = 0.02  # m: of a kind of point above the sole, from kind to kind
_TILT = 0.02  # rad: of the floor, and of the assumed up
_EFFECTIVE = 20.0  # places at most that count, as a point that stands is seen in many frames
_FEWEST = 5
_ROUNDS = 30
_LOWEST = 20.0  # percentile to begin with
STEP = 0.06  # m: what stands so much higher or lower stands on something else
_UNDER = 0.1  # largest share of standing points under a floor: feet stand on it, and their places scatter


@dataclass(frozen=True)
class Ground:
    """The plane normal . x = height in the world.

    normal (3,): unit vector, upwards. height, std [m]: along it, and its standard deviation. above (K,) [m]: height of
    each kind of point when it stands.
    """

    normal: np.ndarray
    height: float
    std: float
    above: np.ndarray

    def heights(self, points: np.ndarray, kind: np.ndarray) -> np.ndarray:
        """Heights (..., P) [m] of points (..., P, 3) of kinds (P,) above their places when standing."""
        return np.asarray(points @ self.normal - self.height - self.above[kind])

    def under(self, points: np.ndarray, standing: np.ndarray, kind: np.ndarray) -> Ground:
        """The same, or lower: under nine tenths of the points (T, P, 3) that stand on it with probabilities (T, P)."""
        heights = self.heights(points, kind)[(standing > 0.5) & np.isfinite(points).all(axis=2)]
        heights = heights[np.abs(heights) < STEP]
        return (
            replace(self, height=self.height + min(0.0, float(np.quantile(heights, _UNDER)))) if len(heights) else self
        )


def fitted_ground(
    points: np.ndarray,
    standing: np.ndarray,
    kind: np.ndarray,
    up: np.ndarray,
    *,
    above: np.ndarray | None = None,
    tilt: float = _TILT,
) -> Ground | None:
    """The floor of points (T, P, 3) [m], NaN where missing, that stand with probabilities (T, P); None where fewer than
    five places stand.

    kind (P,): 0, 1, ... for points that are equally far above the sole, such as both heels. up (3,): unit vector; above
    (K,) [m]: expected height of each kind above the sole, 0 by default; tilt [rad]: standard deviation of the floor
    from level. Iterated least squares with Student's tails.
    """
    known = np.isfinite(points).all(axis=2) & (standing > 0.5)
    if known.sum() < _FEWEST:
        return None
    places, weight, kinds = points[known], standing[known], np.tile(kind, (len(points), 1))[known]
    axes = axes_across(up)
    middle = np.average(places, axis=0, weights=weight)
    offsets = np.eye(int(kind.max()) + 1)[kinds]
    rows = np.column_stack([np.ones(len(places)), (places - middle) @ axes, offsets])
    expected = np.zeros(offsets.shape[1]) if above is None else above
    height = (places - middle) @ up - offsets @ expected
    prior = np.diag([0.0, *2 * [tilt**-2.0], *offsets.shape[1] * [_OFFSET**-2.0]])
    share = min(1.0, _EFFECTIVE / len(places)) / _SCATTER**2
    x = np.zeros(rows.shape[1])
    x[0] = np.percentile(height, _LOWEST)
    for _ in range(_ROUNDS):
        residual = (height - rows @ x) / _SCATTER
        trusted = share * weight / (1.0 + np.square(residual) / _NU) ** 1.5
        information = rows.T @ (trusted[:, None] * rows) + prior
        x = np.linalg.solve(information, rows.T @ (trusted * height))
    normal = up - axes @ x[1:3]
    normal /= np.linalg.norm(normal)
    std = float(np.sqrt(np.linalg.inv(information)[0, 0]))
    return Ground(normal, float(normal @ (middle + x[0] * up)), std, expected + x[3:])
