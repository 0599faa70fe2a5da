"""Distances between a person's joints that stay, or nearly, whatever the person does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import mirror_index

_POSES = 12
_TURN = 0.6  # rad: standard deviation from rest of the joints in informative poses
_MOST = 0.04  # m, and
_SHARE = 0.12  # of the distance: larger changes are not a constant length
_SHORTEST = 0.06  # m
_STD = 0.06  # of the logarithm of a length, between people of one size
JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "heel", "big_toe")
"""The landmarks used: where a detector puts the points of a face depends on the side from which it sees it."""


class SegmentLengths(NamedTuple):
    """Lengths between the landmarks used.

    landmark (J,): their numbers among the body's. mirror (J,): the other side of each. first, second (S,): ends of the
    segments. mean, std (S,) [m]: of the lengths on the body as it is, and of their logarithms. slack (S,) [m]: by how
    much poses change them. left, right (P,): segments that mirror each other, and are about as long.
    """

    landmark: np.ndarray
    mirror: np.ndarray
    first: np.ndarray
    second: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    slack: np.ndarray
    left: np.ndarray
    right: np.ndarray

    def ratios(self, points: np.ndarray) -> np.ndarray:
        """Lengths of the segments (S,) between points (T, J, 3), the medians over time, over those of the body; NaN
        where none is known."""
        apart = np.linalg.norm(points[:, self.first] - points[:, self.second], axis=2)
        return np.asarray(np.nanmedian(apart, axis=0) / self.mean)

    def size(self, points: np.ndarray) -> float:
        """The size of a person with points (T, J, 3) relative to the body."""
        return float(np.nanmedian(self.ratios(points)))

    @staticmethod
    def of(body: Body, seen: Sequence[str | None]) -> SegmentLengths:
        """The lengths of a body, between its limb joints, or all landmarks where it has none. seen: names of
        keypoints."""
        known = [i for i, name in enumerate(body.landmark_names) if name in seen]
        limbs = [i for i in known if body.landmark_names[i].endswith(JOINTS)]
        landmark = np.array(limbs or known, dtype=np.int64)
        mirror = mirror_index([body.landmark_names[i] for i in landmark])
        rng, still = np.random.default_rng(0), pin.neutral(body.model)
        turns = _TURN * rng.normal(size=(_POSES, body.nv))
        poses = np.array([body.clamp(pin.integrate(body.model, still, turn)) for turn in turns])
        points = body.landmarks_of(body.placed(poses))[:, landmark]
        apart = np.linalg.norm(points[:, :, None] - points[:, None], axis=3)
        mean, slack = apart.mean(axis=0), apart.std(axis=0)
        stays = (slack < np.minimum(_MOST, _SHARE * mean)) & (mean > _SHORTEST)
        stays &= stays[np.ix_(mirror, mirror)]
        first, second = np.nonzero(np.triu(stays, 1))
        place = {pair: i for i, pair in enumerate(zip(first.tolist(), second.tolist(), strict=True))}
        mirrored = (sorted((int(mirror[a]), int(mirror[b]))) for a, b in place)
        other = [place[a, b] for a, b in mirrored]
        pairs = np.array([(i, k) for i, k in enumerate(other) if i < k], dtype=np.int64).reshape(-1, 2)
        std = np.full(len(first), _STD)
        return SegmentLengths(
            landmark, mirror, first, second, mean[first, second], std, slack[first, second], *pairs.T
        )  # fmt: skip
