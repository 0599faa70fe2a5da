"""Compiled kernels of the points drawn to places in the world."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.points import load_joints, to_world
from estimator.energy.kernels.records import TARGETS, Record, record_of
from estimator.numerics.robust import rho
from humanoid.support.compiled import jit


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


def target_record(
    joints: np.ndarray, local: np.ndarray, target: np.ndarray, precision: np.ndarray, weight: np.ndarray, kind: int,
    nu: float,
) -> Record:  # fmt: skip
    """The term, see `target_loads`."""
    return record_of(TARGETS, [len(joints), kind, joints], [nu, local, target, precision, weight])


def record_with_targets(record: Record, target: np.ndarray) -> Record:
    """The same term with other targets (N, 3)."""
    numbers = record.numbers.copy()
    numbers[1 + target.size : 1 + 2 * target.size] = target.ravel()
    return record._replace(numbers=numbers)


@jit
def load_targets(integers, numbers, placements, exact, joint_force, joint_load, moment):  # type: ignore[no-untyped-def]
    """As `load_keypoints`: of a record's integers (I,) and numbers (F,)."""
    N, kind, joints = integers[0], integers[1], integers[2 : 2 + integers[0]]
    nu, local = numbers[0], numbers[1 : 1 + 3 * N].reshape(N, 3)
    target, o = numbers[1 + 3 * N : 1 + 6 * N].reshape(N, 3), 1 + 6 * N
    precision, weight = numbers[o : o + 9 * N].reshape(N, 3, 3), numbers[o + 9 * N : o + 10 * N]
    points, force, load = np.empty((N, 3)), np.empty((N, 3)), np.empty((N, 3, 3))
    value = target_loads(
        placements, joints, local, target, precision, weight, kind, nu, exact, points, force, load
    )  # fmt: skip
    load_joints(joints, points, force, load, exact, joint_force, joint_load, moment)
    return value
