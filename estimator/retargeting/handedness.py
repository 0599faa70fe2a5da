"""Whether left is left in a source: toes point to the front of who has the left hip on the left, and nobody turns round
between two frames."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from estimator.numerics.stretches import stretches
from estimator.retargeting.source import SourceMotion
from humanoid.support.errors import first_of

_SIDES = ("left", "right")
_PARTS = ("hip", "knee", "ankle", "big_toe")
_BACK = -0.2
"""Cosine of foot and front, in the middle of all frames. Of 126 motions the least is 0.32."""
_SHORTEST = 1e-9  # m
_LISTED = 4
_FASTEST = 2400.0
"""[degrees/s] Faster than anybody turns: a figure skater's record are 342 turns a minute, 2050 degrees a second."""
_ROUND = 120.0  # degrees: a turn that no noise of a line across the body makes


def turns_round(source: SourceMotion) -> tuple[int, ...]:
    """The frames before which the line across hips or shoulders turns round faster than anybody, as where left and
    right are exchanged from there on, or no longer."""
    frames = set[int]()
    for part in ("hip", "shoulder"):
        ends = [f"{side}_{part}" for side in _SIDES]
        if not set(ends) <= set(source.names):
            continue
        across = source.landmark(ends[0]) - source.landmark(ends[1])
        known = np.flatnonzero(np.linalg.norm(across, axis=1) > _SHORTEST)
        line = across[known] / np.linalg.norm(across[known], axis=1)[:, None]
        angle = np.degrees(np.arccos(np.clip((line[1:] * line[:-1]).sum(axis=1), -1.0, 1.0)))
        fast = angle > np.maximum(_ROUND, _FASTEST * np.diff(source.times[known]))
        frames |= set(known[1:][fast].tolist())
    return tuple(sorted(frames))


def mirrored_frames(source: SourceMotion) -> np.ndarray:
    """Frames (T,) bool of a source, or of its parts between such turns, that `is_mirrored`."""
    mirrored = np.zeros(len(source.times), dtype=bool)
    cuts = [0, *turns_round(source), len(mirrored)]
    for first, after in pairwise(cuts):
        part = slice(first, after)
        mirrored[part] = is_mirrored(replace(source, points=source.points[part], times=source.times[part]))
    return mirrored


def without_mirrored_parts(source: SourceMotion) -> SourceMotion:
    """The motion without its parts in which left and right are exchanged, which are missing then, with a note; as it is
    where all of it is mirrored, or nothing."""
    mirrored = mirrored_frames(source)
    if not mirrored.any() or mirrored.all():
        return source
    spans = [f"{source.times[first]:.2f} to {source.times[after - 1]:.2f} s" for first, after in stretches(mirrored)]
    what = "left and right are exchanged, as hips or shoulders turn round at once and toes point backwards,"
    note = f"{source.source}: {what} from {first_of(spans, _LISTED)}: taken for missing"
    points = np.where(mirrored[:, None, None], np.nan, source.points)
    return replace(source, points=points, notes=(*source.notes, note))


def is_mirrored(source: SourceMotion) -> bool:
    """Whether the toes of both feet point backwards, as where left and right are exchanged, or axes are left-handed.

    The front is across the hips and the shank, which a foot is never behind, however far somebody bends.
    """
    if not {f"{side}_{part}" for side in _SIDES for part in _PARTS} <= set(source.names):
        return False
    across = source.landmark("left_hip") - source.landmark("right_hip")
    cosines = [_forward(source, side, across) for side in _SIDES]
    return all(len(cosine) and float(np.median(cosine)) < _BACK for cosine in cosines)


def _forward(source: SourceMotion, side: str, across: np.ndarray) -> np.ndarray:
    """Cosines of a foot with the front, in the frames in which it is known."""
    knee, ankle, toe = (source.landmark(f"{side}_{part}") for part in _PARTS[1:])
    front, foot = np.cross(across, knee - ankle), toe - ankle
    length = np.linalg.norm(front, axis=1) * np.linalg.norm(foot, axis=1)
    known = length > _SHORTEST
    return np.asarray((front * foot).sum(axis=1)[known] / length[known])
