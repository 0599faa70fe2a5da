"""Robust keypoint term: detected points against projected landmarks, any number of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from estimator.data.cameras.projection import (
    add_projection_curvature,
    pack_cameras,
    project_point,
    project_with_jacobian,
)
from estimator.data.observation import Observation
from estimator.energy.points import LoadedPoints, accumulate_points, to_world
from estimator.energy.term import BatchTerm, Term
from estimator.numerics.robust import POTENTIALS, rho, slopes
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody
from humanoid.support.compiled import jit

BEHIND = 1e4  # squared whitened residual charged for a landmark that is not in front of its camera: 100 sigma


class Reprojection(BatchTerm):
    """Keypoints of one instant against where detectors mark the landmarks; several cameras simply add (CSS eqs. 5, 6
    with given assignments).

    Parameters
    ----------
    body: the body whose keypoints (`Body.keypoint_local`) are compared, in its landmark order.
    observation: pixels (C, L, 2), confidence (C, L).
    sigma (C, L): standard deviation of each keypoint [px].
    potential, nu: see `estimator.numerics.robust`.
    beside: terms of what else is known of the frame, in the same reading of left and right.

    One object serves one thread: it reuses buffers.
    """

    name = "keypoints"

    def __init__(
        self,
        body: Body,
        observation: Observation,
        sigma: np.ndarray,
        potential: str = "lorentzian",
        nu: float = 4.0,
        beside: Sequence[Term] = (),
    ) -> None:
        self._body, self.beside = body, tuple(beside)
        # a smoother keeps the terms of all frames, which must not keep all pictures
        self.observation, self.cameras = replace(observation, cues=()), observation.cameras
        self.sigma = sigma
        self._whole: Reprojection | None = None
        self._kind, self._nu = POTENTIALS[potential], float(nu)
        self._intrinsics, self._distortion, self._R, self._t = pack_cameras(observation.cameras)
        valid = (observation.confidence > 0.0) & np.isfinite(observation.pixels).all(axis=-1)
        self._pixels = np.where(valid[..., None], observation.pixels, 0.0)
        self._confidence = np.where(valid, observation.confidence, 0.0)
        self._precision = 1.0 / np.square(sigma)
        self._loaded = LoadedPoints.on(body.landmark_joint)

    def accumulate(self, posed: PosedBody, gradient: np.ndarray, hessian: np.ndarray, exact: bool = False) -> float:
        """See `estimator.energy.term.Term`."""
        value = self._load_points(posed, exact)
        accumulate_points(self._body, posed, self._loaded, gradient, hessian, exact)
        return value

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        keypoint_values(
            placed.placements, self._body.landmark_joint, self._body.keypoint_local, self._intrinsics, self._distortion,
            self._R, self._t, self._pixels, self._confidence, self._precision, self._kind, self._nu, values,
        )  # fmt: skip
        return values

    def values_of_cameras(self, posed: PosedBody) -> np.ndarray:
        """What each camera's keypoints have of the value, (C,)."""
        placed, values = posed.alone, np.empty((len(self._confidence), 1))
        for c, value in enumerate(values):
            camera = slice(c, c + 1)
            keypoint_values(
                placed.placements, self._body.landmark_joint, self._body.keypoint_local, self._intrinsics[camera],
                self._distortion[camera], self._R[camera], self._t[camera], self._pixels[camera],
                self._confidence[camera], self._precision[camera], self._kind, self._nu, value,
            )  # fmt: skip
        return values[:, 0]

    def point_loads(self, posed: PosedBody) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (L, 3) [1/m] and Gauss-Newton Hessian (L, 3, 3) of the value with respect to each keypoint's
        place in the world."""
        self._load_points(posed, False)
        return self._loaded.force.copy(), self._loaded.weight.copy()

    def distances(self, posed: PosedBody) -> np.ndarray:
        """Distance of every keypoint from its projected landmark in standard deviations, (C, L); NaN where missing."""
        distances = np.full(self._confidence.shape, np.nan)
        whitened_distances(
            self._body.keypoints(posed), self._intrinsics, self._distortion, self._R, self._t, self._pixels,
            self._confidence, self._precision, distances,
        )  # fmt: skip
        return distances

    @property
    def whole(self) -> Reprojection:
        """The term by the keypoints as they were detected: this one, or what it was `corrected` from."""
        return self if self._whole is None else self._whole

    def residuals(self, posed: PosedBody) -> np.ndarray:
        """Keypoints less where the body has them, (C, L, 2) [px]; NaN where missing, or behind the camera."""
        points = self._body.keypoints(posed)
        projected = np.array([camera.project(points) for camera in self.cameras])
        return np.where(self._confidence[..., None] > 0.0, self._pixels - projected, np.nan)

    def robust_share(self, residuals: np.ndarray) -> np.ndarray:
        """What the potential leaves of the pull that residuals (C, L, 2) [px] would have by least squares, (C, L); 0
        where they are NaN."""
        square = np.square(residuals).sum(axis=-1) * self._precision
        left = np.zeros(square.size)
        slopes(self._kind, square.ravel(), self._nu, left)
        return np.where(np.isfinite(square), left.reshape(square.shape), 0.0)

    def corrected(self, errors: np.ndarray, sigma: np.ndarray) -> Reprojection:
        """The same term with keypoints that are without errors (C, L, 2) [px], by other deviations (C, L) [px]; its
        `whole` is this one."""
        term = copy(self)
        term.observation = replace(self.observation, pixels=self.observation.pixels - errors)
        term.sigma, term._precision, term._pixels = sigma, 1.0 / np.square(sigma), self._pixels - errors
        term._whole = self
        return term

    def _load_points(self, posed: PosedBody, exact: bool) -> float:
        value: float = point_loads(
            posed.placements, self._body.landmark_joint, self._body.keypoint_local, self._intrinsics,
            self._distortion, self._R, self._t, self._pixels, self._confidence, self._precision, self._kind, self._nu,
            exact, self._loaded.points, self._loaded.force, self._loaded.weight,
        )  # fmt: skip
        return value


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
