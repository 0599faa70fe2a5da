"""Compiled kernels of the parts below a floor."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.records import FLOOR, Record, record_of
from estimator.numerics.robust import rho
from estimator.numerics.vectors import cross, dot
from humanoid.collision.floor import RoundPieces, lowest_point
from humanoid.support.compiled import jit


@jit
def raise_pieces(  # type: ignore[no-untyped-def]
    placements, J, column_parent, joint, column, centre, half_axes, normal, height, precision, kind, nu, exact,
    gradient, hessian,
):  # fmt: skip
    """Value of P pieces; adds the derivatives of those below the floor to gradient (nc,) and hessian (nc, nc).

    placements (njoints, 12). J (nc, 6), column_parent (nc,): see `estimator.energy.points`. joint, column (P,), centre
    (P, 3), half_axes (P, 3, 3): see `RoundPieces`. normal (3,), height: of the floor.
    """
    value = 0.0
    point = np.empty(3)
    for n in range(joint.shape[0]):
        d = lowest_point(placements[joint[n]], centre[n], half_axes[n], normal, point) - height
        if d >= 0.0:
            continue
        cost, slope, bend = rho(kind, d * d * precision, nu)
        value += 0.5 * cost
        pull = slope * precision * d
        stiff = precision * (slope + 2.0 * bend * d * d * precision if exact else slope)
        moment = cross(point, normal)  # normal . (v + w x point)
        i = column[n]
        while i >= 0:
            along = dot(normal, J[i]) + dot(moment, J[i, 3:])
            gradient[i] += pull * along
            k = i
            while k >= 0:
                s = stiff * along * (dot(normal, J[k]) + dot(moment, J[k, 3:]))
                hessian[i, k] += s
                if k != i:
                    hessian[k, i] += s
                k = column_parent[k]
            i = column_parent[i]
    return value


@jit
def floor_values(  # type: ignore[no-untyped-def]
    placements, joint, centre, half_axes, normal, height, precision, kind, nu, values
):
    """Fill values (N,) with those of `raise_pieces` for placements (N, njoints, 12)."""
    point = np.empty(3)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(joint.shape[0]):
            d = lowest_point(placements[s, joint[n]], centre[n], half_axes[n], normal, point) - height
            if d < 0.0:
                value += 0.5 * rho(kind, d * d * precision, nu)[0]
        values[s] = value


def floor_record(
    pieces: RoundPieces, normal: np.ndarray, height: float, precision: float, kind: int, nu: float
) -> Record:
    """The term, see `raise_pieces`."""
    joint, column, centre, half_axes = pieces
    return record_of(FLOOR, [len(joint), kind, joint, column], [height, precision, nu, normal, centre, half_axes])


@jit
def recorded_floor(integers, numbers, placements, J, column_parent, exact, gradient, hessian):  # type: ignore[no-untyped-def]
    """`raise_pieces` of a record's integers (I,) and numbers (F,)."""
    P, kind, joint, column = integers[0], integers[1], integers[2:], integers[2 + integers[0] :]
    height, precision, nu, normal = numbers[0], numbers[1], numbers[2], numbers[3:6]
    centre, half_axes = numbers[6 : 6 + 3 * P].reshape(P, 3), numbers[6 + 3 * P : 6 + 12 * P].reshape(P, 3, 3)
    return raise_pieces(
        placements, J, column_parent, joint[:P], column[:P], centre, half_axes, normal, height, precision, kind, nu,
        exact, gradient, hessian,
    )  # fmt: skip
