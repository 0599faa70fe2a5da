"""Robust keypoint term: detected points against projected landmarks, any number of cameras."""

from __future__ import annotations

import numpy as np

from estimator.cameras.camera import Camera
from estimator.imaging.observation import Observation
from estimator.terms.kernels import point_loads, whitened_distances
from estimator.terms.points import accumulate_points
from estimator.terms.potentials import POTENTIALS
from humanoid.kinematics.body import Body, PosedBody


class Reprojection:
    """Keypoints of one instant; several cameras simply add (CSS eqs. 5, 6 with given assignments).

    Parameters
    ----------
    body: the body whose landmarks are compared, in its landmark order.
    observation: pixels (C, L, 2), confidence (C, L).
    sigma (C, L): standard deviation of each keypoint [px].
    potential, nu: see `estimator.terms.potentials`.
    """

    def __init__(
        self, body: Body, observation: Observation, sigma: np.ndarray, potential: str = "lorentzian", nu: float = 4.0
    ) -> None:
        self._body = body
        self.observation, self.cameras = observation, observation.cameras
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
        """See `estimator.terms.term.Term`."""
        value = self._load_points(posed, exact)
        accumulate_points(
            self._body,
            posed,
            self._body.landmark_joint,
            self._points,
            self._force,
            self._weight,
            gradient,
            hessian,
            exact,
        )
        return value

    def point_loads(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (L, 3) [1/m] and Gauss-Newton Hessian (L, 3, 3) of the value with respect to each landmark."""
        self._load_points(posed, False)
        return self._force.copy(), self._weight.copy()

    def distances(self, posed: PosedBody) -> np.ndarray:
        """Distance of every keypoint from its projected landmark in standard deviations, (C, L); NaN where missing."""
        distances = np.full(self._confidence.shape, np.nan)
        whitened_distances(
            self._body.landmarks(posed), self._intrinsics, self._distortion, self._R, self._t, self._pixels,
            self._confidence, self._precision, distances,
        )  # fmt: skip
        return distances

    def _load_points(self, posed: PosedBody, exact: bool) -> float:
        value: float = point_loads(
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
