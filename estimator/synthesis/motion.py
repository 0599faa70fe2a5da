"""An authored motion of human34: reach up and forwards, two steps in a turn, a knee bend."""

from __future__ import annotations

from typing import cast

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from humanoid.body import Body
from humanoid.errors import InputError

MOTION_SECONDS = 3.0
_KEY_TIMES = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)

# joint angles at the key times [deg]
_KEYS: dict[str, tuple[float, ...]] = {
    "lumbar_flexion": (5, 4, 8, 16, 24, 12, 8),
    "lumbar_lateral": (0, 2, 6, -3, -7, 0, 2),
    "lumbar_axial": (0, -6, -12, 2, 12, 6, 0),
    "neck_flexion": (6, 2, -4, 4, 10, 6, 4),
    "neck_lateral": (0, 2, 3, -2, -3, 0, 0),
    "neck_axial": (0, 12, 18, 0, -12, -4, 0),
    "left_clavicle_elevation": (1, 3, 8, 14, 8, 3, 1),
    "left_clavicle_protraction": (0, 0, 2, 6, 12, 4, 0),
    "left_shoulder_elevation": (10, 24, 88, 138, 86, 36, 13),
    "left_shoulder_flexion": (4, 12, 38, 24, 48, 28, 8),
    "left_shoulder_rotation": (0, 0, -6, -8, 0, 4, 2),
    "left_elbow_flexion": (16, 42, 46, 18, 14, 44, 28),
    "right_clavicle_elevation": (1, 2, 5, 6, 8, 12, 4),
    "right_clavicle_protraction": (0, 4, 10, 10, 4, 0, 0),
    "right_shoulder_elevation": (10, 30, 84, 62, 78, 52, 16),
    "right_shoulder_flexion": (4, 26, 50, 32, 44, 8, 6),
    "right_shoulder_rotation": (0, -4, 0, -6, -4, -8, 0),
    "right_elbow_flexion": (16, 52, 12, 66, 16, 54, 30),
    "left_hip_flexion": (6, 16, 46, 22, 34, 22, 12),
    "left_hip_abduction": (5, 5, 9, 8, 9, 8, 6),
    "left_hip_rotation": (0, 4, 14, 4, 2, 2, 0),
    "left_knee_flexion": (9, 24, 58, 24, 52, 34, 18),
    "right_hip_flexion": (6, 6, 0, 30, 34, 22, 12),
    "right_hip_abduction": (5, 4, 3, 6, 8, 8, 6),
    "right_hip_rotation": (0, 2, 8, 0, 2, 2, 0),
    "right_knee_flexion": (9, 12, 18, 58, 52, 34, 18),
}
_YAW = (-25, -24, -8, 22, 44, 50, 50)
_PITCH = (0, 0, 2, 3, 6, 3, 2)
_LEFT_STANCE = (0.5, 0.1, 0.0, 0.9, 0.6, 0.5, 0.5)  # share of the left foot in carrying the body
_START = (-0.1, -0.05)  # where the root stands at first [m]
_GRID_RATE = 120.0  # the root's path is found on a grid of its own, whatever the times asked for
_FLOOR_SMOOTHING = 0.04  # [s]
_SOLES = ("heel", "big_toe", "small_toe")


def authored_motion(body: Body, times: np.ndarray) -> np.ndarray:
    """Configurations (T, nq) at `times` (T,) [s], 0 to `MOTION_SECONDS`, held before and after.

    World: z up, the floor at z = 0; the person stands near the origin and faces x, turned from 25 degrees to the
    right to 50 degrees to the left. Angles stay inside the limits. The carrying foot stays where it is.

    Raises
    ------
    InputError: the body lacks a joint of human34.
    """
    _check(body)
    grid = np.linspace(0.0, MOTION_SECONDS, round(MOTION_SECONDS * _GRID_RATE) + 1)
    path = CubicSpline(grid, _root_path(body, grid))
    q = _pose(body, np.clip(times, 0.0, MOTION_SECONDS))
    q[:, :3] = path(np.clip(times, 0.0, MOTION_SECONDS))
    return q


def _check(body: Body) -> None:
    missing = [name for name in _KEYS if not body.model.existJointName(name)]
    if missing or body.subject.base != "free":
        problem = f"has no joint {', '.join(missing)}" if missing else "has a fixed base"
        raise InputError(body.subject.source, problem, remedy="the authored motion is one of human34")


def _spline(values: tuple[float, ...], times: np.ndarray) -> np.ndarray:
    return cast(np.ndarray, CubicSpline(_KEY_TIMES, values, bc_type="clamped")(times))


def _pose(body: Body, times: np.ndarray) -> np.ndarray:
    """Configurations with the root turned but at the origin."""
    model = body.model
    q = np.tile(body.neutral, (len(times), 1))
    angles = {name: np.radians(_spline(values, times)) for name, values in _KEYS.items()}
    pitch = np.radians(_spline(_PITCH, times))
    for side in ("left", "right"):  # the soles stay level as far as the ankles allow
        level = angles[f"{side}_knee_flexion"] - angles[f"{side}_hip_flexion"] - pitch
        angles[f"{side}_ankle_dorsiflexion"] = np.radians(28.0) * np.tanh(level / np.radians(28.0))
    for name, angle in angles.items():
        q[:, model.idx_qs[model.getJointId(name)]] = angle
    yaw = np.radians(_spline(_YAW, times))
    for i in range(len(times)):
        q[i, :3] = 0.0
        q[i, 3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, pitch[i], yaw[i])).coeffs()
    return q


def _root_path(body: Body, grid: np.ndarray) -> np.ndarray:
    """Root positions (N, 3) that keep the carrying foot in its place and the lowest sole on the floor."""
    points = np.array([body.landmarks(body.at(q)) for q in _pose(body, grid)])
    names = body.landmark_names
    left, right = (points[:, names.index(f"{side}_ankle"), :2] for side in ("left", "right"))
    stance = np.clip(_spline(_LEFT_STANCE, 0.5 * (grid[1:] + grid[:-1])), 0.0, 1.0)[:, None]
    slide = stance * np.diff(left, axis=0) + (1.0 - stance) * np.diff(right, axis=0)
    soles = [i for i, name in enumerate(names) if name.endswith(_SOLES)]
    height = -points[:, soles, 2].min(axis=1)
    path = np.zeros((len(grid), 3))
    path[:, :2] = np.array(_START) - np.concatenate([np.zeros((1, 2)), np.cumsum(slide, axis=0)])
    path[:, 2] = gaussian_filter1d(height, _FLOOR_SMOOTHING * _GRID_RATE, mode="nearest")
    return path
