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

    1/2 sum weight rho(|p_after - p_before|^2 / std^2) over the landmarks p that stand. index, weight (S,): which they
    are, and how much each is held.
    """

    def __init__(self, body: Body, index: np.ndarray, weight: np.ndarray, std: float) -> None:
        self._body, self._index, self._weight, self._precision = body, index, weight, 1.0 / std**2

    def accumulate_pair(self, before: PosedBody, after: PosedBody, gradient: np.ndarray, hessian: np.ndarray) -> float:
        """See `estimator.tracking.smoothing.ties.FlowTie`."""
        body, some = self._body, self._index
        moved = body.landmarks(after)[some] - body.landmarks(before)[some]
        of_before, of_after = (body.landmark_jacobians(posed, some) for posed in (before, after))
        rows = np.concatenate([-of_before, of_after], axis=2)
        parts = [rho(LORENTZIAN, square, _NU) for square in self._precision * np.square(moved).sum(axis=1)]
        held = self._precision * self._weight * np.array([slope for _, slope, _ in parts])
        weighted = held[:, None, None] * rows
        gradient += np.einsum("nij,ni->j", weighted, moved)
        hessian += weighted.reshape(-1, rows.shape[2]).T @ rows.reshape(-1, rows.shape[2])
        return 0.5 * float(self._weight @ np.array([cost for cost, _, _ in parts]))


def standing_ties(body: Body, standing: np.ndarray, std: float, weight: float = 1.0) -> list[StandingTie]:
    """A tie as `standing_targets` has targets; nothing where none stands."""
    index = np.flatnonzero(standing >= LEAST)
    return [StandingTie(body, index, weight * standing[index], std)] if len(index) else []
