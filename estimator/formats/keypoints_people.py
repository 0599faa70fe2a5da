"""People found in single frames, and which of them is the subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from estimator.formats.checked_json import BEYOND, LARGEST, WITHIN
from humanoid.errors import InputError
from humanoid.landmarks import FORMATS

LAYOUT_BY_COUNT = {3 * len(names): layout for layout, names in FORMATS.items()}
_PATIENCE = 60  # frames after which somebody who left is somebody new
_FAR = 0.6  # two detections further apart than this many body sizes are two people


@dataclass(frozen=True)
class Person:
    """One detection of a person: points (J, 3) with x, y [px], NaN where missing, and confidence, 0 where missing."""

    points: np.ndarray
    id: str | None = None

    @property
    def size(self) -> float:
        """Diagonal of the points' bounding box [px], 0 for fewer than two."""
        xy = self.points[self.points[:, 2] > 0.0, :2]
        return float(np.linalg.norm(np.ptp(xy, axis=0))) if len(xy) > 1 else 0.0

    @property
    def weight(self) -> float:
        """Size times mean confidence."""
        return self.size * float(self.points[:, 2].mean())


@dataclass
class Notes:
    """What had to be put right while reading, counted."""

    counts: dict[str, int] = field(default_factory=dict)

    def add(self, what: str, count: int) -> None:
        """Count `count` further cases of `what`."""
        if count:
            self.counts[what] = self.counts.get(what, 0) + count

    @property
    def texts(self) -> tuple[str, ...]:
        """One line for each kind."""
        return tuple(f"{what} ({count} times)" for what, count in self.counts.items())


def cleaned(points: np.ndarray, notes: Notes, source: str | Path, place: str) -> np.ndarray:
    """Points (J, 3) with missing ones as NaN and confidence 0, confidences in [0, 1].

    A point is missing where its confidence is 0 (OpenPose writes 0, 0, 0) or where both coordinates are NaN.
    """
    points = points.copy()
    xy, confidence = points[:, :2], points[:, 2]
    missing = np.isnan(xy).all(axis=1)
    points[missing, 2] = 0.0
    wrong = ~missing & ~(np.abs(points) < LARGEST).all(axis=1)
    if wrong.any():
        bad = int(np.flatnonzero(wrong)[0])
        raise InputError(source, BEYOND, place=f"{place}, keypoint {bad}", remedy=WITHIN)
    notes.add("confidence above 1 taken as 1", int((confidence > 1.0).sum()))
    notes.add("negative confidence taken as 0: a missing point", int((confidence < 0.0).sum()))
    confidence[:] = np.clip(confidence, 0.0, 1.0)
    xy[confidence == 0.0] = np.nan
    return points


def select(
    frames: Mapping[int, Sequence[Person]], person: str | int, source: str | Path
) -> tuple[dict[int, Person], str]:
    """The subject's detection in each frame, and a note on the choice, empty where there was none to make.

    "auto": the track with the largest sum of size x confidence. An id the file has: the detections with that id. In a
    file without ids a number counts the tracks, the largest being 0.
    """
    ids = {p.id for people in frames.values() for p in people if p.id is not None}
    if person != "auto" and ids:
        if str(person) not in ids:
            raise InputError(source, f"has no person {person}", remedy=f"ids in it: {_listed(ids)}; or auto")
        return _with_id(frames, str(person)), f"person {person}"
    if person == "auto" and all(len(people) <= 1 for people in frames.values()):
        alone = {index: people[0] for index, people in frames.items() if people and people[0].size > 0.0}
        return alone, ""
    tracks = sorted(link(frames), key=lambda t: -sum(p.weight for p in t.values()))
    if not tracks:
        return {}, "no person in any frame"
    if person == "auto":
        subject = _rejoined(tracks)
        return subject, f"person found in {len(subject)} frames, the largest of {len(tracks)} tracks"
    try:
        index = int(person)
    except ValueError:
        index = -1
    if not 0 <= index < len(tracks):
        raise InputError(source, f"has no person {person}", remedy=f"0 (the largest) to {len(tracks) - 1}; or auto")
    return tracks[index], f"track {index} of {len(tracks)}"


def _rejoined(tracks: Sequence[dict[int, Person]]) -> dict[int, Person]:
    """The first track with those later ones that can be the same person: never seen beside it, and of its size."""
    subject = dict(tracks[0])
    size = np.median([p.size for p in subject.values()])
    for track in tracks[1:]:
        ratio = np.median([p.size for p in track.values()]) / size
        if 0.6 < ratio < 1.7 and not subject.keys() & track.keys():
            subject.update(track)
    return subject


def _with_id(frames: Mapping[int, Sequence[Person]], wanted: str) -> dict[int, Person]:
    chosen: dict[int, Person] = {}
    for index, people in frames.items():
        same = [p for p in people if p.id == wanted]
        if same:
            chosen[index] = max(same, key=lambda p: p.weight)
    return chosen


def link(frames: Mapping[int, Sequence[Person]]) -> list[dict[int, Person]]:
    """Tracks of people over time: each detection goes to the nearest track, closest pairs first.

    The order of people in a frame does not matter.
    """
    tracks: list[dict[int, Person]] = []
    last: list[int] = []
    for index in sorted(frames):
        people = [p for p in frames[index] if p.size > 0.0]
        alive = [k for k in range(len(tracks)) if index - last[k] <= _PATIENCE]
        pairs = [(_distance(tracks[k][last[k]], p), k, i) for k in alive for i, p in enumerate(people)]
        free, linked = set(alive), set()
        for distance, k, i in sorted(pairs):
            reach = _FAR * (1.0 + 0.05 * (index - last[k] - 1))  # a person unseen for a while has moved on
            if distance < reach and k in free and i not in linked:
                tracks[k][index], last[k] = people[i], index
                free.discard(k)
                linked.add(i)
        for i, p in enumerate(people):
            if i not in linked:
                tracks.append({index: p})
                last.append(index)
    return tracks


def _distance(a: Person, b: Person) -> float:
    """Mean distance of the points both have, in body sizes; of the middles where they share none."""
    both = (a.points[:, 2] > 0.0) & (b.points[:, 2] > 0.0)
    if both.any():
        gap = float(np.linalg.norm(a.points[both, :2] - b.points[both, :2], axis=1).mean())
    else:
        gap = float(np.linalg.norm(np.nanmean(a.points[:, :2], axis=0) - np.nanmean(b.points[:, :2], axis=0)))
    return gap / max(a.size, b.size)


def _listed(ids: set[str]) -> str:
    texts = sorted(ids, key=lambda s: (len(s), s))
    return ", ".join(texts[:20]) + (", ..." if len(texts) > 20 else "")
