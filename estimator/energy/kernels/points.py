"""Forces on points of the body, gathered into gradient and Hessian: see `estimator.energy.points`."""

from __future__ import annotations

import numpy as np

from humanoid.support.compiled import jit


@jit
def to_world(placement, local, point):  # type: ignore[no-untyped-def]
    """Fill `point` (3,) with the place in the world of `local` (3,) in the frame of a joint's placement (12,)."""
    M, x = placement, local
    for k in range(3):
        point[k] = M[9 + k] + M[k] * x[0] + M[3 + k] * x[1] + M[6 + k] * x[2]


@jit
def turn(placement, local, direction):  # type: ignore[no-untyped-def]
    """`to_world` of a direction (3,)."""
    for k in range(3):
        direction[k] = placement[k] * local[0] + placement[3 + k] * local[1] + placement[6 + k] * local[2]


@jit
def accumulate_loads(  # type: ignore[no-untyped-def]
    J, joint_parent, dof_joint, dof_parent, joints, points, force, weight, gradient, hessian, exact
):
    """See `accumulate_points`; J (nv, 6), joint_parent (njoints,), dof_joint, dof_parent (nv,) as in `Tree`; joints
    (N,), points, force (N, 3), weight (N, 3, 3) as in `LoadedPoints`."""
    njoints = joint_parent.shape[0]
    joint_force = np.zeros((njoints, 6))
    joint_load = np.zeros((njoints, 6, 6))
    moment = np.zeros((njoints, 3, 3))
    load_joints(joints, points, force, weight, exact, joint_force, joint_load, moment)
    gather(J, joint_parent, dof_joint, dof_parent, joint_force, joint_load, gradient, hessian)
    if exact:
        bend(J, joint_parent, dof_joint, dof_parent, joint_force, moment, hessian)


@jit
def load_joints(joints, points, force, weight, exact, joint_force, joint_load, moment):  # type: ignore[no-untyped-def]
    """Add B'f and B'WB of every point to its joint, B = [I, -[p]x] taking a spatial velocity to the point's.

    joints (N,), points (N, 3) [m], force (N, 3) and weight (N, 3, 3) as in `LoadedPoints`. Adds to joint_force
    (njoints, 6) and the upper triangles of joint_load (njoints, 6, 6), and with `exact` p f' to moment (njoints, 3, 3).
    """
    for n in range(joints.shape[0]):
        p, f, W = points[n], force[n], weight[n]
        F, A = joint_force[joints[n]], joint_load[joints[n]]
        x, y, z = p[0], p[1], p[2]
        F[0] += f[0]
        F[1] += f[1]
        F[2] += f[2]
        F[3] += y * f[2] - z * f[1]
        F[4] += z * f[0] - x * f[2]
        F[5] += x * f[1] - y * f[0]
        # W B: the angular part of a row w is p x w; then B' (W B) in the same way, its upper triangle alone
        a, b, c, d, e, g = W[0, 0], W[0, 1], W[0, 2], W[1, 1], W[1, 2], W[2, 2]
        a3, a4, a5 = y * c - z * b, z * a - x * c, x * b - y * a
        d3, d4, d5 = y * e - z * d, z * b - x * e, x * d - y * b
        g3, g4, g5 = y * g - z * e, z * c - x * g, x * e - y * c
        row = A[0]
        row[0] += a
        row[1] += b
        row[2] += c
        row[3] += a3
        row[4] += a4
        row[5] += a5
        row = A[1]
        row[1] += d
        row[2] += e
        row[3] += d3
        row[4] += d4
        row[5] += d5
        row = A[2]
        row[2] += g
        row[3] += g3
        row[4] += g4
        row[5] += g5
        row = A[3]
        row[3] += y * g3 - z * d3
        row[4] += y * g4 - z * d4
        row[5] += y * g5 - z * d5
        A[4, 4] += z * a4 - x * g4
        A[4, 5] += z * a5 - x * g5
        A[5, 5] += x * d5 - y * a5
        if exact:
            M = moment[joints[n]]
            for i in range(3):
                for k in range(3):
                    M[i, k] += p[i] * f[k]


@jit
def gather(J, joint_parent, dof_joint, dof_parent, force, load, gradient, hessian):  # type: ignore[no-untyped-def]
    """Joint loads to gradient and Hessian: sums go up the tree first, as in the composite rigid body algorithm.

    J (nv, 6), joint_parent (njoints,), dof_joint, dof_parent (nv,): see `accumulate_loads`. Adds sum_j J_j' force_j to
    gradient (nv,) and sum_j J_j' load_j J_j to hessian (nv, nv) in O(nv depth). Overwrites load (njoints, 6, 6), of
    which the upper triangles count, and force (njoints, 6) with their sums over subtrees.
    """
    for j in range(joint_parent.shape[0] - 1, 0, -1):
        parent = joint_parent[j]
        for i in range(6):
            force[parent, i] += force[j, i]
            for k in range(i, 6):
                load[parent, i, k] += load[j, i, k]
            for k in range(i):
                load[j, i, k] = load[j, k, i]
    moved = np.zeros(6)
    for d in range(dof_joint.shape[0]):
        j = dof_joint[d]
        for i in range(6):
            gradient[d] += force[j, i] * J[d, i]
            s = 0.0
            for k in range(6):
                s += load[j, i, k] * J[d, k]
            moved[i] = s
        k = d
        while k >= 0:
            s = 0.0
            for i in range(6):
                s += J[k, i] * moved[i]
            hessian[d, k] += s
            if k != d:
                hessian[k, d] += s
            k = dof_parent[k]


@jit
def bend(J, joint_parent, dof_joint, dof_parent, force, moment, hessian):  # type: ignore[no-untyped-def]
    """Add the curvature of the kinematics: sum over points of f . d2p / dq_i dq_j.

    J (nv, 6), joint_parent (njoints,), dof_joint, dof_parent (nv,): see `accumulate_loads`. force (njoints, 6), moment
    (njoints, 3, 3); adds to hessian (nv, nv).

    For i at or above j in the tree, d/dq_i carries the whole velocity field of j along: d2p = w_i x (v_j + w_j x p),
    so that the sum over points needs only F = sum f (`force`, already summed over subtrees by `gather`) and
    sum p f' (`moment`, summed here). Within one joint the exponential map makes it the symmetric half.
    """
    for j in range(joint_parent.shape[0] - 1, 0, -1):
        for i in range(3):
            for k in range(3):
                moment[joint_parent[j], i, k] += moment[j, i, k]
    turned = np.zeros(3)
    for d in range(dof_joint.shape[0]):
        j = dof_joint[d]
        v, w = J[d, :3], J[d, 3:]
        F, P = force[j, :3], moment[j]
        trace = P[0, 0] + P[1, 1] + P[2, 2]
        for i in range(3):
            turned[i] = P[i, 0] * w[0] + P[i, 1] * w[1] + P[i, 2] * w[2] - trace * w[i]
        turned[0] += v[1] * F[2] - v[2] * F[1]
        turned[1] += v[2] * F[0] - v[0] * F[2]
        turned[2] += v[0] * F[1] - v[1] * F[0]
        k = d
        while k >= 0:
            s = J[k, 3] * turned[0] + J[k, 4] * turned[1] + J[k, 5] * turned[2]
            if k == d:
                hessian[d, d] += s
            elif dof_joint[k] == j:  # each order of the pair gives half
                hessian[d, k] += 0.5 * s
                hessian[k, d] += 0.5 * s
            else:
                hessian[d, k] += s
                hessian[k, d] += s
            k = dof_parent[k]
        k = d + 1
        while k < dof_joint.shape[0] and dof_joint[k] == j:
            s = 0.5 * (J[k, 3] * turned[0] + J[k, 4] * turned[1] + J[k, 5] * turned[2])
            hessian[d, k] += s
            hessian[k, d] += s
            k += 1
