"""Which frames and landmarks of a run and of a reference are compared; and a laboratory's markers as one, with its
world's placement in the run's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.runs.reference_motion import Reference
from humanoid.support.errors import InputError


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


_TURNED = 10.0  # angle between the two worlds from which it is reported [deg]
_LISTED = 12


def check_markers(shared: SharedLandmarks, names: Sequence[str], reference: Reference) -> None:
    """Raise InputError where fewer than three of the reference's markers are landmarks of a run that has `names`."""
    if reference.markers is None or len(shared.names) >= FEWEST:
        return
    problem = f"{len(shared.names)} of its markers are landmarks of the run, {FEWEST} are needed"
    remedy = f"markers of the reference: {listed(reference.names)}; landmarks of the run: {listed(names)}"
    raise InputError("reference", problem, place="names", remedy=remedy)


def marker_notes(
    pairs: ComparedFrames, names: Sequence[str], landmarks: np.ndarray, reference: Reference
) -> tuple[str, ...]:
    """Notes for a reference with markers: which of them are landmarks, which are not in the run, and by how much its
    world is turned. landmarks (T, M, 3) [m] of `names`: of the run."""
    if reference.markers is None:
        return ()
    notes = list(reference.notes)
    chosen = {ours: theirs for ours, theirs in reference.markers.items() if ours in pairs.shared.names}
    if chosen:
        each = (f"{ours} ({' and '.join(theirs)})" for ours, theirs in chosen.items())
        notes.append(f"joint centres of markers: {', '.join(each)}")
    used = {name for theirs in chosen.values() for name in theirs}
    others = [name for name in reference.names if name not in names and name not in used]
    if others:
        notes.append(f"markers that are not landmarks of the run by their names: {listed(others)}")
    turn = _heading(pairs.of(landmarks), pairs.truth)
    if abs(turn) > _TURNED:
        what = f"the reference's world is turned by {turn:.0f} deg about the vertical"
        notes.append(f"{what}: MPJPE counts that, PA-MPJPE does not")
    return tuple(notes)


def _heading(points: np.ndarray, truth: np.ndarray) -> float:
    """Angle about z [deg] that brings points (P, L, 3) nearest to the truth (P, L, 3), each frame about its mean."""
    known = np.isfinite(points).all(axis=(1, 2)) & np.isfinite(truth).all(axis=(1, 2))
    a, b = (x[known] - x[known].mean(axis=1, keepdims=True) for x in (points, truth))
    sine = np.sum(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    return float(np.rad2deg(np.arctan2(sine, np.sum(a[..., :2] * b[..., :2]))))


def listed(names: Sequence[str], most: int = _LISTED) -> str:
    """Names, the first of them where they are many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none") + more
