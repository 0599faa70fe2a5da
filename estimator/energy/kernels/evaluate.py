"""The sum of recorded terms at a posed body, in one call."""

from __future__ import annotations

import numpy as np

from estimator.energy.kernels.balance import recorded_balance
from estimator.energy.kernels.keypoints import load_keypoints
from estimator.energy.kernels.mixture import recorded_mixture
from estimator.energy.kernels.points import bend, gather
from estimator.energy.kernels.priors import recorded_stabilisers, recorded_tilt, recorded_transition, recorded_trunk
from estimator.energy.kernels.records import (
    BALANCE,
    FLOOR,
    KEYPOINTS,
    MIXTURE,
    SOLES,
    STABILISERS,
    TARGETS,
    TILT,
    TRANSITION,
    TRUNK,
)
from estimator.energy.kernels.repulsion import recorded_floor, recorded_repulsion
from estimator.energy.kernels.soles import recorded_soles
from estimator.energy.kernels.targets import load_targets
from humanoid.support.compiled import jit


@jit
def evaluate(  # type: ignore[no-untyped-def]
    own_starts, own_integers, own_numbers, kept_starts, kept_integers, kept_numbers, joint_parent, column_joint,
    column_parent, placements, J, q, exact, gradient, hessian, column_gradient, column_hessian,
):  # fmt: skip
    """Value of two rows of records at q (nq,), and how many of the last ones were left out, see `recorded_repulsion`.

    own_, kept_: `Records`, starts (N, 3), integers (I,), numbers (F,). joint_parent (njoints,), column_joint,
    column_parent (nc,): see `humanoid.kinematics.body.Tree`. placements (njoints, 12), J (nc, 6): see `PosedBody`.
    Adds to gradient (nv,), hessian (nv, nv), and what moves by columns of the Jacobian to column_gradient (nc,),
    column_hessian (nc, nc): the same arrays where no joint follows another. Points of all terms are gathered at once.
    """
    njoints = joint_parent.shape[0]
    force, load, moment = np.zeros((njoints, 6)), np.zeros((njoints, 6, 6)), np.zeros((njoints, 3, 3))
    value, left, loaded = 0.0, 0, False
    for row in range(2):
        starts = own_starts if row == 0 else kept_starts
        integers = own_integers if row == 0 else kept_integers
        numbers = own_numbers if row == 0 else kept_numbers
        for n in range(starts.shape[0]):
            kind, ints, reals = starts[n, 0], integers[starts[n, 1] :], numbers[starts[n, 2] :]
            if kind == KEYPOINTS:
                value += load_keypoints(ints, reals, placements, exact, force, load, moment)
                loaded = True
            elif kind == TARGETS:
                value += load_targets(ints, reals, placements, exact, force, load, moment)
                loaded = True
            elif kind == SOLES:
                value += recorded_soles(
                    ints, reals, placements, J, column_joint, column_parent, exact, column_gradient, column_hessian
                )
            elif kind == TILT:
                value += recorded_tilt(ints, reals, placements, exact, gradient, hessian)
            elif kind == STABILISERS:
                value += recorded_stabilisers(ints, reals, q, exact, gradient, hessian)
            elif kind == MIXTURE:
                value += recorded_mixture(ints, reals, q, exact, gradient, hessian)
            elif kind == TRANSITION:
                value += recorded_transition(ints, reals, q, exact, gradient, hessian)
            elif kind == BALANCE:
                value += recorded_balance(
                    ints, reals, placements, J, joint_parent, column_joint, column_gradient, column_hessian
                )
            elif kind == FLOOR:
                value += recorded_floor(
                    ints, reals, placements, J, column_parent, exact, column_gradient, column_hessian
                )
            elif kind == TRUNK:
                value += recorded_trunk(ints, reals, placements, J, column_parent, column_gradient, column_hessian)
            else:
                repelled, done = recorded_repulsion(
                    ints, reals, placements, J, column_joint, column_parent, exact, column_gradient, column_hessian
                )
                value += repelled
                left += 0 if done else 1
    if loaded:
        gather(J, joint_parent, column_joint, column_parent, force, load, column_gradient, column_hessian)
        if exact:
            bend(J, joint_parent, column_joint, column_parent, force, moment, column_hessian)
    return value, left
