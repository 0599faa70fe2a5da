"""Joints at exactly zero, which is how lifting networks and detectors write what they did not find."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from humanoid.subject.landmarks import without_side

_CONVENTION = 0.9  # share of the frames in which the joint that a program put the origin at is there


def without_zeros(joints: np.ndarray) -> np.ndarray:
    """Joints (T, J, 3) with NaN where one is at exactly zero."""
    return np.where(_at_zero(joints)[..., None], np.nan, joints)


def with_origin(joints: np.ndarray, names: Sequence[str | None]) -> tuple[np.ndarray, str]:
    """Joints (T, J, 3) of which the first have landmarks' names, None of others, without those that were not found, and
    what was left out, empty where nothing was.

    A joint on the body's middle that is at zero in nearly all frames that have others is where the origin was put; a
    knee or a wrist there was never found.
    """
    zero = _at_zero(joints)
    whole = np.asarray(zero.all(axis=1))
    with_joints = zero[~whole]
    origin = np.asarray(with_joints.sum(axis=0) >= _CONVENTION * max(len(with_joints), 1))
    origin[[i for i, name in enumerate(names) if name is not None and without_side(name) != name]] = False
    zero &= ~(origin & ~whole[:, None])
    return np.where(zero[..., None], np.nan, joints), _left_out(int(whole.sum()), int(zero[~whole].sum()))


def _at_zero(joints: np.ndarray) -> np.ndarray:
    """Which joints (T, J) of (T, J, 3) are at exactly zero."""
    return np.asarray((joints == 0.0).all(axis=2))


def _left_out(frames: int, single: int) -> str:
    """So many frames without any joint, and single joints of others."""
    parts = [f"all joints of {frames} frame{'s' if frames > 1 else ''}"] if frames else []
    parts += [f"{single} single joint{'s' if single > 1 else ''}"] if single else []
    return f"{' and '.join(parts)} are at exactly zero and taken for missing" if parts else ""
