"""Points of the feet that stand: where they were a moment ago, they are now."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.points import to_world
from estimator.energy.point_targets import PointTargets
from estimator.numerics.robust import LORENTZIAN, rho
from humanoid.kinematics.body import Body, PosedBody, points_in_world
from humanoid.support.compiled import jit

LEAST = 0.1  # probability of standing from which a point is held
_NU = 8.0  # squared standard deviations from which a point has begun to move


class HeldPoints:
    """The landmarks that stand in a frame, to be held where an earlier pose has them, that pose being held.

    standing (L,): probability that each landmark stands. std [m]: of its movement since, and of the earlier pose.
    """

    def __init__(self, body: Body, standing: np.ndarray, std: float, weight: float = 1.0) -> None:
        index = np.flatnonzero(standing >= LEAST)
        joint, local = body.landmark_joint[index], body.landmark_local[index]
        precision = np.repeat(np.eye(3)[None] / std**2, len(index), axis=0)
        self._joint, self._local = joint, local
        self._targets = PointTargets(
            body, joint, local, np.zeros((len(index), 3)), precision, weight=weight * standing[index],
            potential="lorentzian", nu=_NU, name="standing points",
        )  # fmt: skip

    def targets(self, before: PosedBody) -> list[PointTargets]:
        """What holds them where an earlier pose has them; nothing where none stands."""
        if not len(self._joint):
            return []
        return [self._targets.with_targets(points_in_world(before, self._joint, self._local))]


class StandingTie:
    """The same between the poses of two successive frames, neither of which is held.

    1/2 sum weight rho(|p_after - p_before|^2 / std^2) over the landmarks p that stand. index, weight (S,): which they
    are, and how much each is held.
    """

    def __init__(self, body: Body, index: np.ndarray, weight: np.ndarray, std: float) -> None:
        self._body, self._weight, self._precision = body, weight, 1.0 / std**2
        self._joint, self._local = body.landmark_joint[index], np.ascontiguousarray(body.landmark_local[index])

    def accumulate_pair(self, before: PosedBody, after: PosedBody, gradient: np.ndarray, hessian: np.ndarray) -> float:
        """See `estimator.tracking.smoothing.ties.FlowTie`."""
        count, columns = len(self._joint), len(before.spatial_jacobian)
        rows, scaled, pull = np.zeros((3 * count, 2, columns)), np.empty(3 * count), np.empty(3 * count)
        value: float = _tie_rows(
            before.placements, after.placements, before.spatial_jacobian, after.spatial_jacobian,
            self._body.column_support, self._joint, self._local, self._precision, self._weight, rows, scaled, pull,
        )  # fmt: skip
        flat = self._body.collected(rows).reshape(3 * count, -1)
        gradient += flat.T @ pull
        hessian += flat.T @ (scaled[:, None] * flat)
        return value


@jit
def _tie_rows(  # type: ignore[no-untyped-def]
    before, after, J_before, J_after, support, joint, local, precision, weight, rows, scaled, pull
):
    """Value of a tie of S points; fills `rows` (R, 2, nc) with the derivatives of their movements by both poses, three
    for each point, `pull` (R,) with the value's by the movements, and `scaled` (R,) with its stiffness.

    before, after (njoints, 12), J_before, J_after (nc, 6), support (njoints, nc): of the two poses and the body. joint
    (S,), local (S, 3), weight (S,): of the points.
    """
    value = 0.0
    p, x = np.empty((2, 3)), np.empty(3)
    for n in range(joint.shape[0]):
        to_world(before[joint[n]], local[n], p[0])
        to_world(after[joint[n]], local[n], p[1])
        square = 0.0
        for i in range(3):
            x[i] = p[1, i] - p[0, i]
            square += precision * x[i] * x[i]
        cost, slope, _ = rho(LORENTZIAN, square, _NU)
        value += 0.5 * weight[n] * cost
        for i in range(3):
            scaled[3 * n + i] = precision * weight[n] * slope
            pull[3 * n + i] = precision * weight[n] * slope * x[i]
        for k in range(support.shape[1]):
            if not support[joint[n], k]:
                continue
            for t in range(2):
                J, sign = (J_after[k], 1.0) if t else (J_before[k], -1.0)
                rows[3 * n, t, k] = sign * (J[0] + J[4] * p[t, 2] - J[5] * p[t, 1])
                rows[3 * n + 1, t, k] = sign * (J[1] + J[5] * p[t, 0] - J[3] * p[t, 2])
                rows[3 * n + 2, t, k] = sign * (J[2] + J[3] * p[t, 1] - J[4] * p[t, 0])
    return value


def standing_ties(body: Body, standing: np.ndarray, std: float, weight: float = 1.0) -> list[StandingTie]:
    """A tie as `HeldPoints` has targets; nothing where none stands."""
    index = np.flatnonzero(standing >= LEAST)
    return [StandingTie(body, index, weight * standing[index], std)] if len(index) else []
