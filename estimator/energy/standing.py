"""Points of the feet that stand: where they were a moment ago, they are now."""

from __future__ import annotations

import numpy as np

from estimator.energy.point_targets import PointTargets
from estimator.numerics.robust import LORENTZIAN, rho
from humanoid.kinematics.body import Body, PosedBody

LEAST = 0.1  # probability of standing from which a point is held
_NU = 8.0  # squared standard deviations from which a point has begun to move


def standing_targets(
    body: Body, standing: np.ndarray, before: PosedBody, std: float, weight: float = 1.0
) -> list[PointTargets]:
    """What holds standing points where an earlier pose has them, that pose being held; nothing where none stands.

    standing (L,): probability that each landmark stands. std [m]: of its movement since, and of the earlier pose.
    """
    index = np.flatnonzero(standing >= LEAST)
    if not len(index):
        return []
    where = body.landmarks(before)[index]
    precision = np.repeat(np.eye(3)[None] / std**2, len(index), axis=0)
    return [
        PointTargets(
            body, body.landmark_joint[index], body.landmark_local[index], where, precision,
            weight=weight * standing[index], potential="lorentzian", nu=_NU, name="standing points",
        )
    ]  # fmt: skip


class StandingTie:
    """The same between the poses of two successive frames, neither of which is held.

    1/2 sum weight rho(|p_after - p_before|^2 / std^2) over the landmarks p that stand.
    """

    def __init__(self, body: Body, standing: np.ndarray, std: float, weight: float = 1.0) -> None:
        self._body, self._index = body, np.flatnonzero(standing >= LEAST)
        self._weight, self._precision = weight * standing[self._index], 1.0 / std**2

    def __bool__(self) -> bool:
        return len(self._index) > 0

    def accumulate_pair(self, before: PosedBody, after: PosedBody, gradient: np.ndarray, hessian: np.ndarray) -> float:
        """See `estimator.tracking.smoothing.ties.FlowTie`."""
        body, index, value = self._body, self._index, 0.0
        moved = body.landmarks(after)[index] - body.landmarks(before)[index]
        rows = np.concatenate([-body.landmark_jacobians(before)[index], body.landmark_jacobians(after)[index]], axis=2)
        for e, J, weight in zip(moved, rows, self._weight, strict=True):
            cost, slope, _ = rho(LORENTZIAN, float(e @ e) * self._precision, _NU)
            value += 0.5 * weight * cost
            gradient += weight * slope * self._precision * (J.T @ e)
            hessian += weight * slope * self._precision * (J.T @ J)
        return value
