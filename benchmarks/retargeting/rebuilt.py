"""A person's landmarks rebuilt with a robot's lengths, as targets of inverse kinematics frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimator.retargeting.contacts import SourceContacts
from estimator.retargeting.likeness import leg_ratio
from estimator.retargeting.source import SourceMotion
from humanoid.kinematics.body import Body

_LIMBS = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
_SIDES = ("left", "right")
_SOLE = ("heel", "big_toe")


class RebuiltTargets(NamedTuple):
    """names (L): of the robot's landmarks. points (T, L, 3) [m]: where they are to be, on a floor at z = 0."""

    names: tuple[str, ...]
    points: np.ndarray


def rebuilt_targets(body: Body, source: SourceMotion, contacts: SourceContacts) -> RebuiltTargets:
    """The middle of the hips on the source's path scaled by the legs' ratio, limbs in the source's directions with the
    body's own lengths, soles level where the source's feet are."""
    own = dict(zip(body.landmark_names, body.landmarks(body.at(body.neutral)), strict=True))
    of, scale = source.landmark, leg_ratio(body, source)
    above = own["left_ankle"][2] - own["left_heel"][2]
    hips, shoulders = _middle(of, "hip"), _middle(of, "shoulder")
    root = scale * (hips - [0.0, 0.0, _ankle_level(source, contacts)]) + [0.0, 0.0, above]
    trunk = np.linalg.norm(_middle(own.__getitem__, "shoulder") - _middle(own.__getitem__, "hip"))
    placed = {}
    for part, place in (("hip", root), ("shoulder", root + trunk * _unit(shoulders - hips))):
        width = np.linalg.norm(own[f"left_{part}"] - own[f"right_{part}"])
        across = 0.5 * width * _unit(of(f"left_{part}") - of(f"right_{part}"))
        placed[f"left_{part}"], placed[f"right_{part}"] = place + across, place - across
    for upper, lower in _LIMBS:
        for side in _SIDES:
            begin, end = f"{side}_{upper}", f"{side}_{lower}"
            length = np.linalg.norm(own[begin] - own[end])
            placed[end] = placed[begin] + length * _unit(of(end) - of(begin))
    for side in _SIDES:
        turn = _foot_turns(source, contacts, side)
        for part in _SOLE:
            offset = own[f"{side}_{part}"] - own[f"{side}_ankle"]
            placed[f"{side}_{part}"] = placed[f"{side}_ankle"] + turn @ offset
    return RebuiltTargets(tuple(placed), np.stack(list(placed.values()), axis=1))


def _ankle_level(source: SourceMotion, contacts: SourceContacts) -> float:
    """Height of the ankles over a foot that stands flat [m]: the median; of those who never do the least."""
    heights = []
    for side in _SIDES:
        flat = _flat(contacts, side)
        heights.append(source.landmark(f"{side}_ankle")[flat, 2])
    level = np.concatenate(heights)
    if not len(level):
        level = np.array([min(np.nanmin(source.landmark(f"{side}_ankle")[:, 2]) for side in _SIDES)])
    return float(np.nanmedian(level))


def _flat(contacts: SourceContacts, side: str) -> np.ndarray:
    """Whether all of a foot stands (T,)."""
    return np.asarray(contacts.standing[:, [name.startswith(side) for name in contacts.names]].all(axis=1))


def _foot_turns(source: SourceMotion, contacts: SourceContacts, side: str) -> np.ndarray:
    """Rotations (T, 3, 3) of a foot whose toes point along x while it is level: heading and pitch of the source's."""
    way = source.landmark(f"{side}_big_toe") - source.landmark(f"{side}_ankle")
    rise = np.arctan2(way[:, 2], np.linalg.norm(way[:, :2], axis=1))
    flat = _flat(contacts, side)
    pitch = rise - np.nanmedian(rise[flat] if flat.any() else rise)
    heading = np.arctan2(way[:, 1], way[:, 0])
    ahead = np.stack([np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), np.sin(pitch)], axis=1)
    left = np.stack([-np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=1)
    return np.stack([ahead, left, np.cross(ahead, left)], axis=2)


def _middle(of: Callable[[str], np.ndarray], part: str) -> np.ndarray:
    return np.asarray(0.5 * (of(f"left_{part}") + of(f"right_{part}")))


def _unit(way: np.ndarray) -> np.ndarray:
    return np.asarray(way / np.linalg.norm(way, axis=-1, keepdims=True))
