"""Compiled kernels of the balance of the centre of mass over the feet."""

from __future__ import annotations

import math

import numpy as np

from estimator.energy.kernels.points import to_world
from estimator.energy.kernels.records import BALANCE, Record, record_of
from humanoid.support.compiled import jit


@jit
def offset_of(placements, joint, local, mass_joint, mass_local, share, axes, around, offset):  # type: ignore[no-untyped-def]
    """Fill offset (2,) [m] from the middle of the support to the centre of mass, along the axes (2, 3), and around
    (P, 2) [m] from there to the support's points (joint (P,), local (P, 3)).

    placements (njoints, 12); mass_joint (M,), mass_local (M, 3), share (M,): see `Balance`.
    """
    count = joint.shape[0]
    x, middle = np.empty(3), np.zeros(2)
    offset[:] = 0.0
    for m in range(share.shape[0]):
        to_world(placements[mass_joint[m]], mass_local[m], x)
        for a in range(2):
            offset[a] += share[m] * (axes[a, 0] * x[0] + axes[a, 1] * x[1] + axes[a, 2] * x[2])
    for n in range(count):
        to_world(placements[joint[n]], local[n], x)
        for a in range(2):
            around[n, a] = axes[a, 0] * x[0] + axes[a, 1] * x[1] + axes[a, 2] * x[2]
            middle[a] += around[n, a] / count
    for a in range(2):
        offset[a] -= middle[a]
        for n in range(count):
            around[n, a] -= middle[a]


@jit
def whitened(around, offset, shape, pull, precision):  # type: ignore[no-untyped-def]
    """x of `Balance` for an offset (2,) and the support's points `around` (P, 2) their middle; fills pull (2,), C^-1 r,
    and precision (2, 2), C^-1. shape (5,): spread^2, width^2, tail, odds of being held, weight."""
    count = around.shape[0]
    a, b, c = shape[1], 0.0, shape[1]
    for n in range(count):
        a += shape[0] * around[n, 0] * around[n, 0] / count
        b += shape[0] * around[n, 0] * around[n, 1] / count
        c += shape[0] * around[n, 1] * around[n, 1] / count
    det = a * c - b * b
    precision[0, 0], precision[1, 1] = c / det, a / det
    precision[0, 1] = precision[1, 0] = -b / det
    for i in range(2):
        pull[i] = precision[i, 0] * offset[0] + precision[i, 1] * offset[1]
    return pull[0] * offset[0] + pull[1] * offset[1]


@jit
def _potential(x, shape):  # type: ignore[no-untyped-def]
    """Value and derivative by x; shape (5,): see `whitened`."""
    _, _, tail, odds, weight = shape
    near, far = math.exp(-0.5 * x), 1.0 / (1.0 + x / tail)
    density = near + odds * far * far
    slope = (0.5 * near + 2.0 * odds * far * far * far / tail) / density
    return -weight * math.log(density / (1.0 + odds)), weight * slope


@jit
def add_balance(  # type: ignore[no-untyped-def]
    placements, J, joint_parent, dof_joint, joint, local, mass_joint, mass_local, share, axes, shape, gradient, hessian
):
    """Value of `Balance`; adds its derivatives to gradient (nv,) and hessian (nv, nv).

    J (nv, 6), joint_parent (njoints,), dof_joint (nv,): see `estimator.energy.points`; shape (5,): see `whitened`. The
    others: see `offset_of`. As x is r' C^-1 r and C a sum over the support's points, dx is 2 (C^-1 r)' of a weighted
    sum of all points, whose weights and moments are summed over subtrees.
    """
    count, njoints = joint.shape[0], joint_parent.shape[0]
    around, offset, pull, precision = np.empty((count, 2)), np.empty(2), np.empty(2), np.empty((2, 2))
    offset_of(placements, joint, local, mass_joint, mass_local, share, axes, around, offset)
    value, slope = _potential(whitened(around, offset, shape, pull, precision), shape)
    weight, moment, x = np.zeros(njoints), np.zeros((njoints, 3)), np.empty(3)
    for m in range(share.shape[0]):
        to_world(placements[mass_joint[m]], mass_local[m], x)
        weight[mass_joint[m]] += share[m]
        for i in range(3):
            moment[mass_joint[m], i] += share[m] * x[i]
    for n in range(count):
        to_world(placements[joint[n]], local[n], x)
        w = (1.0 + shape[0] * (pull[0] * around[n, 0] + pull[1] * around[n, 1])) / count
        weight[joint[n]] -= w
        for i in range(3):
            moment[joint[n], i] -= w * x[i]
    for j in range(njoints - 1, 0, -1):
        weight[joint_parent[j]] += weight[j]
        for i in range(3):
            moment[joint_parent[j], i] += moment[j, i]
    rows = np.empty((2, dof_joint.shape[0]))
    for d in range(dof_joint.shape[0]):
        w, q = weight[dof_joint[d]], moment[dof_joint[d]]
        x[0] = w * J[d, 0] + J[d, 4] * q[2] - J[d, 5] * q[1]
        x[1] = w * J[d, 1] + J[d, 5] * q[0] - J[d, 3] * q[2]
        x[2] = w * J[d, 2] + J[d, 3] * q[1] - J[d, 4] * q[0]
        for a in range(2):
            rows[a, d] = axes[a, 0] * x[0] + axes[a, 1] * x[1] + axes[a, 2] * x[2]
        gradient[d] += 2.0 * slope * (pull[0] * rows[0, d] + pull[1] * rows[1, d])
    for d in range(dof_joint.shape[0]):
        first = 2.0 * slope * (precision[0, 0] * rows[0, d] + precision[0, 1] * rows[1, d])
        second = 2.0 * slope * (precision[1, 0] * rows[0, d] + precision[1, 1] * rows[1, d])
        row = hessian[d]
        for k in range(dof_joint.shape[0]):
            row[k] += first * rows[0, k] + second * rows[1, k]
    return value


@jit
def balance_values(placements, joint, local, mass_joint, mass_local, share, axes, shape, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `add_balance` for placements (N, njoints, 12)."""
    around, offset, pull, precision = np.empty((joint.shape[0], 2)), np.empty(2), np.empty(2), np.empty((2, 2))
    for s in range(placements.shape[0]):
        offset_of(placements[s], joint, local, mass_joint, mass_local, share, axes, around, offset)
        values[s] = _potential(whitened(around, offset, shape, pull, precision), shape)[0]


def balance_record(
    joint: np.ndarray, local: np.ndarray, mass_joint: np.ndarray, mass_local: np.ndarray, share: np.ndarray,
    axes: np.ndarray, shape: np.ndarray,
) -> Record:  # fmt: skip
    """The term, see `add_balance`."""
    return record_of(BALANCE, [len(joint), len(share), joint, mass_joint], [local, mass_local, share, axes, shape])


@jit
def recorded_balance(  # type: ignore[no-untyped-def]
    integers, numbers, placements, J, joint_parent, dof_joint, gradient, hessian
):
    """`add_balance` of a record's integers (I,) and numbers (F,)."""
    P, M = integers[0], integers[1]
    joint, mass_joint = integers[2 : 2 + P], integers[2 + P : 2 + P + M]
    local, mass_local = numbers[: 3 * P].reshape(P, 3), numbers[3 * P : 3 * (P + M)].reshape(M, 3)
    o = 3 * (P + M)
    share, axes, shape = numbers[o : o + M], numbers[o + M : o + M + 6].reshape(2, 3), numbers[o + M + 6 : o + M + 11]
    return add_balance(
        placements, J, joint_parent, dof_joint, joint, local, mass_joint, mass_local, share, axes, shape, gradient,
        hessian,
    )  # fmt: skip
