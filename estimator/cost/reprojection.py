"""Robust keypoint term: detected points against projected landmarks, any number of cameras."""

from __future__ import annotations

import numpy as np

from estimator.cost.potentials import POTENTIALS, rho
from estimator.imaging.camera import Camera
from estimator.imaging.observation import Observation
from humanoid.body import Body, PosedBody
from humanoid.compiled import jit

BEHIND = 1e4  # squared whitened residual charged for a landmark that is not in front of its camera
MIN_DEPTH = 0.05  # m in front of a camera; nearer landmarks have no projection


class Reprojection:
    """Keypoints of one instant; several cameras simply add (CSS eqs. 5, 6 with given assignments).

    Parameters
    ----------
    body: the body whose landmarks are compared, in its landmark order.
    observation: pixels (C, L, 2), confidence (C, L).
    sigma (C, L): standard deviation of each keypoint [px].
    potential, nu: see `estimator.cost.potentials`.
    """

    def __init__(
        self, body: Body, observation: Observation, sigma: np.ndarray, potential: str = "lorentzian", nu: float = 4.0
    ) -> None:
        self._body = body
        self._kind, self._nu = POTENTIALS[potential], float(nu)
        self._intrinsics, self._distortion, self._R, self._t = pack_cameras(observation.cameras)
        valid = (observation.confidence > 0.0) & np.isfinite(observation.pixels).all(axis=-1)
        self._pixels = np.where(valid[..., None], observation.pixels, 0.0)
        self._confidence = np.where(valid, observation.confidence, 0.0)
        self._precision = 1.0 / np.square(sigma)
        self._joint_load = np.zeros((body.njoints, 6, 6))
        self._joint_force = np.zeros((body.njoints, 6))
        self._joint_moment = np.zeros((body.njoints, 3, 3))

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.cost.term.Term`."""
        body = self._body
        self._joint_load[:] = 0.0
        self._joint_force[:] = 0.0
        self._joint_moment[:] = 0.0
        value: float = _landmark_loads(
            posed.placements, body.landmark_joint, body.landmark_local, self._intrinsics, self._distortion, self._R,
            self._t, self._pixels, self._confidence, self._precision, self._kind, self._nu, self._joint_load,
            self._joint_force, self._joint_moment, exact,
        )  # fmt: skip
        tree = body.tree
        gather(
            posed.columns, tree.joint_parent, tree.dof_joint, tree.dof_parent, self._joint_load, self._joint_force,
            gradient, hessian,
        )  # fmt: skip
        if exact:
            bend(
                posed.columns, tree.joint_parent, tree.dof_joint, tree.dof_parent, self._joint_force,
                self._joint_moment, hessian,
            )  # fmt: skip
        return value


def pack_cameras(cameras: tuple[Camera, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cameras as arrays: fx, fy, cx, cy, skew (C, 5); distortion (C, 5); R (C, 3, 3) and t (C, 3) camera from world."""
    K = np.array([c.K for c in cameras])
    intrinsics = np.stack([K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2], K[:, 0, 1]], axis=1)
    return (
        intrinsics,
        np.array([c.distortion for c in cameras]),
        np.array([c.R_camera_world for c in cameras]),
        np.array([c.t_camera_world for c in cameras]),
    )


@jit
def project_with_jacobian(p, intrinsics, distortion, R, t, image_jacobian):  # type: ignore[no-untyped-def]
    """Project world point p (3,); fills d pixel / d p (2, 3); returns u, v and whether p is in front of the camera."""
    x = R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2] + t[0]
    y = R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2] + t[1]
    z = R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2]
    if z < MIN_DEPTH:
        return 0.0, 0.0, False
    a, b = x / z, y / z
    k1, k2, p1, p2, k3 = distortion[0], distortion[1], distortion[2], distortion[3], distortion[4]
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)  # d radial / d r2
    ad = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    bd = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    ad_a = radial + 2.0 * a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a
    ad_b = 2.0 * a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
    bd_b = radial + 2.0 * b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a
    fx, fy, skew = intrinsics[0], intrinsics[1], intrinsics[4]
    u_a, u_b = fx * ad_a + skew * ad_b, fx * ad_b + skew * bd_b
    v_a, v_b = fy * ad_b, fy * bd_b
    for k in range(3):
        da = (R[0, k] - a * R[2, k]) / z
        db = (R[1, k] - b * R[2, k]) / z
        image_jacobian[0, k] = u_a * da + u_b * db
        image_jacobian[1, k] = v_a * da + v_b * db
    return fx * ad + skew * bd + intrinsics[2], fy * bd + intrinsics[3], True


@jit
def _landmark_loads(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, pixels, confidence, precision, kind, nu, load, force, moment,
    exact,
):
    """Sum over the landmarks of each joint: value, 6-vectors `force`, 6x6 matrices `load` and, if `exact`, 3x3
    matrices `moment` = sum p f' with f = d value / d p (all in the world frame)."""
    value = 0.0
    p = np.zeros(3)
    image_jacobian = np.zeros((2, 3))
    row = np.zeros(6)
    along = np.zeros(6)  # residual seen as a spatial force
    for n in range(joints.shape[0]):
        j = joints[n]
        for k in range(3):
            p[k] = placements[j, 9 + k]
            for i in range(3):
                p[k] += placements[j, 3 * i + k] * local[n, i]
        for c in range(pixels.shape[0]):
            if confidence[c, n] <= 0.0:
                continue
            u, v, visible = project_with_jacobian(p, intrinsics[c], distortion[c], R[c], t[c], image_jacobian)
            if not visible:
                value += 0.5 * confidence[c, n] * rho(kind, BEHIND, nu)[0]
                continue
            ru, rv = pixels[c, n, 0] - u, pixels[c, n, 1] - v
            cost, slope, bending = rho(kind, (ru * ru + rv * rv) * precision[c, n], nu)
            value += 0.5 * confidence[c, n] * cost
            weight = confidence[c, n] * slope * precision[c, n]
            along[:] = 0.0
            for image_row in range(2):
                a0, a1, a2 = image_jacobian[image_row, 0], image_jacobian[image_row, 1], image_jacobian[image_row, 2]
                row[0], row[1], row[2] = a0, a1, a2
                row[3] = p[1] * a2 - p[2] * a1
                row[4] = p[2] * a0 - p[0] * a2
                row[5] = p[0] * a1 - p[1] * a0
                pull = weight * (ru if image_row == 0 else rv)
                for i in range(6):
                    force[j, i] -= pull * row[i]
                    along[i] += (ru if image_row == 0 else rv) * row[i]
                    for k in range(6):
                        load[j, i, k] += weight * row[i] * row[k]
            if exact:
                curvature = 2.0 * confidence[c, n] * bending * precision[c, n] ** 2
                for i in range(6):
                    for k in range(6):
                        load[j, i, k] += curvature * along[i] * along[k]
                for i in range(3):
                    for k in range(3):
                        moment[j, i, k] -= weight * p[i] * along[k]
    return value


@jit
def gather(columns, joint_parent, dof_joint, dof_parent, load, force, gradient, hessian):  # type: ignore[no-untyped-def]
    """Per-joint loads to gradient and Hessian: sums go up the tree first, as in the composite rigid body algorithm.

    Adds sum_j J_j' force_j to the gradient and sum_j J_j' load_j J_j to the Hessian in O(nv depth), however many
    points made the loads. Overwrites `load` and `force` with their sums over subtrees.
    """
    for j in range(joint_parent.shape[0] - 1, 0, -1):
        parent = joint_parent[j]
        for i in range(6):
            force[parent, i] += force[j, i]
            for k in range(6):
                load[parent, i, k] += load[j, i, k]
    moved = np.zeros(6)
    for d in range(dof_joint.shape[0]):
        j = dof_joint[d]
        for i in range(6):
            gradient[d] += force[j, i] * columns[d, i]
            s = 0.0
            for k in range(6):
                s += load[j, i, k] * columns[d, k]
            moved[i] = s
        k = d
        while k >= 0:
            s = 0.0
            for i in range(6):
                s += columns[k, i] * moved[i]
            hessian[d, k] += s
            if k != d:
                hessian[k, d] += s
            k = dof_parent[k]


@jit
def bend(columns, joint_parent, dof_joint, dof_parent, force, moment, hessian):  # type: ignore[no-untyped-def]
    """Add the curvature of the kinematics: sum over points of f . d2p / dq_i dq_j.

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
        v, w = columns[d, :3], columns[d, 3:]
        F, P = force[j, :3], moment[j]
        trace = P[0, 0] + P[1, 1] + P[2, 2]
        for i in range(3):
            turned[i] = P[i, 0] * w[0] + P[i, 1] * w[1] + P[i, 2] * w[2] - trace * w[i]
        turned[0] += v[1] * F[2] - v[2] * F[1]
        turned[1] += v[2] * F[0] - v[0] * F[2]
        turned[2] += v[0] * F[1] - v[1] * F[0]
        k = d
        while k >= 0:
            s = columns[k, 3] * turned[0] + columns[k, 4] * turned[1] + columns[k, 5] * turned[2]
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
            s = 0.5 * (columns[k, 3] * turned[0] + columns[k, 4] * turned[1] + columns[k, 5] * turned[2])
            hessian[d, k] += s
            hessian[k, d] += s
            k += 1
