"""Which frames of a run and of a reference are of the same moment, and which of their landmarks are compared."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.runs.reference_motion import Reference


class ComparedFrames(NamedTuple):
    """A run's frames that a reference has too, P of them, and the L landmarks that both have.

    shared: the landmarks. frame (P,): the run's frames. truth (P, L, 3): where the landmarks were [m], NaN if unknown.
    """

    shared: SharedLandmarks
    frame: np.ndarray
    truth: np.ndarray

    def of(self, landmarks: np.ndarray) -> np.ndarray:
        """The compared landmarks (P, ..., L, 3) among all of the run's T frames (T, ..., M, 3)."""
        return np.asarray(landmarks[self.frame][..., self.shared.ours, :])

    def truth_of_frames(self, count: int) -> np.ndarray:
        """The truth (T, L, 3) [m] of each of the run's `count` frames, NaN in those that the reference lacks."""
        truth = np.full((count, *self.truth.shape[1:]), np.nan)
        truth[self.frame] = self.truth
        return truth


def paired(
    names: Sequence[str], time: np.ndarray, reference: Reference, joints: Sequence[str] | None = None
) -> ComparedFrames:
    """Comparable landmarks and frames of a run with landmarks `names` at `time` (T,) [s]; joints: see
    `shared_landmarks`."""
    shared = shared_landmarks(names, reference.names, joints)
    frame = match_frames(time, reference.time, len(reference.points))
    there = frame >= 0
    return ComparedFrames(shared, frame[there], reference.points[there][:, shared.theirs])


def match_frames(time: np.ndarray, reference_time: np.ndarray | None, count: int) -> np.ndarray:
    """Index of the run's frame for each of the reference's `count` frames, -1 where there is none, (count,).

    time (T,) of the run, reference_time (count,) [s]: the nearest within half a frame of the slower of the two;
    without reference times, the frame of the same number.
    """
    if reference_time is None or len(time) == 0:
        index = np.arange(count)
        return np.where(index < len(time), index, -1)
    order = np.argsort(time)
    ordered = time[order]
    right = np.clip(np.searchsorted(ordered, reference_time), 0, len(time) - 1)
    left = np.maximum(right - 1, 0)
    closer = np.abs(ordered[left] - reference_time) <= np.abs(ordered[right] - reference_time)
    nearest = np.where(closer, left, right)
    # a finer reference is thinned to the run's frames: each is compared with one frame only
    half = 0.5 * max(_period(ordered), _period(np.sort(reference_time))) + 1e-6
    gap = np.abs(ordered[nearest] - reference_time)
    matched = np.where(gap <= half, nearest, -1)
    for i in np.unique(matched[matched >= 0]):
        rivals = np.flatnonzero(matched == i)
        matched[np.delete(rivals, np.argmin(gap[rivals]))] = -1
    return np.where(matched >= 0, order[matched], -1)


def _period(time: np.ndarray) -> float:
    return float(np.median(np.diff(time))) if len(time) > 1 else 0.0


_PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


LIMB_JOINTS = tuple(f"{side}_{part}" for part in _PARTS for side in ("left", "right"))


HIPS = ("left_hip", "right_hip")


FEWEST = 3  # fewer points do not fix a rotation


HIPS_ALIGNED, CENTRED, UNALIGNED = "hips aligned", "centred", "nothing aligned"


class SharedLandmarks(NamedTuple):
    """Landmarks that are compared. ours, theirs (L): their places on either side. root: places among the L of those
    whose midpoint is moved to the origin, None for none. aligned: the same in words."""

    names: tuple[str, ...]
    ours: list[int]
    theirs: list[int]
    root: list[int] | None
    aligned: str


def shared_landmarks(
    ours: Sequence[str], theirs: Sequence[str], joints: Sequence[str] | None = None
) -> SharedLandmarks:
    """The landmarks that are compared of those that both sides have: a person's twelve limb joints, so that figures of
    people are comparable, or all of them where fewer than three are limb joints. joints: these instead.

    Hips are aligned where both are among them; otherwise the mean of all, and with fewer than three nothing.
    """
    both = [name for name in ours if name in theirs]
    limbs = [name for name in (LIMB_JOINTS if joints is None else joints) if name in both]
    names = tuple(limbs if joints is not None or len(limbs) >= FEWEST else both)
    at_ours, at_theirs = ([list(have).index(name) for name in names] for have in (ours, theirs))
    root, aligned = _root(names)
    return SharedLandmarks(names, at_ours, at_theirs, root, aligned)


def _root(names: Sequence[str]) -> tuple[list[int] | None, str]:
    if set(HIPS) <= set(names):
        return [names.index(hip) for hip in HIPS], HIPS_ALIGNED
    return (list(range(len(names))), CENTRED) if len(names) >= FEWEST else (None, UNALIGNED)
