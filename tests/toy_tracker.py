"""A tracker unlike the others: it follows the middle of the first camera's silhouette, by pictures alone."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.spec import Spec
from estimator.tracking.registry import register
from humanoid.kinematics.body import Body

DEPTH, GAIN, NOISE = 4.0, 0.7, 1e-3  # m along the optical axis; share of the innovation; of the dynamics


class Middle(NamedTuple):
    time: float
    direction: np.ndarray  # (2,) of the silhouette's middle in the camera, at z = 1

    def arrays(self) -> dict[str, np.ndarray]:
        return {"time": np.array(self.time), "direction": self.direction}


class ToyTracker:
    needs_keypoints = False

    def __init__(self, body: Body) -> None:
        self.body = body

    def can_start(self, observation: Observation) -> bool:
        return bool(_mask(observation).any())

    def init(self, rng: np.random.Generator, observation: Observation) -> tuple[Middle, FrameResult]:
        return self.step(rng, Middle(observation.time, np.zeros(2)), observation)

    def step(self, rng: np.random.Generator, state: Middle, observation: Observation) -> tuple[Middle, FrameResult]:
        mask, camera, q, unit = _mask(observation), observation.cameras[0], self.body.neutral.copy(), np.ones(1)
        direction = state.direction + NOISE * rng.standard_normal(2)
        if mask.any():
            middle = np.argwhere(mask)[:, ::-1].mean(axis=0)
            direction = direction + GAIN * (observation.cues[0].camera.directions(middle)[:2] - direction)
        q[:3] = camera.R_camera_world.T @ (DEPTH * np.append(direction, 1.0) - camera.t_camera_world)
        status, covariance = "tracked" if mask.any() else "unobserved", 0.01 * np.eye(self.body.nv)
        head = observation.index, observation.time, status, q[None], unit, 0.0 * unit, covariance[None]
        reported = {"direction": direction, "widths": mask.sum(axis=1)[mask.any(axis=1)]}
        result = FrameResult(*head, np.array([-1]), 0.0 * unit, 0.0 * unit, ("as_detected",), extra=reported)
        return Middle(observation.time, direction), result

    def state_from(self, arrays: Any) -> Middle:
        return Middle(float(arrays["time"]), arrays["direction"].astype(float).reshape(2))


def _mask(observation: Observation) -> np.ndarray:
    return next((c["silhouette"].mask for c in observation.cues[:1] if "silhouette" in c), np.zeros((1, 1), bool))


SPEC = Spec("toy", "follows the middle of the silhouette", lambda body, settings: ToyTracker(body))
register(SPEC)
