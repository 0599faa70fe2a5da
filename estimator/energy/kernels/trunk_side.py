"""Compiled kernels of the side to which a trunk leads."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.points import to_world
from estimator.energy.kernels.records import TRUNK, Record, record_of
from estimator.numerics.vectors import cross, dot
from humanoid.support.compiled import jit


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
