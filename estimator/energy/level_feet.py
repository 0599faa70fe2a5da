"""Feet that stand with heel and toes are level, as floors are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.energy.points import add_by_column, turn
from estimator.energy.standing import LEAST
from estimator.energy.term import BatchTerm
from estimator.numerics.robust import LORENTZIAN, rho
from estimator.numerics.vectors import cross, dot
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit
from humanoid.support.per_object import per_object

_NU = 4.0  # squared standard deviations from which a floor is no longer level, or a heel raised


class Soles(NamedTuple):
    """From heel to toes of each foot.

    heel, toe (S,): landmarks. joint (S,): that moves both. along (S, 3): from one to the other in its frame [m]. rise
    (S,): how much higher the toes are where all joints are at zero [m].
    """

    heel: np.ndarray
    toe: np.ndarray
    joint: np.ndarray
    along: np.ndarray
    rise: np.ndarray

    @staticmethod
    @per_object
    def of(body: Body) -> Soles:
        """Of the feet whose first toe is on the heel's joint; none where nothing says which way the body is upright."""
        upright, names, joint = body.subject.upright, body.landmark_names, body.landmark_joint
        toes = [(i, [j for j, n in enumerate(names) if n.endswith("toe") and joint[j] == joint[i]])
                for i, name in enumerate(names) if name.endswith("heel") and upright is not None]  # fmt: skip
        heel, toe = np.array([(i, some[0]) for i, some in toes if some], np.int64).reshape(-1, 2).T
        at_zero = body.landmarks(body.at(pin.neutral(body.model)))
        up = np.zeros(3) if upright is None else np.array(upright.axis)
        along = body.landmark_local[toe] - body.landmark_local[heel]
        return Soles(heel, toe, joint[heel], along, (at_zero[toe] - at_zero[heel]) @ up)


class LevelFeet(BatchTerm):
    """1/2 sum weight rho((up . d - rise)^2 / (std |d|)^2) over soles d, from heel to toes in the world.

    weight (S,): of each, none of those that weigh less than `LEAST`. up (3,): unit vector in the world. std [rad]: of
    how level a foot is, and of what is taken for up.

    One object serves one thread: it reuses buffers.
    """

    name = "level feet"

    def __init__(self, body: Body, soles: Soles, weight: np.ndarray, up: np.ndarray, std: float) -> None:
        some = np.flatnonzero(weight >= LEAST)
        along = np.ascontiguousarray(soles.along[some])
        precision = 1.0 / np.square(std * np.linalg.norm(along, axis=1))
        self._body = body
        self._soles = (soles.joint[some], along, soles.rise[some], np.asarray(up, float), precision, weight[some])

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value, tree = 0.0, self._body.tree

        def add(gradient: np.ndarray, hessian: np.ndarray) -> None:
            nonlocal value
            value = load_soles(
                posed.placements, posed.spatial_jacobian, tree.column_joint, tree.column_parent, *self._soles, exact,
                gradient, hessian,
            )  # fmt: skip

        add_by_column(self._body, gradient, hessian, add)
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        sole_values(placed.placements, *self._soles, values)
        return values


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
