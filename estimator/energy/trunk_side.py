"""Where beyond its hips a trunk leads along a ray of a camera: a smoothed pose stays in the reading of a mode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.energy.term import BatchTerm
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody


class TrunkSide(BatchTerm):
    """1/2 (max(0, least - ray . (ends - about)) / std)^2 with the middles of two groups of landmarks.

    Nothing where the ends lead farther along the ray than `least`.

    Parameters
    ----------
    ends, about: landmarks of the body. ray (3,): unit vector in the world. least, std [m].

    The Hessian is Gauss-Newton's, also where the exact one is asked for: it leaves out the curvature of the kinematics.
    """

    name = "trunk side"

    def __init__(
        self, body: Body, ends: Sequence[int], about: Sequence[int], ray: np.ndarray, least: float, std: float
    ) -> None:
        self._body, self._ray, self._least, self._std = body, np.asarray(ray, float), float(least), float(std)
        self._landmarks = np.array([*ends, *about], dtype=np.int64)
        self._share = np.r_[np.full(len(ends), 1.0 / len(ends)), np.full(len(about), -1.0 / len(about))]

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        return 0.5 * np.square(self._short(self._body.landmarks_of(placed)))

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        short = self._short(self._body.landmarks(posed)[None])
        if short[0] > 0.0:
            jacobians = self._body.landmark_jacobians(posed)[self._landmarks]
            row = -np.einsum("l,lav,a->v", self._share, jacobians, self._ray) / self._std
            gradient += short[0] * row
            hessian += np.outer(row, row)
        return float(0.5 * np.square(short)[0])

    def _short(self, points: np.ndarray) -> np.ndarray:
        """By how much the ends fall short (N,), in standard deviations, by landmarks (N, L, 3) [m]."""
        along = ((points[:, self._landmarks] * self._ray).sum(axis=2) * self._share).sum(axis=1)
        return np.asarray(np.maximum(0.0, self._least - along) / self._std)
