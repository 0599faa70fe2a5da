"""How often true joint angles lie in the intervals that a run has for them.

The truth has other zeros, and its angles are another model's: what counts is by how much the run's best pose is off in
the gait model's coordinate, which goes up or down with the body's joint. What is left of a difference between zeros is
part of what an interval has to hold.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimator.runs.coordinate_errors import wrapped_degrees
from estimator.runs.gait_coordinates import GAIT_MODELS, gait_coordinates
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from kinemode.testing.calibration import calibration_error, coverage

_OF_SIDE = {
    "hip_flexion": "hip_flexion", "hip_abduction": "hip_adduction", "hip_rotation": "hip_rotation",
    "knee_flexion": "knee_angle", "ankle_dorsiflexion": "ankle_angle", "elbow_flexion": "elbow_flex",
}  # fmt: skip
COORDINATES = {f"{side}_{ours}": f"{theirs}_{side[0]}" for side in ("left", "right")
               for ours, theirs in _OF_SIDE.items()} | {
    "lumbar_flexion": "lumbar_extension", "lumbar_lateral": "lumbar_bending", "lumbar_axial": "lumbar_rotation",
}  # fmt: skip
"""human34's joints, and the corresponding coordinates of the gait model."""
_STEP = 0.05  # rad


def directions(body: Body, q: np.ndarray) -> dict[str, float]:
    """Whether the coordinate goes up, 1, or down, -1, with each joint at poses q (T, nq)."""
    names, before = gait_coordinates(body, q, GAIT_MODELS["rajagopal"])
    signs = {}
    for joint, coordinate in COORDINATES.items():
        moved = q.copy()
        moved[:, body.model.idx_qs[body.model.getJointId(joint)]] += _STEP
        after = gait_coordinates(body, moved, GAIT_MODELS["rajagopal"])[1]
        signs[joint] = float(np.sign(np.mean((after - before)[:, names.index(coordinate)])))
    return signs


def central_levels(run: Run, frames: np.ndarray, truth: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """By joint, the probabilities (F,) of the central intervals that end at the truth; evenly spread where all is
    right. truth: the gait model's coordinates (F,) [deg] at the frames, by their names."""
    body, q = run.body, run.q[frames]
    names, ours = gait_coordinates(body, q, GAIT_MODELS["rajagopal"])
    signs, joints = directions(body, q), [j for j, c in COORDINATES.items() if c in truth]
    places = np.array([body.model.getJointId(joint) for joint in joints])
    off = [signs[j] * (truth[COORDINATES[j]] - ours[:, names.index(COORDINATES[j])]) for j in joints]
    off_by = np.radians(wrapped_degrees(np.transpose(off)))
    in_q, in_v = np.array(body.model.idx_qs)[places], np.array(body.model.idx_vs)[places]
    below, value = [], np.zeros(body.nv)
    for row, frame in enumerate(frames):
        posterior = run.posterior(int(frame))
        value[in_v] = q[row, in_q] + off_by[row] - posterior.best[in_q]
        below.append(posterior.marginals().cdf(value)[in_v])
    return dict(zip(joints, np.abs(2.0 * np.transpose(below) - 1.0), strict=True))


def calibration(levels: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Share of truths in the 90 % intervals, over all joints, of the joint with the fewest and with the most; and the
    expected calibration error."""
    shares = [float(coverage(own, 0.9)[0]) for own in levels.values()]
    error = calibration_error(np.concatenate(list(levels.values())))
    return {"90 %": float(np.mean(shares)), "fewest": min(shares), "most": max(shares), "error": error}
