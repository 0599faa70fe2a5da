"""Terms between the poses of two successive frames: flow between them, with neither of the two held (CSS eq. 9)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from estimator.data.cameras.projection import project_with_jacobian
from estimator.energy.kernels.keypoints import BEHIND
from estimator.energy.kernels.points import to_world
from estimator.energy.standing import StandingTie
from estimator.energy.term import Term
from estimator.numerics.robust import rho
from estimator.vision.cues.assigned import AssignedPoints
from humanoid.kinematics.body import Body, PosedBody
from humanoid.support.compiled import jit


class FlowTie:
    """The points of a term that was followed from a pose of the frame before, as a term of both poses.

    A point whose pixel moves with the earlier pose is carried by the same flow, so that its target moves with it: the
    energy is 1/2 sum weight rho(e' W e) with e = target + (x - x_followed) - y, where x is the point's pixel at the
    earlier pose, x_followed that at which it was followed, and y its pixel at the later one.

    followed: the term. past: the earlier pose that it was followed from.
    """

    def __init__(self, body: Body, followed: AssignedPoints, past: PosedBody) -> None:
        self._body, self._camera = body, followed.camera.arrays
        self._joint, self._local, features = followed.points_of_features()
        self._features = features[1:]
        self._from = np.empty((len(self._joint), 2))
        _pixels(past.placements, self._joint, self._local, *self._camera, self._from)

    def accumulate_pair(self, before: PosedBody, after: PosedBody, gradient: np.ndarray, hessian: np.ndarray) -> float:
        """Add gradient (2 nv,) and Gauss-Newton Hessian (2 nv, 2 nv) in the tangent spaces at both poses, the earlier
        one first; return the value."""
        count, columns = len(self._joint), len(before.spatial_jacobian)
        rows, weighted = np.zeros((2 * count, 2 * columns)), np.zeros((2 * count, 2 * columns))
        pull = np.zeros(2 * count)
        value: float = _rows(
            before.placements, after.placements, before.spatial_jacobian, after.spatial_jacobian,
            self._body.column_support, self._joint, self._local, *self._camera, self._from, *self._features, rows,
            weighted, pull,
        )  # fmt: skip
        rows, weighted = (
            self._body.collected(array.reshape(-1, 2, columns)).reshape(2 * count, -1) for array in (rows, weighted)
        )
        gradient += rows.T @ pull
        hessian += rows.T @ weighted
        return value


def ties_of(body: Body, followed: Iterable[Term], past: PosedBody) -> tuple[list[FlowTie], list[Term]]:
    """Terms that were followed from a past pose: those of points that move with it as ties, and the others as they
    are, with the past held."""
    tied, others = list[FlowTie](), list[Term]()
    for term in followed:
        if isinstance(term, AssignedPoints) and term.moves_with_past:
            tied.append(FlowTie(body, term, past))
        else:
            others.append(term)
    return tied, others


Tie = FlowTie | StandingTie
Ties = Sequence[Tie]


@jit
def _pixels(placements, joints, local, intrinsics, distortion, R, t, pixels):  # type: ignore[no-untyped-def]
    """Fill pixels (A, 2), NaN behind the camera, of points local (A, 3) on joints (A,) for placements (njoints, 12);
    the camera as in `_rows`."""
    p, J = np.empty(3), np.zeros((2, 3))
    for a in range(joints.shape[0]):
        to_world(placements[joints[a]], local[a], p)
        u, v, visible = project_with_jacobian(p, intrinsics, distortion, R, t, J)
        pixels[a, 0], pixels[a, 1] = (u, v) if visible else (np.nan, np.nan)


@jit
def _moved(p, J, spatial, support, sign, row_u, row_v):  # type: ignore[no-untyped-def]
    """Fill the derivatives row_u, row_v (nv,) of a pixel by the pose, times `sign`: p (3,) the point, J (2, 3) of its
    projection, spatial (nv, 6) as in `PosedBody`, support (nv,) the degrees of freedom that move it."""
    for k in range(spatial.shape[0]):
        if support[k]:
            s = spatial[k]
            x = s[0] + s[4] * p[2] - s[5] * p[1]
            y = s[1] + s[5] * p[0] - s[3] * p[2]
            z = s[2] + s[3] * p[1] - s[4] * p[0]
            row_u[k] = sign * (J[0, 0] * x + J[0, 1] * y + J[0, 2] * z)
            row_v[k] = sign * (J[1, 0] * x + J[1, 1] * y + J[1, 2] * z)


@jit
def _rows(  # type: ignore[no-untyped-def]
    before, after, spatial_before, spatial_after, support, joints, local, intrinsics, distortion, R, t, start, target,
    precision, weight, kind, nu, rows, weighted, pull,
):  # fmt: skip
    """Value of a tie. Fills rows (2 * A, 2 * nv), the derivatives of e, weighted (2 * A, 2 * nv), W times these, and
    pull (2 * A,), W e, W being the precision (A, 3) times weight (A,) and slope of the potential.

    before, after (njoints, 12), spatial_before, spatial_after (nv, 6): the two poses, see `PosedBody`. support
    (njoints, nv): the degrees of freedom that move each joint. joints (A,), local (A, 3): the points. intrinsics,
    distortion (5,) or (1, 22), R (3, 3), t (3,): the camera. start (A, 2): where they were followed from [px]. target
    (A, 2), kind, nu (A,): as in `assigned_loads`.
    """
    value, nv = 0.0, spatial_before.shape[0]
    p, J = np.empty(3), np.zeros((2, 3))
    for a in range(joints.shape[0]):
        j = joints[a]
        to_world(before[j], local[a], p)
        u, v, seen = project_with_jacobian(p, intrinsics, distortion, R, t, J)
        if seen:
            _moved(p, J, spatial_before, support[j], 1.0, rows[2 * a, :nv], rows[2 * a + 1, :nv])
        to_world(after[j], local[a], p)
        x, y, still = project_with_jacobian(p, intrinsics, distortion, R, t, J)
        if not (seen and still and np.isfinite(start[a, 0])):
            value += 0.5 * weight[a] * rho(kind[a], BEHIND, nu[a])[0]
            rows[2 * a], rows[2 * a + 1] = 0.0, 0.0
            continue
        _moved(p, J, spatial_after, support[j], -1.0, rows[2 * a, nv:], rows[2 * a + 1, nv:])
        ex, ey = target[a, 0] + u - start[a, 0] - x, target[a, 1] + v - start[a, 1] - y
        px = precision[a, 0] * ex + precision[a, 1] * ey
        py = precision[a, 1] * ex + precision[a, 2] * ey
        cost, slope, _ = rho(kind[a], ex * px + ey * py, nu[a])
        value += 0.5 * weight[a] * cost
        w = weight[a] * slope
        pull[2 * a], pull[2 * a + 1] = w * px, w * py
        for k in range(2 * nv):
            f, g = rows[2 * a, k], rows[2 * a + 1, k]
            weighted[2 * a, k] = w * (precision[a, 0] * f + precision[a, 1] * g)
            weighted[2 * a + 1, k] = w * (precision[a, 1] * f + precision[a, 2] * g)
    return value
