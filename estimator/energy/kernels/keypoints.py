"""Compiled kernels of the keypoint term."""

from __future__ import annotations

import numpy as np

from estimator.data.cameras.projection import (
    add_projection_curvature,
    project_point,
    project_with_jacobian,
)
from estimator.energy.kernels.points import load_joints, to_world
from estimator.energy.kernels.records import KEYPOINTS, Record, record_of
from estimator.numerics.robust import rho
from humanoid.support.compiled import jit

BEHIND = 1e4  # squared whitened residual charged for a landmark that is not in front of its camera: 100 sigma


@jit
def point_loads(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, pixels, confidence, precision, kind, nu, exact, points,
    force, weight,
):  # fmt: skip
    """Value of the term; fills landmarks in the world `points` (L, 3), and the gradient `force` (L, 3) and Hessian
    `weight` (L, 3, 3) of the value with respect to them.

    placements (njoints, 12); joints (L,), local (L, 3): of the landmarks. Cameras: intrinsics (C, 5), distortion (C, 5)
    or (C, 1, 22), R (C, 3, 3), t (C, 3). pixels (C, L, 2); confidence, precision (C, L).
    """
    value = 0.0
    image_jacobian = np.zeros((2, 3))
    along = np.zeros(3)  # residual pulled back to the point
    for n in range(joints.shape[0]):
        p, f, W = points[n], force[n], weight[n]
        to_world(placements[joints[n]], local[n], p)
        f[:] = 0.0
        W[:] = 0.0
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
            pull = confidence[c, n] * slope * precision[c, n]
            curve = 2.0 * confidence[c, n] * bending * precision[c, n] ** 2 if exact else 0.0
            for k in range(3):
                along[k] = ru * image_jacobian[0, k] + rv * image_jacobian[1, k]
                f[k] -= pull * along[k]
            for i in range(3):
                for k in range(3):
                    square = image_jacobian[0, i] * image_jacobian[0, k] + image_jacobian[1, i] * image_jacobian[1, k]
                    W[i, k] += pull * square + curve * along[i] * along[k]
            if exact:
                add_projection_curvature(p, intrinsics[c], distortion[c], R[c], t[c], -pull * ru, -pull * rv, W)
    return value


@jit
def keypoint_values(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, pixels, confidence, precision, kind, nu, values
):
    """Fill values (N,) with those of `point_loads` for placements (N, njoints, 12)."""
    p = np.empty(3)
    for s in range(placements.shape[0]):
        value = 0.0
        for n in range(joints.shape[0]):
            to_world(placements[s, joints[n]], local[n], p)
            for c in range(pixels.shape[0]):
                if confidence[c, n] <= 0.0:
                    continue
                u, v, visible = project_point(p, intrinsics[c], distortion[c], R[c], t[c])
                square = BEHIND
                if visible:
                    ru, rv = pixels[c, n, 0] - u, pixels[c, n, 1] - v
                    square = (ru * ru + rv * rv) * precision[c, n]
                value += 0.5 * confidence[c, n] * rho(kind, square, nu)[0]
        values[s] = value


@jit
def whitened_distances(points, intrinsics, distortion, R, t, pixels, confidence, precision, out):  # type: ignore[no-untyped-def]
    """Fill `out` (C, L) with the distances of keypoints from projected points (L, 3) in standard deviations.

    intrinsics (C, 5), distortion (C, 5) or (C, 1, 22), R (C, 3, 3), t (C, 3): of the cameras. pixels (C, L, 2) [px],
    confidence (C, L), precision (C, L) [1/px^2]: of the keypoints.
    """
    for c in range(pixels.shape[0]):
        for n in range(pixels.shape[1]):
            if confidence[c, n] > 0.0:
                u, v, visible = project_point(points[n], intrinsics[c], distortion[c], R[c], t[c])
                s = ((pixels[c, n, 0] - u) ** 2 + (pixels[c, n, 1] - v) ** 2) * precision[c, n]
                out[c, n] = np.sqrt(s) if visible else np.inf


def keypoint_record(
    joints: np.ndarray, local: np.ndarray, cameras: tuple[np.ndarray, ...], keypoints: tuple[np.ndarray, ...],
    kind: int, nu: float,
) -> Record:  # fmt: skip
    """The term, see `point_loads`: cameras are intrinsics, distortion, R and t, keypoints pixels, confidence and
    precision."""
    lens = cameras[1].ndim
    return record_of(KEYPOINTS, [len(cameras[0]), len(joints), lens, kind, joints], [nu, local, *cameras, *keypoints])


@jit
def load_keypoints(integers, numbers, placements, exact, joint_force, joint_load, moment):  # type: ignore[no-untyped-def]
    """Value of a term, by its record's integers (I,) and numbers (F,); adds to the joints' loads, see `load_joints`.

    placements (njoints, 12).
    """
    C, L, kind, joints = integers[0], integers[1], integers[3], integers[4 : 4 + integers[1]]
    nu, local = numbers[0], numbers[1 : 1 + 3 * L].reshape(L, 3)
    o = 1 + 3 * L
    intrinsics = numbers[o : o + 5 * C].reshape(C, 5)
    o += 5 * C
    lens, size = integers[2], C * (5 if integers[2] == 2 else 22)
    distortion = numbers[o : o + size]
    o += size
    R, t = numbers[o : o + 9 * C].reshape(C, 3, 3), numbers[o + 9 * C : o + 12 * C].reshape(C, 3)
    o += 12 * C
    pixels = numbers[o : o + 2 * C * L].reshape(C, L, 2)
    o += 2 * C * L
    confidence, precision = numbers[o : o + C * L].reshape(C, L), numbers[o + C * L : o + 2 * C * L].reshape(C, L)
    points, force, weight = np.empty((L, 3)), np.empty((L, 3)), np.empty((L, 3, 3))
    if lens == 2:
        value = point_loads(
            placements, joints, local, intrinsics, distortion.reshape(C, 5), R, t, pixels, confidence, precision, kind,
            nu, exact, points, force, weight,
        )  # fmt: skip
    elif lens == 3:
        value = point_loads(
            placements, joints, local, intrinsics, distortion.reshape(C, 1, 22), R, t, pixels, confidence, precision,
            kind, nu, exact, points, force, weight,
        )  # fmt: skip
    else:
        value = point_loads(
            placements, joints, local, intrinsics, distortion.reshape(C, 1, 1, 22), R, t, pixels, confidence,
            precision, kind, nu, exact, points, force, weight,
        )  # fmt: skip
    load_joints(joints, points, force, weight, exact, joint_force, joint_load, moment)
    return value
