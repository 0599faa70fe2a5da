"""The motions that robots are to follow: persons recovered from video, and captured walks, turns, runs and a jump."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.npz import read_npz
from estimator.retargeting.contacts import SourceContacts, source_contacts
from estimator.retargeting.source import SourceMotion, filled
from humanoid.kinematics.body import ROOT_PLACE_Q, ROOT_TURN_Q, Body
from humanoid.support.errors import InputError
from kinemode.inputs.motions import load_source

ASAP = (
    "CR7_level1", "jump_degree_level3", "jump_forward_level2", "kick_level2", "shoot_level2", "side_jump_level1",
    "single_foot_balance_level2", "squat_level1", "squat_level3", "step_forward_forward_level2", "walk_level1",
    "walk_level3",
)  # fmt: skip
CAPTURED = {
    "walk_straight_07_01": "mocap", "walk_turn_26_01": "mocap", "run_02_03": "mocap", "jump_16_01": "mocap",
    "cmu_02_01": "mocap_more", "cmu_05_03": "mocap_more", "cmu_07_04": "mocap_more", "cmu_08_01": "mocap_more",
    "cmu_12_02": "mocap_more", "cmu_35_17": "mocap_more",
}  # fmt: skip
"""Walks at several paces and with long strides, two turns by a half, two runs, a jump; and their folders."""
G1 = "example-robot-data:g1"
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
ASAP_JOINTS = (
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _LEG),
    *(f"waist_{part}_joint" for part in ("yaw", "roll", "pitch")),
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _ARM),
)
"""Of the peer's 23 angles, by name."""
_LONGEST = 0.5  # s of a gap


class RetargetTrial(NamedTuple):
    """A motion to follow. path: its file. source, contacts: what it is. own: whether it comes with a peer's motion of
    G1."""

    name: str
    path: Path
    source: SourceMotion
    contacts: SourceContacts
    own: bool


def trials_of(folder: Path, clips: Sequence[str], seconds: float) -> list[RetargetTrial]:
    """The first seconds of each clip; raises InputError where the data has not got it."""
    made = []
    for name in clips:
        path = folder / "asap" / f"{name}.npz" if name in ASAP else folder / CAPTURED[name] / f"{name}.bvh"
        if not path.is_file():
            raise InputError(path, "no such clip", remedy="--clips names others, --data another folder")
        source = beginning(filled(load_source(path), _LONGEST), seconds)
        made.append(RetargetTrial(name, path, source, source_contacts(source), name in ASAP))
    return made


def beginning(source: SourceMotion, seconds: float) -> SourceMotion:
    """The first seconds."""
    kept = source.times - source.times[0] < seconds
    return replace(source, points=source.points[kept], times=source.times[kept])


def peer_motion(body: Body, trial: RetargetTrial) -> np.ndarray:
    """Configurations (T, nq) of G1 that the peer made of the trial's motion, the wrists, which it has not, at zero."""
    arrays = read_npz(trial.path)
    count = len(trial.source.times)
    q = np.tile(body.neutral, (count, 1))
    turn = arrays["root_quaternion"][:count].astype(float)
    q[:, ROOT_PLACE_Q] = arrays["root_position"][:count]
    q[:, ROOT_TURN_Q] = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    for column, name in enumerate(ASAP_JOINTS):
        q[:, body.q_names.index(name)] = arrays["dof"][:count, column]
    for i, name in enumerate(body.q_names):
        if "_wrist_" in name:
            q[:, i] = 0.0
    return q
