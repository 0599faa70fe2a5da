"""Kinematics as compiled kernels, for loops that are compiled as a whole: the same as Pinocchio's, to rounding.

Pinocchio reads the model and stays what every other caller uses. A loop that evaluates a body a hundred times cannot
leave compiled code for each: `compiled_tree` gives it the joints as plain arrays, read from `pin.Model`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.support.compiled import jit

FREE, REVOLUTE, PRISMATIC = 0, 1, 2  # kinds of joints
_REVOLUTE = "JointModelRX", "JointModelRY", "JointModelRZ", "JointModelRevoluteUnaligned"
_PRISMATIC = "JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismaticUnaligned"
_SMALL_TURN = 1e-4  # rad; below it sines are replaced by their series
ON_LIMIT = 1e-12  # rad or m
# |B_2n| / (2n)! of the Bernoulli numbers: 1 - x/2 cot(x/2) is their sum over x^2n, to rounding for x up to 1
_COTANGENT = (
    1.0 / 12.0, 1.0 / 720.0, 1.0 / 30240.0, 1.0 / 1209600.0, 1.0 / 47900160.0, 691.0 / 1307674368000.0,
    1.0 / 74724249600.0, 3617.0 / 10670622842880000.0, 43867.0 / 5109094217170944000.0,
)  # fmt: skip


class CompiledTree(NamedTuple):
    """The joints of a model as plain arrays, the universe being joint 0.

    parent, kind, q_index, v_index (njoints,): parent joint, kind, and where the joint begins in q and in the tangent.
    offset (njoints, 12): placement of the joint in its parent's frame, laid out as `PosedBody.placements`.
    turned (njoints, 27): rotation of the joint in its parent's frame by its angle: three 3x3 matrices, column by
        column, of which the rotation is the first plus cosine times the second plus sine times the third (Rodrigues).
    axis (njoints, 3): axis of the joint in its parent's frame.
    bounded_q (B,), lower, upper (nq,): joints with limits, see `Body`.
    """

    parent: np.ndarray
    kind: np.ndarray
    q_index: np.ndarray
    v_index: np.ndarray
    offset: np.ndarray
    turned: np.ndarray
    axis: np.ndarray
    bounded_q: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def indices(self) -> np.ndarray:
        """Kind and places of every joint but the universe, (njoints - 1, 3), see `difference`."""
        return np.stack((self.kind, self.q_index, self.v_index), axis=1)[1:]


def compiled_tree(model: pin.Model, bounded_q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> CompiledTree | None:
    """The joints of a model; None where one is neither free nor revolute nor prismatic, or follows another.

    bounded_q (B,), lower, upper (nq,): see `Body`.
    """
    if model.nvExtended != model.nv:
        return None
    count = model.njoints
    kind = np.zeros(count, dtype=np.int64)
    offset, turned, axis = np.zeros((count, 12)), np.zeros((count, 27)), np.zeros((count, 3))
    for j in range(1, count):
        found_kind = _kind(model.joints[j])
        if found_kind is None:
            return None
        kind[j], T = found_kind, model.jointPlacements[j]
        rotation = np.array(T.rotation)
        offset[j] = np.concatenate([rotation.T.ravel(), T.translation])
        if found_kind == FREE:
            continue
        data = model.joints[j].createData()
        model.joints[j].calc(data, pin.neutral(model))
        u = np.array(data.S).ravel()[:3] if found_kind == PRISMATIC else np.array(data.S).ravel()[3:]
        axis[j] = rotation @ u
        along, across = np.outer(u, u), pin.skew(u)
        turned[j] = np.concatenate([(rotation @ m).T.ravel() for m in (along, np.eye(3) - along, across)])
    parent, q_index, v_index = (
        np.array(list(index), dtype=np.int64) for index in (model.parents, model.idx_qs, model.idx_vs)
    )
    return CompiledTree(parent, kind, q_index, v_index, offset, turned, axis, bounded_q, lower, upper)


def _kind(joint: pin.JointModel) -> int | None:
    name = joint.shortname()
    if name == "JointModelFreeFlyer":
        return FREE
    if name in _REVOLUTE:
        return REVOLUTE
    return PRISMATIC if name in _PRISMATIC else None


@jit
def place_joints(tree, q, placements, columns):  # type: ignore[no-untyped-def]
    """Fill placements (njoints, 12) and columns (nv, 6), the spatial Jacobian, at q (nq,), as `PosedBody` has them."""
    P = placements
    for k in range(12):
        P[0, k] = 1.0 if k in (0, 4, 8) else 0.0
    for j in range(1, tree.parent.shape[0]):
        A, B, C = P[tree.parent[j]], tree.offset[j], P[j]
        i, v = tree.q_index[j], tree.v_index[j]
        for r in range(3):
            C[9 + r] = A[r] * B[9] + A[3 + r] * B[10] + A[6 + r] * B[11] + A[9 + r]
        if tree.kind[j] == REVOLUTE:
            _turn(A, tree.turned[j], math.cos(q[i]), math.sin(q[i]), C)
            u, J = tree.axis[j], columns[v]
            for r in range(3):
                J[3 + r] = A[r] * u[0] + A[3 + r] * u[1] + A[6 + r] * u[2]
            _moment(C, J)
            continue
        for c in range(3):
            for r in range(3):
                C[3 * c + r] = A[r] * B[3 * c] + A[3 + r] * B[3 * c + 1] + A[6 + r] * B[3 * c + 2]
        if tree.kind[j] == PRISMATIC:
            u, J = tree.axis[j], columns[v]
            for r in range(3):
                J[r], J[3 + r] = A[r] * u[0] + A[3 + r] * u[1] + A[6 + r] * u[2], 0.0
                C[9 + r] += q[i] * J[r]
        else:
            _free(q, i, C, columns[v : v + 6])


@jit
def _turn(A, T, c, s, C):  # type: ignore[no-untyped-def]
    """Fill the rotation of C (12,) with that of A (12,) times the joint's, T (27,), of cosine c and sine s."""
    for m in range(3):
        x = T[3 * m] + c * T[9 + 3 * m] + s * T[18 + 3 * m]
        y = T[3 * m + 1] + c * T[10 + 3 * m] + s * T[19 + 3 * m]
        z = T[3 * m + 2] + c * T[11 + 3 * m] + s * T[20 + 3 * m]
        for r in range(3):
            C[3 * m + r] = A[r] * x + A[3 + r] * y + A[6 + r] * z


@jit
def _moment(C, J):  # type: ignore[no-untyped-def]
    """Fill the linear part of J (6,), which turns about an axis through the origin of C (12,)."""
    J[0] = C[10] * J[5] - C[11] * J[4]
    J[1] = C[11] * J[3] - C[9] * J[5]
    J[2] = C[9] * J[4] - C[10] * J[3]


@jit
def _free(q, i, C, J):  # type: ignore[no-untyped-def]
    """Move C (12,), a free joint's frame, by its place and quaternion in q (nq,) from i on; fill its columns
    J (6, 6)."""
    x, y, z, w = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
    for r in range(3):
        a, b, c = C[r], C[3 + r], C[6 + r]
        C[9 + r] += a * q[i] + b * q[i + 1] + c * q[i + 2]
        C[r] = a * (1 - 2 * (y * y + z * z)) + b * 2 * (x * y + z * w) + c * 2 * (x * z - y * w)
        C[3 + r] = a * 2 * (x * y - z * w) + b * (1 - 2 * (x * x + z * z)) + c * 2 * (y * z + x * w)
        C[6 + r] = a * 2 * (x * z + y * w) + b * 2 * (y * z - x * w) + c * (1 - 2 * (x * x + y * y))
    for k in range(3):
        for r in range(3):
            J[k, r], J[k, 3 + r], J[3 + k, 3 + r] = C[3 * k + r], 0.0, C[3 * k + r]
        _moment(C, J[3 + k])


@jit
def integrate(tree, q, v, moved):  # type: ignore[no-untyped-def]
    """Fill moved (nq,) with q (nq,) (+) v (nv,), angles kept inside the limits, as `Body.integrate`."""
    for j in range(1, tree.parent.shape[0]):
        i, d = tree.q_index[j], tree.v_index[j]
        if tree.kind[j] == FREE:
            _integrate_free(q[i : i + 7], v[d : d + 6], moved[i : i + 7])
        else:
            moved[i] = q[i] + v[d]
    clamp_limits(moved, tree.bounded_q, tree.lower, tree.upper)


@jit
def _integrate_free(q, v, moved):  # type: ignore[no-untyped-def]
    """`integrate` of a free joint: q, moved (7,), v (6,)."""
    w0, w1, w2 = v[3], v[4], v[5]
    square = w0 * w0 + w1 * w1 + w2 * w2
    t = math.sqrt(square)
    if t < _SMALL_TURN:
        a, b, c = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
        half, cosine = 0.5 - square / 48.0, 1.0 - square / 8.0
    else:
        a, b, c = math.sin(t) / t, (1.0 - math.cos(t)) / square, (t - math.sin(t)) / (square * t)
        half, cosine = math.sin(0.5 * t) / t, math.cos(0.5 * t)
    if cosine < 0.0:  # of the two quaternions of a turn, that nearer to the one before, as in Pinocchio
        half, cosine = -half, -cosine
    along = c * (w0 * v[0] + w1 * v[1] + w2 * v[2])
    u0 = a * v[0] + b * (w1 * v[2] - w2 * v[1]) + along * w0
    u1 = a * v[1] + b * (w2 * v[0] - w0 * v[2]) + along * w1
    u2 = a * v[2] + b * (w0 * v[1] - w1 * v[0]) + along * w2
    x, y, z, w = q[3], q[4], q[5], q[6]
    p0, p1, p2 = _rotated(x, y, z, w, u0, u1, u2)
    moved[0], moved[1], moved[2] = q[0] + p0, q[1] + p1, q[2] + p2
    e0, e1, e2 = half * w0, half * w1, half * w2
    n0 = w * e0 + x * cosine + y * e2 - z * e1
    n1 = w * e1 - x * e2 + y * cosine + z * e0
    n2 = w * e2 + x * e1 - y * e0 + z * cosine
    n3 = w * cosine - x * e0 - y * e1 - z * e2
    size = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2 + n3 * n3)
    moved[3], moved[4], moved[5], moved[6] = n0 / size, n1 / size, n2 / size, n3 / size


@jit
def _rotated(x, y, z, w, a, b, c):  # type: ignore[no-untyped-def]
    """The vector a, b, c turned by the quaternion x, y, z, w."""
    d, e, f = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a + w * d + y * f - z * e, b + w * e + z * d - x * f, c + w * f + x * e - y * d


@jit
def clamp_limits(q, bounded_q, lower, upper):  # type: ignore[no-untyped-def]
    """Move the entries bounded_q (B,) of q (nq,) into lower, upper (nq,), in place, and onto them from within rounding.

    A step to a limit may miss it by an ulp, and would then not count as on it.
    """
    for i in bounded_q:
        if q[i] < lower[i] + ON_LIMIT:
            q[i] = lower[i]
        elif q[i] > upper[i] - ON_LIMIT:
            q[i] = upper[i]


@jit
def difference(indices, q0, q1, change, slope):  # type: ignore[no-untyped-def]
    """Fill change (nv,) with q1 (nq,) (-) q0 (nq,), and in slope (nv, nv) the blocks of free joints with its derivative
    by q1, the identity elsewhere; indices (njoints - 1, 3): see `CompiledTree.indices`."""
    for j in range(indices.shape[0]):
        i, d = indices[j, 1], indices[j, 2]
        if indices[j, 0] == FREE:
            _free_difference(q0[i : i + 7], q1[i : i + 7], change[d : d + 6], slope[d : d + 6, d : d + 6])
        else:
            change[d] = q1[i] - q0[i]


@jit
def _free_difference(q0, q1, change, slope):  # type: ignore[no-untyped-def]
    """`difference` of a free joint, q0, q1 (7,), change (6,), slope (6, 6): the logarithm of SE(3), its derivative."""
    ax, ay, az, aw = -q0[3], -q0[4], -q0[5], q0[6]
    bx, by, bz, bw = q1[3], q1[4], q1[5], q1[6]
    x, y = aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx
    z, w = aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    w0, w1, w2 = factor * x, factor * y, factor * z
    p0, p1, p2 = _rotated(ax, ay, az, aw, q1[0] - q0[0], q1[1] - q0[1], q1[2] - q0[2])
    square = w0 * w0 + w1 * w1 + w2 * w2
    alpha, beta, bend = _cotangent(square)
    wp = w0 * p0 + w1 * p1 + w2 * p2
    change[0] = alpha * p0 - 0.5 * (w1 * p2 - w2 * p1) + beta * wp * w0
    change[1] = alpha * p1 - 0.5 * (w2 * p0 - w0 * p2) + beta * wp * w1
    change[2] = alpha * p2 - 0.5 * (w0 * p1 - w1 * p0) + beta * wp * w2
    change[3], change[4], change[5] = w0, w1, w2
    turn, place, A, C = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    turn[0], turn[1], turn[2], place[0], place[1], place[2] = w0, w1, w2, p0, p1, p2
    spread = square * bend + 2.0 * beta
    for r in range(3):
        for k in range(3):
            A[r, k] = beta * turn[r] * turn[k]
            C[r, k] = (bend * wp * turn[r] - spread * place[r]) * turn[k] + beta * turn[r] * place[k]
        A[r, r] += alpha
        C[r, r] += wp * beta
    for r in range(3):
        k, m = (r + 1) % 3, (r + 2) % 3
        A[m, k] += 0.5 * turn[r]
        A[k, m] -= 0.5 * turn[r]
        C[m, k] += 0.5 * place[r]
        C[k, m] -= 0.5 * place[r]
    for r in range(3):
        for k in range(3):
            s = 0.0
            for m in range(3):
                s += C[r, m] * A[m, k]
            slope[r, k], slope[3 + r, 3 + k], slope[3 + r, k], slope[r, 3 + k] = A[r, k], A[r, k], 0.0, s


@jit
def _cotangent(square):  # type: ignore[no-untyped-def]
    """x/2 cot(x/2), b = (1 - that) / x^2, and db/dx / x, of square = x^2."""
    if square < 1.0:
        beta, bend = 0.0, 0.0
        for n in range(len(_COTANGENT) - 1, 0, -1):
            beta = _COTANGENT[n] + square * beta
            bend = 2.0 * n * _COTANGENT[n] + square * bend
        beta = _COTANGENT[0] + square * beta
        return 1.0 - square * beta, beta, bend
    x = math.sqrt(square)
    sine, inverse = math.sin(x), 0.5 / (1.0 - math.cos(x))
    beta = 1.0 / square - sine / x * inverse
    return x * sine * inverse, beta, -2.0 / (square * square) + (1.0 + sine / x) / square * inverse
