"""Terms against overlap: repulsion of body parts (CSS section 3.2.4), and of parts below the floor."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from estimator.energy.kernels.records import FLOOR, REPULSION, Record
from estimator.energy.kernels.repulsion import (
    add_repulsion,
    floor_record,
    floor_values,
    potential,
    repulsion_record,
    repulsion_values,
    slopes_of,
)
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.robust import GAUSSIAN, LORENTZIAN, rho
from humanoid.collision.floor import FloorDistances
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


class AboveFloor(RecordedTerm):
    """1/2 sum rho(d^2 / std^2) over the parts of the body whose signed distance d to the floor is negative.

    std [m]: of a part below it. nu: squared standard deviations from which the floor is ignored, as below it
    there may be another, a stair or what a box stands on; None where it is known, and rho is the identity. The exact
    Hessian leaves out the curvature of the distance.

    One object serves one thread: it reuses the buffers of `floor`.
    """

    name, kind, lasting = "above the floor", FLOOR, True

    def __init__(self, floor: FloorDistances, std: float, nu: float | None) -> None:
        self._body, self._floor, self._precision = floor.body, floor, 1.0 / std**2
        self._potential, self._nu = (GAUSSIAN, 1.0) if nu is None else (LORENTZIAN, float(nu))
        self.recorded = floor.round_pieces is not None

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        floor = self._floor
        assert floor.round_pieces is not None
        return floor_record(
            floor.round_pieces, floor.normal, floor.height, self._precision, self._potential, self._nu
        )  # fmt: skip

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        if self.recorded:
            return super().accumulate(posed, gradient, hessian, exact)
        value, contacts = 0.0, self._floor.near(posed, 0.0)
        for d, row in zip(contacts.distance, contacts.gradient, strict=True):
            cost, slope, bend = rho(self._potential, d * d * self._precision, self._nu)
            value += 0.5 * cost
            gradient += (slope * self._precision * d) * row
            stiff = slope + 2.0 * bend * d * d * self._precision if exact else slope
            hessian += (stiff * self._precision) * np.outer(row, row)
        return float(value)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        floor, values = self._floor, np.zeros(len(placed.q))
        if floor.round_pieces is not None:
            joint, _, centre, half_axes = floor.round_pieces
            floor_values(
                placed.placements, joint, centre, half_axes, floor.normal, floor.height, self._precision,
                self._potential, self._nu, values,
            )  # fmt: skip
            return values
        for n, distance in enumerate(floor.distances(placed, 0.0)):
            for d in distance:
                values[n] += 0.5 * rho(self._potential, d * d * self._precision, self._nu)[0]
        return values
