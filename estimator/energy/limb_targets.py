"""Limbs of the body drawn to placements in the world: where each is believed to be by itself."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from estimator.energy.kernels.points import bend, gather
from estimator.energy.points import add_by_column
from estimator.energy.term import BatchTerm
from estimator.numerics.robust import POTENTIALS, rho
from estimator.numerics.rotations import half_sine_ratio, turn_between, turn_of, turned, turned_back
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.errors import InputError

STRAIGHT = 0.05  # rad; of smaller angles the logarithm's derivatives are those of its series


class LimbPull(NamedTuple):
    """Targets of limbs, in plain data.

    joint (L,), local (L, 3, 4): the joint that moves each limb and the limb's frame there (see
    `humanoid.limbs.limb.limbs_on_joints`). target (L, 7): placements in the world, points of
    `estimator.inference.beliefs.space.PLACEMENTS`. precision (L, 6, 6): W in the tangent space there, symmetric and
    positive semi-definite [1/m^2, 1/rad^2]. weight (L,): of each; 0 for a limb that nothing draws. potential, nu: see
    `estimator.numerics.robust`.
    """

    joint: np.ndarray
    local: np.ndarray
    target: np.ndarray
    precision: np.ndarray
    weight: np.ndarray
    potential: str = "lorentzian"
    nu: float = 12.0


class LimbTargets(BatchTerm):
    """1/2 sum weight rho(e' W e), e being the tangent at a limb's target that leads to where the pose has the limb.

    Its first three numbers are the way between the origins in the target's frame [m], the others the rotation vector
    from the target's frame to the limb's [rad], as in `estimator.inference.beliefs.space`. The exact Hessian has the
    curvature of both, of the logarithm as of the kinematics.

    One object serves one thread: it reuses buffers.

    Raises
    ------
    InputError: sizes that do not fit each other, or an array that is not finite.
    """

    name = "limb targets"

    def __init__(self, body: Body, pull: LimbPull) -> None:
        count = len(pull.joint)
        self._body, self._joint = body, np.asarray(pull.joint, dtype=np.int64)
        self._local = _sized("local", pull.local, (count, 3, 4))
        self._target = _sized("target", pull.target, (count, 7))
        self._precision = _sized("precision", pull.precision, (count, 6, 6))
        self._weight = _sized("weight", pull.weight, (count,))
        self._kind, self._nu = POTENTIALS[pull.potential], float(pull.nu)
        self._force, self._load = np.zeros((body.njoints, 6)), np.zeros((body.njoints, 6, 6))
        self._moment = np.zeros((body.njoints, 3, 3))

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        for buffer in (self._force, self._load, self._moment):
            buffer[:] = 0.0
        value: float = limb_loads(
            posed.placements, self._joint, self._local, self._target, self._precision, self._weight, self._kind,
            self._nu, exact, self._force, self._load, self._moment,
        )  # fmt: skip
        tree = self._body.tree

        def add(gradient: np.ndarray, hessian: np.ndarray) -> None:
            of = posed.spatial_jacobian, tree.joint_parent, tree.column_joint, tree.column_parent
            gather(*of, self._force, self._load, gradient, hessian)
            if exact:
                bend(*of, self._force, self._moment, hessian)

        add_by_column(self._body, gradient, hessian, add)
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        limb_values(
            placed.placements, self._joint, self._local, self._target, self._precision, self._weight, self._kind,
            self._nu, values,
        )  # fmt: skip
        return values


def _sized(name: str, given: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    array = np.ascontiguousarray(given, dtype=float)
    if array.shape != shape:
        raise InputError("limb targets", f"{name} has shape {array.shape}", remedy=f"{shape}, as the joints")
    if not np.isfinite(array).all():
        raise InputError("limb targets", f"{name} is not finite", remedy="weight 0 for limbs without a target")
    return array


@jit
def limb_loads(  # type: ignore[no-untyped-def]
    placements, joint, local, target, precision, weight, kind, nu, exact, force, load, moment
):
    """Value of L targets; adds each limb's derivatives by the spatial velocity of its joint to force (njoints, 6) and
    load (njoints, 6, 6), with `exact` also what the joints above turn to moment (njoints, 3, 3), as `bend` takes it.

    placements (njoints, 12). joint (L,), local (L, 3, 4), target (L, 7), precision (L, 6, 6), weight (L,).
    """
    value = 0.0
    R, B, p = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    e, pull, drawn = np.empty(6), np.empty(6), np.empty(6)
    E, WE, A, S = np.empty((6, 6)), np.empty((6, 6)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(joint.shape[0]):
        if weight[n] == 0.0:
            continue
        square = _placement_error(placements[joint[n]], local[n], target[n], precision[n], R, p, e, pull)
        cost, slope, bending = rho(kind, square, nu)
        value += 0.5 * weight[n] * cost
        slope, curve = weight[n] * slope, 2.0 * weight[n] * bending if exact else 0.0
        B[0, 0], B[1, 0], B[2, 0] = turned(target[n, 3:], 1.0, 0.0, 0.0)  # the target's axes in the world
        B[0, 1], B[1, 1], B[2, 1] = turned(target[n, 3:], 0.0, 1.0, 0.0)
        B[0, 2], B[1, 2], B[2, 2] = turned(target[n, 3:], 0.0, 0.0, 1.0)
        _logarithm_slope(e[3:], A)
        _by_velocity(B, A, p, E)
        for i in range(6):
            for k in range(6):
                s = 0.0
                for m in range(6):
                    s += precision[n, i, m] * E[m, k]
                WE[i, k] = slope * s
        F, H = force[joint[n]], load[joint[n]]
        for i in range(6):
            drawn[i] = 0.0
            for m in range(6):
                drawn[i] += E[m, i] * pull[m]
            F[i] += slope * drawn[i]
        for i in range(6):
            for k in range(i + 1):
                s = curve * drawn[i] * drawn[k]
                for m in range(6):
                    s += E[m, i] * WE[m, k]
                H[i, k] += s
                if i != k:
                    H[k, i] += s
        if exact:
            _logarithm_bend(e[3:], pull[3:], A, S)
            _add_bend(B, A, S, p, pull, slope, H, moment[joint[n]])
    return value


@jit
def limb_values(placements, joint, local, target, precision, weight, kind, nu, values):  # type: ignore[no-untyped-def]
    """Fill values (S,) with those of `limb_loads` for placements (S, njoints, 12)."""
    R, p, e, pull = np.empty((3, 3)), np.empty(3), np.empty(6), np.empty(6)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(joint.shape[0]):
            if weight[n] == 0.0:
                continue
            square = _placement_error(placements[s, joint[n]], local[n], target[n], precision[n], R, p, e, pull)
            value += 0.5 * weight[n] * rho(kind, square, nu)[0]
        values[s] = value


@jit
def _placement_error(placement, local, target, precision, R, p, e, pull):  # type: ignore[no-untyped-def]
    """e' W e; fills R (3, 3) and p (3,) with the limb's placement in the world, e (6,), and pull (6,) = W e.

    placement (12,), local (3, 4), target (7,), precision (6, 6).
    """
    M = placement
    for i in range(3):
        for k in range(3):
            R[i, k] = M[i] * local[0, k] + M[3 + i] * local[1, k] + M[6 + i] * local[2, k]
        p[i] = (M[i] * local[0, 3] + M[3 + i] * local[1, 3] + M[6 + i] * local[2, 3]) + M[9 + i]
    e[0], e[1], e[2] = turned_back(target[3:], p[0] - target[0], p[1] - target[1], p[2] - target[2])
    x, y, z, w = turn_between(target[3:], turn_of(R))
    ratio = half_sine_ratio(x, y, z, w)
    e[3], e[4], e[5] = ratio * x, ratio * y, ratio * z
    square = 0.0
    for i in range(6):
        pull[i] = 0.0
        for k in range(6):
            pull[i] += precision[i, k] * e[k]
        square += pull[i] * e[i]
    return square


@jit
def _by_velocity(B, A, p, E):  # type: ignore[no-untyped-def]
    """Fill E (6, 6): how the tangent changes with the spatial velocity (linear, angular, of the world's origin) of a
    limb at p (3,); B (3, 3) the target's axes, A (3, 3) see `_logarithm_slope`."""
    for i in range(3):
        b = B[:, i]
        E[i, 0], E[i, 1], E[i, 2] = b[0], b[1], b[2]
        E[i, 3] = p[1] * b[2] - p[2] * b[1]
        E[i, 4] = p[2] * b[0] - p[0] * b[2]
        E[i, 5] = p[0] * b[1] - p[1] * b[0]
        for k in range(3):
            E[3 + i, k] = 0.0
            E[3 + i, 3 + k] = A[i, 0] * B[k, 0] + A[i, 1] * B[k, 1] + A[i, 2] * B[k, 2]


@jit
def _bends(square):  # type: ignore[no-untyped-def]
    """Factor of [v]^2 in the inverse left Jacobian of SO(3) at a rotation vector v, and its derivative by the length of
    v, divided by that; square: of the length."""
    if square < STRAIGHT * STRAIGHT:
        factor = 1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0)
        return factor, 1.0 / 360.0 + square * (1.0 / 7560.0 + square / 201600.0)
    angle = math.sqrt(square)
    tangent = math.tan(0.5 * angle)
    cotangent = 1.0 / tangent
    slope = -2.0 / angle + 0.5 * cotangent + 0.25 * angle * (1.0 + cotangent * cotangent)
    return (1.0 - 0.5 * angle * cotangent) / square, slope / (square * angle)


@jit
def _logarithm_slope(v, A):  # type: ignore[no-untyped-def]
    """Fill A (3, 3): how a rotation vector v (3,) changes as what it turns is turned on, in the frame it starts from:
    the inverse left Jacobian I - [v]/2 + bend [v]^2."""
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    factor = _bends(square)[0]
    for i in range(3):
        for k in range(3):
            A[i, k] = factor * (v[i] * v[k] - (square if i == k else 0.0)) + (1.0 if i == k else 0.0)
    A[0, 1] += 0.5 * v[2]
    A[0, 2] -= 0.5 * v[1]
    A[1, 0] -= 0.5 * v[2]
    A[1, 2] += 0.5 * v[0]
    A[2, 0] += 0.5 * v[1]
    A[2, 1] -= 0.5 * v[0]


@jit
def _logarithm_bend(v, g, A, S):  # type: ignore[no-untyped-def]
    """Fill S (3, 3), the symmetric part of the second derivative of g' log at a rotation vector v (3,); g (3,), A
    (3, 3) as `_logarithm_slope` fills it. The derivative of A by v, along a direction d, times a turn c, times g, is
    d' N c; turning moves v by A."""
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    factor, slope = _bends(square)
    gv = g[0] * v[0] + g[1] * v[1] + g[2] * v[2]
    N, M = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            N[i, k] = factor * ((gv if i == k else 0.0) - 2.0 * v[i] * g[k] + g[i] * v[k])
            N[i, k] += slope * v[i] * (gv * v[k] - square * g[k])
    N[0, 1] -= 0.5 * g[2]
    N[0, 2] += 0.5 * g[1]
    N[1, 0] += 0.5 * g[2]
    N[1, 2] -= 0.5 * g[0]
    N[2, 0] -= 0.5 * g[1]
    N[2, 1] += 0.5 * g[0]
    for i in range(3):
        for k in range(3):
            M[i, k] = A[0, i] * N[0, k] + A[1, i] * N[1, k] + A[2, i] * N[2, k]
    for i in range(3):
        for k in range(3):
            S[i, k] = 0.5 * (M[i, k] + M[k, i])


@jit
def _add_bend(B, A, S, p, pull, slope, H, moment):  # type: ignore[no-untyped-def]
    """Add the curvature of a tangent, drawn by slope * pull (6,), to H (6, 6) and moment (3, 3) of its joint.

    B, A, S (3, 3), p (3,): see `limb_loads`. The second derivative of a turn that one joint carries along for another
    is the half of their cross product that is not in S: `bend` makes it of an antisymmetric moment.
    """
    f, c, inner = np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        inner[k] = slope * (A[0, k] * pull[3] + A[1, k] * pull[4] + A[2, k] * pull[5])
    for i in range(3):
        f[i] = slope * (B[i, 0] * pull[0] + B[i, 1] * pull[1] + B[i, 2] * pull[2])
        c[i] = B[i, 0] * inner[0] + B[i, 1] * inner[1] + B[i, 2] * inner[2]
    for i in range(3):
        for k in range(3):
            s = 0.0
            for a in range(3):
                for b in range(3):
                    s += B[i, a] * S[a, b] * B[k, b]
            H[3 + i, 3 + k] += slope * s
            moment[i, k] += p[i] * f[k]
    moment[0, 1] += 0.5 * c[2]
    moment[0, 2] -= 0.5 * c[1]
    moment[1, 0] -= 0.5 * c[2]
    moment[1, 2] += 0.5 * c[0]
    moment[2, 0] += 0.5 * c[1]
    moment[2, 1] -= 0.5 * c[0]
