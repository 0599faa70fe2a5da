"""Compiled kernel of the diffusion from a previous configuration."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.records import TRANSITION, Record, record_of
from estimator.numerics.robust import robust_square, robust_sum
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
