"""Repulsion of body parts (CSS section 3.2.4)."""

from __future__ import annotations

import numpy as np

from estimator.energy.term import BatchTerm
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

_DEEPEST = 3.0  # exponent beyond which the potential goes on as a parabola: for power 1, from three scales inside


class Interpenetration(BatchTerm):
    """Potential of every near pair: f(d) = exp(-z |z|^(power - 1)) with z = d / scale, d the signed distance.

    So it is 1 at contact, falls e-fold per `scale` outside and grows as fast inside (for power 1). Two changes keep it
    smooth and finite: the tangent at the margin is taken away, so that value and slope vanish there, where pairs come
    and go; and beyond an exponent of 3 it continues as the parabola that fits there.

    The Hessian is f''(d) times the outer product of the distance's gradient, where f'' is positive; the exact one has
    f'' of either sign and the curvature of the distance itself, f'(d) d2d, unless a solid is a hull.

    Parameters
    ----------
    self_collision: chooses the pairs and, by its margin, where the potential begins.
    scale: distance [m] of an e-fold change.
    weight: energy of two parts in contact (less the tangent's share, a tenth at a margin of four scales).
    power: CSS's p, at least 1.

    Raises
    ------
    InputError: scale not positive, weight negative or power below 1 (its slope at contact would be infinite).
    """

    name = "interpenetration"

    def __init__(
        self, self_collision: SelfCollision, scale: float = 0.005, weight: float = 1.0, power: float = 1.0
    ) -> None:
        given = (("scale", scale, scale > 0.0), ("weight", weight, weight >= 0.0), ("power", power, power >= 1.0))
        for name, number, valid in given:
            if not (valid and np.isfinite(number)):
                remedy = "scale > 0 [m], weight >= 0, power >= 1"
                raise InputError("interpenetration", f"{name} is {number}", remedy=remedy)
        self.self_collision = self_collision
        at_margin, slope_there, _ = _potential(self_collision.margin, scale, power)
        self._settings = np.array([scale, weight, power, at_margin, slope_there, self_collision.margin])

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        contacts = self.self_collision.near(posed)
        if not contacts.distance.size:
            return 0.0
        if exact:
            slopes = _slopes(contacts.distance, self._settings)
            self.self_collision.add_curvature(posed, contacts, slopes, hessian)
        return float(_accumulate(contacts.distance, contacts.gradient, self._settings, gradient, hessian, exact))

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        first, distance = self.self_collision.distances(placed)
        values = np.empty(len(placed.q))
        _values(first, distance, self._settings, values)
        return values


@jit
def _potential(distance: float, scale: float, power: float) -> tuple[float, float, float]:
    """exp(-z |z|^(power - 1)), capped, with its first and second derivative by the distance."""
    z = distance / scale
    deepest = -(_DEEPEST ** (1.0 / power))
    at = max(z, deepest)
    size = abs(at)
    f = np.exp(-at * size ** (power - 1.0))
    slope = power * size ** (power - 1.0)
    # the curvature of the exponent is infinite at contact for powers between 1 and 2
    bend = power * (power - 1.0) * max(size, 0.1) ** (power - 2.0) if power > 1.0 else 0.0
    first, second = -f * slope, f * (slope * slope + (bend if at < 0.0 else -bend))
    beyond = z - at
    value = f + beyond * (first + 0.5 * beyond * second)
    return value, (first + beyond * second) / scale, second / (scale * scale)


@jit
def _slopes(distance: np.ndarray, settings: np.ndarray) -> np.ndarray:
    """Derivatives (M,) of the energy by the distance (M,) of each contact; settings (6,)."""
    scale, weight, power, _, slope, _ = settings
    slopes = np.empty(distance.size)
    for m in range(distance.size):
        slopes[m] = weight * (_potential(distance[m], scale, power)[1] - slope)
    return slopes


@jit
def _accumulate(
    distance: np.ndarray,
    rows: np.ndarray,
    settings: np.ndarray,
    gradient: np.ndarray,
    hessian: np.ndarray,
    exact: bool,
) -> float:
    """Sum over contacts: distance (M,), rows (M, nv) its gradients; adds to gradient (nv,) and hessian (nv, nv)."""
    scale, weight, power, value, slope, margin = settings
    moving = np.empty(rows.shape[1], dtype=np.int64)
    total = 0.0
    for m in range(distance.size):
        d = distance[m]
        f, first, second = _potential(d, scale, power)
        total += weight * (f - value - slope * (d - margin))
        first, second = weight * (first - slope), weight * (second if exact else max(second, 0.0))
        count = 0
        for k in range(rows.shape[1]):
            if rows[m, k] != 0.0:
                moving[count] = k
                count += 1
        for i in moving[:count]:
            gradient[i] += first * rows[m, i]
            for j in moving[:count]:
                hessian[i, j] += second * (rows[m, i] * rows[m, j])  # symmetric to the last bit
    return total


@jit
def _values(first: np.ndarray, distance: np.ndarray, settings: np.ndarray, values: np.ndarray) -> None:
    """Fill values (N,) with those of `_accumulate`; first (N + 1,): contacts first[n] to first[n + 1] - 1, of distance
    (C,) [m], are those of pose n."""
    scale, weight, power, value, slope, margin = settings
    for n in range(values.size):
        total = 0.0
        for m in range(first[n], first[n + 1]):
            f = _potential(distance[m], scale, power)[0]
            total += weight * (f - value - slope * (distance[m] - margin))
        values[n] = total
