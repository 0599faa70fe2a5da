"""Joints in the order of SMPL (Loper et al., SMPL: a skinned multi-person linear model, 2015) as a motion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import UPS, axis_of
from estimator.data.formats.markers import check_spread
from estimator.data.formats.npz import read_npz
from estimator.data.formats.opensim import METRES, metres_in, upright_world
from estimator.data.formats.point_arrays import checked_points, checked_rate, number_array
from estimator.retargeting.source import SourceMotion
from humanoid.support.errors import InputError, shown

JOINTS: tuple[str | None, ...] = (
    None, "left_hip", "right_hip", None, "left_knee", "right_knee", None, "left_ankle", "right_ankle", None,
    "left_big_toe", "right_big_toe", "neck", None, None, "head", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
"""Landmark of each joint; None of pelvis, spine and collars, which are none. SMPL-H and SMPL-X begin alike; hands
follow, and are left out. `head` is the joint at its base."""
ARRAYS = ("joints", "person", "joints3d", "positions")
RATES = ("fps", "mocap_framerate", "mocap_frame_rate", "frame_rate")
_CLEAR = 0.7  # length of the mean of directions from which somebody stands most of the time
_NEEDED = f"an array {', '.join(ARRAYS)} of (frames, {len(JOINTS)} or more joints, 3) is needed"


def has_smpl_joints(arrays: Mapping[str, np.ndarray]) -> bool:
    """Whether one of the arrays has a name that files of such joints give theirs."""
    return any(name in arrays for name in ARRAYS)


def load_smpl_joints(
    path: str | Path, *, up: str | None = None, unit: str | None = None, fps: float | None = None
) -> SourceMotion:
    """Read an npz of SMPL-ordered joints: one of `ARRAYS`, and frames per second as one of `RATES`.

    up: the axis that points up, one of `UPS`; unless given that along which the head is above the feet on average, with
    a note. unit: of length, m unless given. fps: instead of what the file says. A joint at exactly zero in a frame
    whose others are not is data; NaN is missing.

    Raises
    ------
    InputError: no such file, damaged, arrays of another shape, no rate, a rate, axis or unit that does not exist, no
        joint known, joints farther apart than in any body, nobody can know which way is up.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "no such file")
    if up is not None and up not in UPS:
        raise InputError("up", f"{shown(up)} is no axis", remedy=f"one of {', '.join(UPS)}")
    if unit is not None and unit not in METRES:
        raise InputError("unit", f"{shown(unit)} is no unit of length", remedy=f"one of {', '.join(METRES)}")
    arrays = read_npz(path)
    joints = metres_in(unit or "m", path, "unit") * _joints(arrays, path)
    times = np.arange(len(joints)) / _rate(arrays, path, len(joints), fps)
    chosen = [i for i, name in enumerate(JOINTS) if name is not None]
    points = checked_points(path, joints[:, chosen])
    if not np.isfinite(points).all(axis=2).any():
        raise InputError(path, "has no joint that is known: all are NaN")
    check_spread(points, unit or "m", path, "--unit")
    names = tuple(name for name in JOINTS if name is not None)
    notes: tuple[str, ...] = ()
    if up is None:
        up = _upward(names, points, path)
        notes = (f"{path.name}: {up} is taken to point up, by head and feet: --up says another",)
    return SourceMotion(names, points @ upright_world(up).T, times, path.name, notes)


def _joints(arrays: Mapping[str, np.ndarray], path: Path) -> np.ndarray:
    """The joints (T, J, 3) in the file's unit."""
    name = next((name for name in ARRAYS if name in arrays), None)
    if name is None:
        raise InputError(path, "has no joints", remedy=f"{_NEEDED}; it has {', '.join(arrays) or 'nothing'}")
    joints = number_array(arrays[name], path, name)
    if joints.ndim != 3 or joints.shape[2] != 3 or joints.shape[1] < len(JOINTS):
        raise InputError(path, f"is of shape {joints.shape}", place=name, remedy=_NEEDED)
    if not len(joints):
        raise InputError(path, "has no frame", place=name)
    return joints


def _rate(arrays: Mapping[str, np.ndarray], path: Path, frames: int, fps: float | None) -> float:
    """Frames per second: the user's, else the file's; of one frame it does not matter."""
    if fps is not None:
        return checked_rate("fps", fps)
    name = next((name for name in RATES if name in arrays), None)
    if name is None:
        if frames == 1:
            return 1.0
        raise InputError(path, "does not say its frames per second", remedy=f"--fps gives them, or an array {RATES[0]}")
    rate = number_array(arrays[name], path, name)
    if rate.size != 1:
        raise InputError(path, "one number is needed", place=name)
    return checked_rate(path, float(rate.reshape(())))


def _upward(names: tuple[str, ...], points: np.ndarray, path: Path) -> str:
    """The axis, one of `UPS`, along which the head is above the feet in points (T, L, 3) on average."""
    at = names.index
    head, feet = points[:, at("head")], points[:, [at("left_ankle"), at("right_ankle")]].mean(axis=1)
    rise = head - feet
    rise = rise[np.isfinite(rise).all(axis=1)]
    length = np.linalg.norm(rise, axis=1, keepdims=True)
    mean = (rise / np.maximum(length, 1e-12)).mean(axis=0) if len(rise) else np.zeros(3)
    up = max(UPS, key=lambda name: float(axis_of(name) @ mean))
    if not float(axis_of(up) @ mean) > _CLEAR:
        problem = "does not say which axis points up, and the head is above the feet along none for most of the time"
        raise InputError(path, problem, remedy=f"--up says it, one of {', '.join(UPS)}")
    return up
