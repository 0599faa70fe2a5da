"""Where beyond its hips a trunk leads along a ray of a camera: a smoothed pose stays in the reading of a mode."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from estimator.energy.kernels.records import TRUNK, Record
from estimator.energy.kernels.trunk_side import trunk_record, trunk_values
from estimator.energy.recorded import RecordedTerm
from humanoid.kinematics.body import Body, PlacedBodies


class TrunkSide(RecordedTerm):
    """1/2 (max(0, least - ray . (ends - about)) / std)^2 with the middles of two groups of landmarks.

    Nothing where the ends lead farther along the ray than `least`.

    Parameters
    ----------
    ends, about: landmarks of the body. ray (3,): unit vector in the world. least, std [m].

    The Hessian is Gauss-Newton's, also where the exact one is asked for: it leaves out the curvature of the kinematics.
    """

    name, kind = "trunk side", TRUNK

    def __init__(
        self, body: Body, ends: Sequence[int], about: Sequence[int], ray: np.ndarray, least: float, std: float
    ) -> None:
        landmarks = np.array([*ends, *about], dtype=np.int64)
        share = np.r_[np.full(len(ends), 1.0 / len(ends)), np.full(len(about), -1.0 / len(about))]
        joint, local = body.landmark_joint[landmarks], body.landmark_local[landmarks]
        self._body, self._points = body, (joint, local, share)
        self._side = np.asarray(ray, float), float(least), float(std)

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        joint, local, share = self._points
        return trunk_record(joint, self._body.last_columns(joint), local, share, *self._side)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        trunk_values(placed.placements, *self._points, *self._side, values)
        return values
