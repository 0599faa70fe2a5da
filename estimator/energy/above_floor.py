"""Nothing is below the floor."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from estimator.energy.kernels.above_floor import floor_record, floor_values
from estimator.energy.kernels.records import FLOOR, Record
from estimator.energy.recorded import RecordedTerm
from estimator.numerics.robust import GAUSSIAN, LORENTZIAN, rho
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import PlacedBodies, PosedBody


class AboveFloor(RecordedTerm):
    """1/2 sum rho(d^2 / std^2) over the parts of the body whose signed distance d to the floor is negative.

    std [m]: of a part below it. nu: squared standard deviations from which the floor is no longer believed, as below it
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
