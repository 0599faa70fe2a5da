"""Robust keypoint term: detected points against projected landmarks, any number of cameras."""

from __future__ import annotations

import numpy as np

from estimator.cost.points import accumulate_points
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
        count = len(body.landmark_names)
        self._points, self._force = np.zeros((count, 3)), np.zeros((count, 3))
        self._weight = np.zeros((count, 3, 3))

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.cost.term.Term`."""
        value = self._load_points(posed, exact)
        accumulate_points(
            self._body, posed, self._body.landmark_joint, self._points, self._force, self._weight, gradient, hessian, exact
        )
        return value

    def point_loads(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (L, 3) [1/m] and Gauss-Newton Hessian (L, 3, 3) of the value with respect to each landmark."""
        self._load_points(posed, False)
        return self._force.copy(), self._weight.copy()

    def distances(self, posed: PosedBody) -> np.ndarray:
        """Distance of every keypoint from its projected landmark in standard deviations, (C, L); NaN where missing."""
        distances = np.full(self._confidence.shape, np.nan)
        _whitened_distances(
            self._body.landmarks(posed), self._intrinsics, self._distortion, self._R, self._t, self._pixels,
            self._confidence, self._precision, distances,
        )  # fmt: skip
        return distances

    def _load_points(self, posed: PosedBody, exact: bool) -> float:
        value: float = _point_loads(
            posed.placements, self._body.landmark_joint, self._body.landmark_local, self._intrinsics,
            self._distortion, self._R, self._t, self._pixels, self._confidence, self._precision, self._kind, self._nu,
            exact, self._points, self._force, self._weight,
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
def _point_loads(  # type: ignore[no-untyped-def]
    placements, joints, local, intrinsics, distortion, R, t, pixels, confidence, precision, kind, nu, exact, points,
    force, weight,
):  # fmt: skip
    """Value of the term; fills landmarks in the world `points` (L, 3), and the gradient `force` (L, 3) and Hessian
    `weight` (L, 3, 3) of the value with respect to them."""
    value = 0.0
    image_jacobian = np.zeros((2, 3))
    along = np.zeros(3)  # residual pulled back to the point
    for n in range(joints.shape[0]):
        p, f, W = points[n], force[n], weight[n]
        for k in range(3):
            p[k] = placements[joints[n], 9 + k]
            for i in range(3):
                p[k] += placements[joints[n], 3 * i + k] * local[n, i]
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
    return value


@jit
def _whitened_distances(points, intrinsics, distortion, R, t, pixels, confidence, precision, out):  # type: ignore[no-untyped-def]
    image_jacobian = np.zeros((2, 3))
    for c in range(pixels.shape[0]):
        for n in range(pixels.shape[1]):
            if confidence[c, n] > 0.0:
                u, v, visible = project_with_jacobian(
                    points[n], intrinsics[c], distortion[c], R[c], t[c], image_jacobian
                )
                s = ((pixels[c, n, 0] - u) ** 2 + (pixels[c, n, 1] - v) ** 2) * precision[c, n]
                out[c, n] = np.sqrt(s) if visible else np.inf
