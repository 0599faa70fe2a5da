"""A laboratory's markers as a reference: which were compared, and how their world lies to the run's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.runs.pairs import FEWEST, ComparedFrames, SharedLandmarks
from estimator.runs.reference_motion import Reference
from humanoid.support.errors import InputError

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
