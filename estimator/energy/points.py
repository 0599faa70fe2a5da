"""Forces on points of the body, gathered into gradient and Hessian of the tangent space.

A term on points (landmarks, surface nodes) gives each its gradient f (3,) and Hessian W (3, 3) with respect to the
point's place in the world. The sums over a joint's points and over the subtree behind it are 6-vectors and 6x6 matrices
in the world frame, so that the cost of J'f and J'WJ does not grow with points x nv^2.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from estimator.energy.kernels.points import accumulate_loads
from humanoid.kinematics.body import Body, PosedBody


class LoadedPoints(NamedTuple):
    """Points with the derivatives of an energy by their places.

    joints (N,): joint each point is fixed to. points (N, 3): in the world [m]. force (N, 3) [1/m]: gradient. weight
    (N, 3, 3) [1/m^2]: Hessian.
    """

    joints: np.ndarray
    points: np.ndarray
    force: np.ndarray
    weight: np.ndarray

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled without places and loads, which are filled again at every pose."""
        return LoadedPoints.on, (self.joints,)

    @staticmethod
    def on(joints: np.ndarray) -> LoadedPoints:
        """Points on joints (N,), without places or loads yet."""
        count = len(joints)
        return LoadedPoints(joints, np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3, 3)))

    @staticmethod
    def passing(joints: np.ndarray) -> LoadedPoints:
        """The same, with arbitrary places and loads, valid until the thread's next call: the many terms of a smoother
        then need no buffers of their own."""
        return _BUFFERS.of(joints)


class _Buffers(threading.local):
    """Buffers of a thread, of the largest size so far."""

    def __init__(self) -> None:
        self._largest = LoadedPoints.on(np.zeros(0, dtype=np.int64))

    def of(self, joints: np.ndarray) -> LoadedPoints:
        """The selected ones, for points on joints (N,)."""
        count = len(joints)
        if len(self._largest.points) < count:
            self._largest = LoadedPoints.on(joints)
        _, points, force, weight = self._largest
        return LoadedPoints(joints, points[:count], force[:count], weight[:count])


_BUFFERS = _Buffers()


def accumulate_points(
    body: Body, posed: PosedBody, loaded: LoadedPoints, gradient: np.ndarray, hessian: np.ndarray, exact: bool
) -> None:
    """Add J' f to `gradient` (nv,) and J' W J to `hessian` (nv, nv), summed over the points.

    With `exact` the curvature of the kinematics, sum f . d2p, is added too.
    """
    tree = body.tree

    def add(gradient: np.ndarray, hessian: np.ndarray) -> None:
        accumulate_loads(
            posed.spatial_jacobian, tree.joint_parent, tree.column_joint, tree.column_parent, loaded.joints,
            loaded.points, loaded.force, loaded.weight, gradient, hessian, exact,
        )  # fmt: skip

    add_by_column(body, gradient, hessian, add)


def add_by_column(
    body: Body, gradient: np.ndarray, hessian: np.ndarray, add: Callable[[np.ndarray, np.ndarray], None]
) -> None:
    """Add to `gradient` (nv,) and `hessian` (nv, nv) what `add` adds to a gradient (nc,) and Hessian (nc, nc) by the
    columns of the spatial Jacobian, see `humanoid.kinematics.body.Tree`."""
    if not body.follows:
        add(gradient, hessian)
        return
    columns = len(body.tree.column_dof)
    by_column = np.zeros(columns), np.zeros((columns, columns))
    add(*by_column)
    gradient += body.collected(by_column[0])
    hessian += body.collected_hessian(by_column[1])
