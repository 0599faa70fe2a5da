"""Robust keypoint term: detected points against projected landmarks, any number of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from estimator.data.cameras.projection import (
    pack_cameras,
)
from estimator.data.observation import Observation
from estimator.energy.kernels.keypoints import keypoint_record, keypoint_values, point_loads, whitened_distances
from estimator.energy.kernels.records import KEYPOINTS, Record
from estimator.energy.points import LoadedPoints
from estimator.energy.recorded import RecordedTerm
from estimator.energy.term import Term
from estimator.numerics.robust import POTENTIALS, slopes
from humanoid.kinematics.body import Body, PlacedBodies, PosedBody


class Reprojection(RecordedTerm):
    """Keypoints of one instant against where detectors mark the landmarks; several cameras simply add (CSS eqs. 5, 6
    with given assignments).

    Parameters
    ----------
    body: the body whose keypoints (`Body.keypoint_local`) are compared, in its landmark order.
    observation: pixels (C, L, 2), confidence (C, L).
    sigma (C, L): standard deviation of each keypoint [px].
    potential, nu: see `estimator.numerics.robust`.
    beside: other terms of the frame, in the same reading of left and right.
    """

    name, kind = "keypoints", KEYPOINTS

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

    @cached_property
    def record(self) -> Record:
        """See `RecordedTerm`."""
        body, seen = self._body, (self._confidence > 0.0).any(axis=0)  # the others have no part in it
        joints, local = body.landmark_joint[seen], body.keypoint_local[seen]
        cameras = self._intrinsics, self._distortion, self._R, self._t
        keypoints = self._pixels[:, seen], self._confidence[:, seen], self._precision[:, seen]
        return keypoint_record(joints, local, cameras, keypoints, self._kind, self._nu)

    def values(self, placed: PlacedBodies) -> np.ndarray:
        """See `BatchTerm`."""
        values = np.empty(len(placed.q))
        keypoint_values(
            placed.placements, self._body.landmark_joint, self._body.keypoint_local, self._intrinsics, self._distortion,
            self._R, self._t, self._pixels, self._confidence, self._precision, self._kind, self._nu, values,
        )  # fmt: skip
        return values

    def values_of_cameras(self, posed: PosedBody) -> np.ndarray:
        """Share of each camera's keypoints in the value, (C,)."""
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
        points, force, weight = LoadedPoints.on(self._body.landmark_joint)[1:]
        point_loads(
            posed.placements, self._body.landmark_joint, self._body.keypoint_local, self._intrinsics, self._distortion,
            self._R, self._t, self._pixels, self._confidence, self._precision, self._kind, self._nu, False, points,
            force, weight,
        )  # fmt: skip
        return force, weight

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
        """Robust weights (C, L) of residuals (C, L, 2) [px], relative to least squares; 0 where they are NaN."""
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
