"""Nothing is below the floor."""

from __future__ import annotations

import numpy as np

from estimator.energy.term import BatchTerm
from estimator.numerics.robust import GAUSSIAN, LORENTZIAN, rho
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import PlacedBodies, PosedBody


class AboveFloor(BatchTerm):
    """1/2 sum rho(d^2 / std^2) over the parts of the body whose signed distance d to the floor is negative.

    std [m]: of a part below it. nu: squared standard deviations from which the floor is no longer believed, as below it
    there may be another, a stair or what a box stands on; None where it is known, and rho is the identity. The exact
    Hessian leaves out the curvature of the distance.

    One object serves one thread: it reuses the buffers of `floor`.
    """

    name = "above the floor"

    def __init__(self, floor: FloorDistances, std: float, nu: float | None) -> None:
        self._floor, self._precision = floor, 1.0 / std**2
        self._kind, self._nu = (GAUSSIAN, 1.0) if nu is None else (LORENTZIAN, float(nu))

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value, contacts = 0.0, self._floor.near(posed, 0.0)
        for d, row in zip(contacts.distance, contacts.gradient, strict=True):
            cost, slope, bend = rho(self._kind, d * d * self._precision, self._nu)
            value += 0.5 * cost
            gradient += (slope * self._precision * d) * row
            stiff = slope + 2.0 * bend * d * d * self._precision if exact else slope
            hessian += (stiff * self._precision) * np.outer(row, row)
        return float(value)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.zeros(len(placed.q))
        for n, distance in enumerate(self._floor.distances(placed, 0.0)):
            for d in distance:
                values[n] += 0.5 * rho(self._kind, d * d * self._precision, self._nu)[0]
        return values
