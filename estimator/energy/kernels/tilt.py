"""Compiled kernels of the root's tilt."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.records import TILT, Record, record_of
from estimator.numerics.robust import rho
from humanoid.kinematics.body import ROOT_JOINT
from humanoid.support.compiled import jit


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
