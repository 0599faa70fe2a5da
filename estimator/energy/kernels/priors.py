"""Compiled kernels of the priors on a configuration: diffusion from the previous one, stabilisers, the side to which a
trunk leads, and a root's tilt.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.energy.kernels.points import to_world
from estimator.energy.kernels.records import STABILISERS, TILT, TRANSITION, TRUNK, Record, record_of
from estimator.numerics.robust import rho, robust_square, robust_sum
from estimator.numerics.vectors import cross, dot
from humanoid.kinematics.body import ROOT_JOINT
from humanoid.kinematics.compiled_tree import FREE, difference
from humanoid.support.compiled import jit


@jit
def diffuse(e, precision, kind, nu, exact, ranges, jacobian, pull, bend, gradient, hessian):  # type: ignore[no-untyped-def]
    """Value of the transition; adds to gradient (nv,) and hessian (nv, nv).

    e, precision (nv,). jacobian (nv, nv): derivative of e, the identity outside the diagonal blocks in `ranges` (B, 2),
    and of no size where there are none. pull, bend (nv,): overwritten.
    """
    value = robust_square(e, precision, kind, nu, exact, pull, bend)
    first = 0
    for b in range(ranges.shape[0] + 1):
        start = ranges[b, 0] if b < ranges.shape[0] else e.shape[0]
        for i in range(first, start):
            gradient[i] += pull[i]
            hessian[i, i] += bend[i]
        if b < ranges.shape[0]:
            first = ranges[b, 1]
            for i in range(start, first):
                for m in range(start, first):
                    gradient[i] += jacobian[m, i] * pull[m]
                    for k in range(start, first):
                        hessian[i, k] += jacobian[m, i] * bend[m] * jacobian[m, k]
    return value


def transition_record(
    joints: np.ndarray, q_previous: np.ndarray, precision: np.ndarray, kind: int, nu: float
) -> Record:
    """The term from q_previous (nq,), precision (nv,); joints: what `transition_joints` makes of the body's."""
    sizes = [len(q_previous), len(precision), kind]
    return record_of(TRANSITION, [*sizes, joints], [nu, q_previous, precision])


def record_since(record: Record, q_previous: np.ndarray) -> Record:
    """The same term from another configuration q_previous (nq,)."""
    numbers = record.numbers.copy()
    numbers[1 : 1 + len(q_previous)] = q_previous
    return record._replace(numbers=numbers)


def transition_joints(indices: np.ndarray) -> np.ndarray:
    """Integers that are the same in all records of a body: indices (njoints - 1, 3), see `CompiledTree.indices`, and
    the ranges of its free joints in the tangent space."""
    free = indices[indices[:, 0] == FREE, 2]
    ranges = np.stack((free, free + 6), axis=1)
    return np.concatenate([[len(indices), len(ranges)], indices.ravel(), ranges.ravel()])


@jit
def recorded_transition(integers, numbers, q, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """`diffuse` of a record's integers (I,) and numbers (F,), from its configuration to q (nq,)."""
    nq, nv, kind, joints, B = integers[0], integers[1], integers[2], integers[3], integers[4]
    indices, o = integers[5 : 5 + 3 * joints].reshape(joints, 3), 5 + 3 * joints
    ranges = integers[o : o + 2 * B].reshape(B, 2)
    change, slope, pull, bend = np.empty(nv), np.empty((nv, nv)), np.empty(nv), np.empty(nv)
    difference(indices, numbers[1 : 1 + nq], q, change, slope)
    precision = numbers[1 + nq : 1 + nq + nv]
    return diffuse(
        change, precision, kind, numbers[0], exact, ranges, slope, pull, bend, gradient, hessian
    )  # fmt: skip


@jit
def transition_values(integers, numbers, q, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `recorded_transition` at q (N, nq); integers (I,), numbers (F,)."""
    nq, nv, joints = integers[0], integers[1], integers[3]
    indices, change, slope = integers[5 : 5 + 3 * joints].reshape(joints, 3), np.empty(nv), np.empty((nv, nv))
    for n in range(q.shape[0]):
        difference(indices, numbers[1 : 1 + nq], q[n], change, slope)
        values[n] = robust_sum(change, numbers[1 + nq : 1 + nq + nv], integers[2], numbers[0])


STABILISER_NU = 4.0
"""Spread of the stabilisers' outliers: with the Lorentzian exp(-energy) is Student's t with 3 degrees of freedom, the
fewest that have a variance; the pose prior's background and the order of kinematic jumps are the same density."""


def stabiliser_log_integral() -> float:
    """Logarithm of the integral of (1 + z^2 / nu)^(-nu / 2) over z, by which exp(-energy) is a density."""
    return (
        0.5 * math.log(math.pi * STABILISER_NU)
        + math.lgamma(0.5 * (STABILISER_NU - 1.0))
        - math.lgamma(0.5 * STABILISER_NU)
    )


@jit
def stabilise(q, q_index, v_index, rest, precision, weight, kind, nu, gradient, hessian, exact):  # type: ignore[no-untyped-def]
    """Value of S stabilisers; adds their gradient (nv,) and diagonal hessian (nv, nv).

    q (nq,). q_index, v_index (S,): places of their joints in q and in the tangent. rest, weight (S,). precision (S, 2):
    below and above rest.
    """
    value = 0.0
    for i in range(q_index.shape[0]):
        e = q[q_index[i]] - rest[i]
        own = precision[i, 1 if e > 0.0 else 0]
        cost, slope, bend = rho(kind, e * e * own, nu)
        value += 0.5 * weight[i] * cost
        gradient[v_index[i]] += weight[i] * slope * own * e
        curvature = slope + 2.0 * bend * e * e * own if exact else slope
        hessian[v_index[i], v_index[i]] += weight[i] * curvature * own
    return value


@jit
def stabiliser_values(q, q_index, rest, precision, weight, kind, nu, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `stabilise` at q (N, nq)."""
    for n in range(q.shape[0]):
        value = 0.0
        for i in range(q_index.shape[0]):
            e = q[n, q_index[i]] - rest[i]
            value += 0.5 * weight[i] * rho(kind, e * e * precision[i, 1 if e > 0.0 else 0], nu)[0]
        values[n] = value


def stabiliser_record(
    q_index: np.ndarray, v_index: np.ndarray, rest: np.ndarray, precision: np.ndarray, weight: np.ndarray, kind: int,
    nu: float,
) -> Record:  # fmt: skip
    """The term, see `stabilise`."""
    return record_of(STABILISERS, [len(rest), kind, q_index, v_index], [nu, rest, precision, weight])


@jit
def recorded_stabilisers(integers, numbers, q, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """`stabilise` of a record's integers (I,) and numbers (F,)."""
    S, kind, q_index, v_index = integers[0], integers[1], integers[2:], integers[2 + integers[0] :]
    nu, rest, precision = numbers[0], numbers[1 : 1 + S], numbers[1 + S : 1 + 3 * S].reshape(S, 2)
    weight = numbers[1 + 3 * S : 1 + 4 * S]
    return stabilise(q, q_index[:S], v_index[:S], rest, precision, weight, kind, nu, gradient, hessian, exact)


@jit
def shortfall(placements, joint, local, share, ray, least, std):  # type: ignore[no-untyped-def]
    """Shortfall of the ends in standard deviations, at placements (njoints, 12).

    joint, share (N,), local (N, 3): the landmarks, and how each counts. ray (3,), least, std [m]: see `TrunkSide`.
    """
    point, along = np.empty(3), 0.0
    for n in range(joint.shape[0]):
        to_world(placements[joint[n]], local[n], point)
        along += share[n] * dot(ray, point)
    return max(0.0, least - along) / std


@jit
def trunk_values(placements, joint, local, share, ray, least, std, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `recorded_trunk` for placements (N, njoints, 12)."""
    for s in range(placements.shape[0]):
        short = shortfall(placements[s], joint, local, share, ray, least, std)
        values[s] = 0.5 * short * short


def trunk_record(
    joint: np.ndarray, column: np.ndarray, local: np.ndarray, share: np.ndarray, ray: np.ndarray, least: float,
    std: float,
) -> Record:  # fmt: skip
    """The term, see `shortfall`; column (N,): the last column of the spatial Jacobian that moves each landmark."""
    return record_of(TRUNK, [len(joint), joint, column], [least, std, ray, share, local])


@jit
def recorded_trunk(integers, numbers, placements, J, column_parent, gradient, hessian):  # type: ignore[no-untyped-def]
    """Value of a record's integers (I,) and numbers (F,), half the square of `shortfall`; adds its derivatives to
    gradient (nc,) and hessian (nc, nc). placements (njoints, 12), J (nc, 6), column_parent (nc,)."""
    N, least, std, ray = integers[0], numbers[0], numbers[1], numbers[2:5]
    joint, column, share = integers[1 : 1 + N], integers[1 + N : 1 + 2 * N], numbers[5 : 5 + N]
    local = numbers[5 + N : 5 + 4 * N].reshape(N, 3)
    short = shortfall(placements, joint, local, share, ray, least, std)
    if short > 0.0:
        row, point = np.zeros(J.shape[0]), np.empty(3)
        for n in range(N):
            to_world(placements[joint[n]], local[n], point)
            moment = cross(point, ray)  # ray . (v + w x point)
            k = column[n]
            while k >= 0:
                row[k] -= share[n] * (dot(ray, J[k]) + dot(moment, J[k, 3:])) / std
                k = column_parent[k]
        for i in range(row.shape[0]):
            if row[i] != 0.0:
                gradient[i] += short * row[i]
                for k in range(row.shape[0]):
                    hessian[i, k] += row[i] * row[k]
    return 0.5 * short * short


@jit
def tilt(placement, axis, up, precision, weight, kind, nu, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """Value of the pull of R axis (3,) towards up (3,), R from the root's placement (12,).

    Adds to the root's three angular degrees of freedom in gradient (nv,) and hessian (nv, nv): they turn about the
    root's own axes.
    """
    u, e = np.zeros(3), np.zeros(3)
    s = _lean(placement, axis, up, u, e)
    cost, slope, bending = rho(kind, s * precision, nu)
    pull, curve = weight * slope * precision, 2.0 * weight * bending * precision * precision
    J, along, w_e, w_u = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(3):  # column k: w x u for the root's axis w in the world
        w = placement[3 * k : 3 * k + 3]
        J[0, k] = w[1] * u[2] - w[2] * u[1]
        J[1, k] = w[2] * u[0] - w[0] * u[2]
        J[2, k] = w[0] * u[1] - w[1] * u[0]
        for i in range(3):
            along[k] += J[i, k] * e[i]
            w_e[k] += w[i] * e[i]
            w_u[k] += w[i] * u[i]
        gradient[3 + k] += pull * along[k]
    e_u = e[0] * u[0] + e[1] * u[1] + e[2] * u[2]
    for a in range(3):
        for b in range(3):
            for i in range(3):
                hessian[3 + a, 3 + b] += pull * J[i, a] * J[i, b]
            if exact:  # d2 u = w_a (w_b . u) - u (w_a . w_b), the symmetric half
                second = 0.5 * (w_e[a] * w_u[b] + w_u[a] * w_e[b]) - (e_u if a == b else 0.0)
                hessian[3 + a, 3 + b] += pull * second + curve * along[a] * along[b]
    return 0.5 * weight * cost


@jit
def tilt_values(placements, axis, up, precision, weight, kind, nu, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `tilt` for placements (N, njoints, 12)."""
    u, e = np.empty(3), np.empty(3)
    for n in range(placements.shape[0]):
        u[:] = 0.0
        s = _lean(placements[n, ROOT_JOINT], axis, up, u, e)
        values[n] = 0.5 * weight * rho(kind, s * precision, nu)[0]


@jit
def _lean(placement, axis, up, u, e):  # type: ignore[no-untyped-def]
    """Squared length of e = u - up with u = R axis, R of a placement (12,); axis, up (3,). Adds to u (3,), fills
    e (3,)."""
    for i in range(3):
        for k in range(3):
            u[i] += placement[3 * k + i] * axis[k]
        e[i] = u[i] - up[i]
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2]


def tilt_record(axis: np.ndarray, up: np.ndarray, precision: float, weight: float, kind: int, nu: float) -> Record:
    """The term, see `tilt`."""
    return record_of(TILT, [kind], [axis, up, precision, weight, nu])


@jit
def recorded_tilt(integers, numbers, placements, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """`tilt` of a record's integers (I,) and numbers (F,), at placements (njoints, 12)."""
    axis, up, precision, weight, nu = numbers[:3], numbers[3:6], numbers[6], numbers[7], numbers[8]
    return tilt(placements[ROOT_JOINT], axis, up, precision, weight, integers[0], nu, exact, gradient, hessian)
