"""Compiled kernels of the level feet."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.points import turn
from estimator.energy.kernels.records import SOLES, Record, record_of
from estimator.numerics.robust import LORENTZIAN, rho
from estimator.numerics.vectors import cross, dot
from humanoid.support.compiled import jit

_NU = 4.0  # squared standard deviations from which a floor is no longer level, or a heel raised


@jit
def load_soles(  # type: ignore[no-untyped-def]
    placements, J, dof_joint, dof_parent, joint, along, rise, up, precision, weight, exact, gradient, hessian
):
    """Value of S soles; adds their derivatives to gradient (nv,) and hessian (nv, nv).

    placements (njoints, 12). J (nv, 6), dof_joint, dof_parent (nv,): see `estimator.energy.points`. joint (S,), along
    (S, 3), rise, precision, weight (S,), up (3,): see `LevelFeet`.
    """
    value = 0.0
    d = np.empty(3)
    for n in range(joint.shape[0]):
        climb = _climb(placements[joint[n]], along[n], up, d)
        e = climb - rise[n]
        cost, slope, bending = rho(LORENTZIAN, e * e * precision[n], _NU)
        value += 0.5 * weight[n] * cost
        stiff = weight[n] * slope * precision[n]
        pull = stiff * e
        if exact:
            stiff += 2.0 * weight[n] * bending * precision[n] * precision[n] * e * e
        m = cross(d, up)  # only turns w move d: de = up . (w x d) = w . m
        i = dof_joint.shape[0] - 1
        while dof_joint[i] != joint[n]:
            i -= 1
        while i >= 0:
            w = J[i, 3:]
            gradient[i] += pull * dot(w, m)
            k = i
            while k >= 0:
                v = J[k, 3:]
                s = stiff * dot(w, m) * dot(v, m)
                if exact:  # up . (v x (w x d)), v being above w; within one joint the symmetric half
                    bent = dot(up, w) * dot(v, d)
                    if dof_joint[k] == dof_joint[i]:
                        bent = 0.5 * (bent + dot(up, v) * dot(w, d))
                    s += pull * (bent - climb * dot(v, w))
                hessian[i, k] += s
                if k != i:
                    hessian[k, i] += s
                k = dof_parent[k]
            i = dof_parent[i]
    return value


@jit
def sole_values(placements, joint, along, rise, up, precision, weight, values):  # type: ignore[no-untyped-def]
    """Fill values (N,) with those of `load_soles` for placements (N, njoints, 12)."""
    d = np.empty(3)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(joint.shape[0]):
            e = _climb(placements[s, joint[n]], along[n], up, d) - rise[n]
            value += 0.5 * weight[n] * rho(LORENTZIAN, e * e * precision[n], _NU)[0]
        values[s] = value


@jit
def _climb(placement, along, up, d):  # type: ignore[no-untyped-def]
    """up . d, up (3,); fills d (3,), a sole in the world."""
    turn(placement, along, d)
    return dot(up, d)


def sole_record(
    joint: np.ndarray, along: np.ndarray, rise: np.ndarray, up: np.ndarray, precision: np.ndarray, weight: np.ndarray
) -> Record:
    """The term, see `load_soles`."""
    return record_of(SOLES, [len(joint), joint], [along, rise, up, precision, weight])


@jit
def recorded_soles(  # type: ignore[no-untyped-def]
    integers, numbers, placements, J, dof_joint, dof_parent, exact, gradient, hessian
):
    """`load_soles` of a record's integers (I,) and numbers (F,)."""
    S = integers[0]
    along, rise, up = numbers[: 3 * S].reshape(S, 3), numbers[3 * S : 4 * S], numbers[4 * S : 4 * S + 3]
    precision, weight = numbers[4 * S + 3 : 5 * S + 3], numbers[5 * S + 3 : 6 * S + 3]
    joint = integers[1 : 1 + S]
    return load_soles(
        placements, J, dof_joint, dof_parent, joint, along, rise, up, precision, weight, exact, gradient, hessian
    )
