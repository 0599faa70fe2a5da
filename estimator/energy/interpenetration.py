"""Repulsion of body parts (CSS section 3.2.4)."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from estimator.energy.kernels.records import REPULSION, Record
from estimator.energy.kernels.repulsion import (
    add_repulsion,
    potential,
    repulsion_record,
    repulsion_values,
    slopes_of,
)
from estimator.energy.recorded import RecordedTerm
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import PlacedBodies, PosedBody
from humanoid.support.errors import InputError


class Interpenetration(RecordedTerm):
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

    name, kind, lasting = "interpenetration", REPULSION, True

    def __init__(
        self, self_collision: SelfCollision, scale: float = 0.005, weight: float = 1.0, power: float = 1.0
    ) -> None:
        given = (("scale", scale, scale > 0.0), ("weight", weight, weight >= 0.0), ("power", power, power >= 1.0))
        for name, number, valid in given:
            if not (valid and np.isfinite(number)):
                remedy = "scale > 0 [m], weight >= 0, power >= 1"
                raise InputError("interpenetration", f"{name} is {number}", remedy=remedy)
        self.self_collision = self_collision
        at_margin, slope_there, _ = potential(self_collision.margin, scale, power)
        self._settings = np.array([scale, weight, power, at_margin, slope_there, self_collision.margin])

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        return repulsion_record(self.self_collision.arrays, self._settings)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        contacts = self.self_collision.near(posed)
        if not contacts.distance.size:
            return 0.0
        if exact:
            slopes = slopes_of(contacts.distance, self._settings)
            self.self_collision.add_curvature(posed, contacts, slopes, hessian)
        return float(add_repulsion(contacts.distance, contacts.gradient, self._settings, gradient, hessian, exact))

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        first, distance = self.self_collision.distances(placed)
        values = np.empty(len(placed.q))
        repulsion_values(first, distance, self._settings, values)
        return values
