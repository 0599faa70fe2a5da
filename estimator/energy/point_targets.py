"""Points of the body drawn to places in the world: captured landmarks, measured depth."""

from __future__ import annotations

import numpy as np

from estimator.energy.points import LoadedPoints, accumulate_points, to_world
from estimator.energy.term import BatchTerm
from estimator.numerics.robust import POTENTIALS, rho
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError


class PointTargets(BatchTerm):
    """1/2 sum weight rho(e' W e) with e = point - target in the world (CSS eqs. 5 and 6, in space instead of an image).

    Parameters
    ----------
    body: whose points they are.
    joint (N,), local (N, 3): points fixed to joints, in the joints' frames [m]; of landmarks, `Body.landmark_joint` and
        `Body.landmark_local`.
    target (N, 3): where they should be, in the world [m].
    precision (N, 3, 3): W, symmetric and positive semi-definite [1/m^2]: singular where a direction is not known.
    weight (N,): of each; 1 unless given.
    potential, nu: see `estimator.numerics.robust`.
    name: of what they are drawn by.

    One object serves one thread: it reuses buffers.

    Raises
    ------
    InputError: sizes that do not fit each other, or an array that is not finite.
    """

    def __init__(
        self,
        body: Body,
        joint: np.ndarray,
        local: np.ndarray,
        target: np.ndarray,
        precision: np.ndarray,
        *,
        weight: np.ndarray | None = None,
        potential: str = "gaussian",
        nu: float = 4.0,
        name: str = "point targets",
    ) -> None:
        self.name = name
        count = len(joint)
        self._body, self._joint = body, np.asarray(joint, dtype=np.int64)
        self._local, self._target = _sized("local", local, (count, 3)), _sized("target", target, (count, 3))
        self._precision = _sized("precision", precision, (count, 3, 3))
        self._weight = _sized("weight", np.ones(count) if weight is None else weight, (count,))
        self._kind, self._nu = POTENTIALS[potential], float(nu)
        self._loaded = LoadedPoints.on(self._joint)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value = self._load(posed, exact)
        accumulate_points(self._body, posed, self._loaded, gradient, hessian, exact)
        return value

    def point_loads(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (N, 3) [1/m] and Gauss-Newton Hessian (N, 3, 3) of the value with respect to each point."""
        self._load(posed, False)
        return self._loaded.force.copy(), self._loaded.weight.copy()

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        target_values(
            placed.placements, self._joint, self._local, self._target, self._precision, self._weight, self._kind,
            self._nu, values,
        )  # fmt: skip
        return values

    def _load(self, posed: PosedBody, exact: bool) -> float:
        value: float = target_loads(
            posed.placements, self._joint, self._local, self._target, self._precision, self._weight, self._kind,
            self._nu, exact, self._loaded.points, self._loaded.force, self._loaded.weight,
        )  # fmt: skip
        return value


def _sized(name: str, given: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    array = np.ascontiguousarray(given, dtype=float)
    if array.shape != shape:
        raise InputError("point targets", f"{name} has shape {array.shape}", remedy=f"{shape}, as the joints")
    if not np.isfinite(array).all():
        raise InputError("point targets", f"{name} is not finite", remedy="leave out points without a target")
    return array


@jit
def target_loads(  # type: ignore[no-untyped-def]
    placements, joints, local, target, precision, weight, kind, nu, exact, points, force, load
):
    """Value of N targets; fills the points in the world (N, 3), and gradient `force` (N, 3) and Hessian `load`
    (N, 3, 3) of the value with respect to them.

    placements (njoints, 12). joints (N,), local, target (N, 3), precision (N, 3, 3), weight (N,).
    """
    value = 0.0
    e, pull = np.empty(3), np.empty(3)
    for n in range(joints.shape[0]):
        square = _whitened(placements[joints[n]], local[n], target[n], precision[n], points[n], e, pull)
        cost, slope, bending = rho(kind, square, nu)
        value += 0.5 * weight[n] * cost
        slope, curve = weight[n] * slope, 2.0 * weight[n] * bending if exact else 0.0
        for i in range(3):
            force[n, i] = slope * pull[i]
            for k in range(3):
                load[n, i, k] = slope * precision[n, i, k] + curve * pull[i] * pull[k]
    return value


@jit
def target_values(placements, joints, local, target, precision, weight, kind, nu, values):  # type: ignore[no-untyped-def]
    """Fill values (S,) with those of `target_loads` for placements (S, njoints, 12)."""
    p, e, pull = np.empty(3), np.empty(3), np.empty(3)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(joints.shape[0]):
            square = _whitened(placements[s, joints[n]], local[n], target[n], precision[n], p, e, pull)
            value += 0.5 * weight[n] * rho(kind, square, nu)[0]
        values[s] = value


@jit
def _whitened(placement, local, target, precision, point, e, pull):  # type: ignore[no-untyped-def]
    """e' W e of e = point - target (3,), W = precision (3, 3); fills point (3,) in the world, e (3,), pull (3,) = W e.

    placement (12,), local (3,): see `to_world`.
    """
    to_world(placement, local, point)
    for i in range(3):
        e[i] = point[i] - target[i]
    square = 0.0
    for i in range(3):
        pull[i] = precision[i, 0] * e[0] + precision[i, 1] * e[1] + precision[i, 2] * e[2]
        square += pull[i] * e[i]
    return square
