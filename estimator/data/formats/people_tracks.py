"""People linked over time in one camera, and which of them is the subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from estimator.data.formats.keypoints_reading import Person
from humanoid.support.errors import InputError, first_of

_PATIENCE = 60  # frames after which a person who left counts as a new one
_FAR = 0.6  # two detections further apart than this many body sizes are two people
_DRIFT = 0.05  # share by which that grows with each frame in which a person was not seen
_CLOSE = 0.1  # a rival less than this many body sizes farther away might have been meant
_LEAP = 0.25  # body sizes: a person who moved farther may be another one
_MOST_POINTS = 40  # compared of each person: layouts with hands and faces begin with the body
_MOST_PAIRS = 50_000  # compared at once


@dataclass(frozen=True)
class PersonTrack:
    """One person followed through one camera.

    people: the detection of each frame. doubtful: frames in which two people may have changed places, since another
    detection or another track was nearly as close, or the person moved far.
    """

    people: dict[int, Person]
    doubtful: set[int]

    @property
    def weight(self) -> float:
        """Sum of size times confidence."""
        return sum(p.weight for p in self.people.values())


def link(frames: Mapping[int, Sequence[Person]]) -> list[PersonTrack]:
    """Tracks of people over time: each detection goes to the nearest track, closest pairs first.

    The order of people in a frame does not matter.
    """
    tracks: list[PersonTrack] = []
    alive = _Alive.none()
    for index in sorted(frames):
        people = [p for p in frames[index] if p.size > 0.0]
        if not people:
            continue
        alive = alive.at(alive.last >= index - _PATIENCE)
        seen = _Alive.of(people, index)
        pairs = _pairs(alive, seen, _FAR * (1.0 + _DRIFT * (index - alive.last - 1)))
        linked = _closest_first(pairs, len(alive.last), len(people))
        for pair in linked.tolist():
            k, i = int(pairs.first[pair]), int(pairs.second[pair])
            seen.track[i] = alive.track[k]
            tracks[alive.track[k]].people[index] = people[i]
        for pair in linked[_rivalled(pairs, linked) | (pairs.distance[linked] > _LEAP)].tolist():
            tracks[alive.track[pairs.first[pair]]].doubtful.add(index)
        for i in np.flatnonzero(seen.track < 0).tolist():
            seen.track[i] = len(tracks)
            tracks.append(PersonTrack({index: people[i]}, set()))
        alive = alive.at(~np.isin(alive.track, seen.track)).and_also(seen)
    return tracks


def distance(a: Person, b: Person) -> float:
    """Mean distance of the points both have, in body sizes; of the middles where they share none."""
    distances = _distances(_Alive.of([a], 0), _Alive.of([b], 0), np.zeros(1, dtype=np.intp), np.zeros(1, dtype=np.intp))
    return float(distances[0])


def apart(a: Person, b: Person, frames: int) -> bool:
    """Whether b, a number of frames after a, is farther away than the same person would be."""
    return distance(a, b) >= _FAR * (1.0 + _DRIFT * (frames - 1))


@dataclass(frozen=True)
class _Alive:
    """Detections as arrays, and the tracks they end.

    xy (N, J, 2) [px]: of the points that are compared, NaN where missing. size (N,), low, high, middle (N, 2): of all
    points there are [px].
    track (N,): number of the track, -1 for none yet. last (N,): frame.
    """

    xy: np.ndarray
    size: np.ndarray
    low: np.ndarray
    high: np.ndarray
    middle: np.ndarray
    track: np.ndarray
    last: np.ndarray

    @staticmethod
    def none() -> _Alive:
        flat = np.zeros((0, 2))
        return _Alive(np.zeros((0, 0, 2)), np.zeros(0), flat, flat, flat, np.zeros(0, int), np.zeros(0, int))

    @staticmethod
    def of(people: Sequence[Person], frame: int) -> _Alive:
        points = np.stack([p.points for p in people])
        xy, seen = points[..., :2], points[..., 2:] > 0.0
        low = np.where(seen, xy, np.inf).min(axis=1)
        high = np.where(seen, xy, -np.inf).max(axis=1)
        middle = np.where(seen, xy, 0.0).sum(axis=1) / seen.sum(axis=1)
        size = np.array([p.size for p in people])
        first = np.where(seen, xy, np.nan)[:, :_MOST_POINTS]
        return _Alive(first, size, low, high, middle, np.full(len(size), -1), np.full(len(size), frame))

    def at(self, rows: np.ndarray) -> _Alive:
        """The selected detections."""
        return replace(self, **{name: values[rows] for name, values in vars(self).items()})

    def and_also(self, others: _Alive) -> _Alive:
        """These and the others, in the order of their tracks."""
        if not len(self.last):
            return others.at(np.argsort(others.track))
        both = {name: np.concatenate([values, getattr(others, name)]) for name, values in vars(self).items()}
        return _Alive(**both).at(np.argsort(both["track"]))


@dataclass(frozen=True)
class _Pairs:
    """Tracks and detections close enough to be one person: first, second (P,) their numbers, distance (P,)."""

    first: np.ndarray
    second: np.ndarray
    distance: np.ndarray


def _pairs(alive: _Alive, seen: _Alive, reach: np.ndarray) -> _Pairs:
    """Pairs closer than reach (K,), in body sizes; boxes farther apart than that are skipped."""
    across, down = (
        np.maximum(alive.low[:, axis, None] - seen.high[:, axis], seen.low[:, axis] - alive.high[:, axis, None])
        for axis in (0, 1)
    )
    gap = np.maximum(across, down)  # of the boxes, along the axis where it is wider
    first, second = np.nonzero(gap < reach[:, None] * np.maximum(alive.size[:, None], seen.size))
    parts = [slice(at, at + _MOST_PAIRS) for at in range(0, len(first), _MOST_PAIRS)]
    values = np.concatenate([np.zeros(0), *(_distances(alive, seen, first[p], second[p]) for p in parts)])
    near = values < reach[first]
    return _Pairs(first[near], second[near], values[near])


def _distances(a: _Alive, b: _Alive, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Distances (P,) of detections i (P,) of a to detections j (P,) of b, see `distance`."""
    step = a.xy[i] - b.xy[j]
    gaps = np.hypot(step[..., 0], step[..., 1])
    shared = np.isfinite(gaps)
    count = shared.sum(axis=1)
    mean = np.where(shared, gaps, 0.0).sum(axis=1) / np.maximum(count, 1)
    middles = np.hypot(*(a.middle[i] - b.middle[j]).T)
    return np.asarray(np.where(count > 0, mean, middles) / np.maximum(a.size[i], b.size[j]))


def _closest_first(pairs: _Pairs, tracks: int, people: int) -> np.ndarray:
    """Places of the pairs that are linked: the closest first, everyone once."""
    first, second = pairs.first.tolist(), pairs.second.tolist()
    free, left = [True] * tracks, [True] * people
    chosen = []
    for pair in np.lexsort((pairs.second, pairs.first, pairs.distance)).tolist():
        k, i = first[pair], second[pair]
        if free[k] and left[i]:
            free[k] = left[i] = False
            chosen.append(pair)
            if len(chosen) == min(tracks, people):
                break
    return np.array(chosen, dtype=np.intp)


def _rivalled(pairs: _Pairs, linked: np.ndarray) -> np.ndarray:
    """Which of the linked pairs had a rival nearly as close, at either end."""
    rivalled: np.ndarray = np.zeros(len(linked), dtype=bool)
    for end in (pairs.first, pairs.second):
        limit = np.full(int(end.max(initial=-1)) + 1, -np.inf)
        limit[end[linked]] = pairs.distance[linked] + _CLOSE
        close = np.bincount(end[pairs.distance < limit[end]], minlength=len(limit))
        rivalled |= close[end[linked]] > 1
    return rivalled


AUTO = "auto"
PeopleByFrame = Mapping[int, Sequence[Person]]


def select(frames: PeopleByFrame, person: str | int, source: str | Path) -> tuple[dict[int, Person], str]:
    """The subject's detection in each frame, and a note on the choice, empty where there was none to make.

    "auto": the track with the largest sum of size x confidence. An id the file has: the detections with that id. In a
    file without ids a number counts the tracks, the largest being 0.
    """
    if person != AUTO and ids_of(frames):
        return _with_id(frames, person, source), f"person {person}"
    if person == AUTO and not crowded(frames):
        alone = {index: people[0] for index, people in frames.items() if people and people[0].size > 0.0}
        return alone, ""
    tracks = largest_first(frames)
    if not tracks:
        return {}, "no person in any frame"
    if person == AUTO:
        subject = _rejoined(tracks)
        return subject, f"person found in {len(subject)} frames, the largest of {len(tracks)} tracks"
    try:
        index = int(person)
    except ValueError:
        index = -1
    if not 0 <= index < len(tracks):
        raise InputError(source, f"has no person {person}", remedy=f"0 (the largest) to {len(tracks) - 1}; or auto")
    return tracks[index].people, f"track {index} of {len(tracks)}"


def crowded(frames: PeopleByFrame) -> bool:
    """Whether there are several people to choose between."""
    return any(len(people) > 1 for people in frames.values())


def ids_of(frames: PeopleByFrame) -> set[str]:
    """The ids a file gives its people."""
    return {p.id for people in frames.values() for p in people if p.id is not None}


def largest_first(frames: PeopleByFrame) -> list[PersonTrack]:
    """The tracks of all people, those with the largest sum of size x confidence first."""
    return sorted(link(frames), key=lambda t: -t.weight)


def jumps(chosen: Mapping[int, Person]) -> list[int]:
    """Frames in which the chosen detection is too far from the one before to be the same person's."""
    seen = sorted(index for index, person in chosen.items() if person.size > 0.0)
    return [b for a, b in pairwise(seen) if apart(chosen[a], chosen[b], b - a)]


def jump_note(chosen: Mapping[int, Person]) -> str:
    """Message about jumps, empty where there are none."""
    frames_of_jumps = jumps(chosen)
    if not frames_of_jumps:
        return ""
    listed = first_of(frames_of_jumps, 5)
    frames = f"frame{'s' * (len(frames_of_jumps) != 1)}"
    return f"the keypoints jump to another person, or elsewhere, in {len(frames_of_jumps)} {frames} ({listed})"


def _rejoined(tracks: Sequence[PersonTrack]) -> dict[int, Person]:
    """The first track with those later ones that can be the same person: never seen beside it, and of its size."""
    subject = dict(tracks[0].people)
    size = np.median([p.size for p in subject.values()])
    for track in tracks[1:]:
        if track.people.keys().isdisjoint(subject):
            ratio = np.median([p.size for p in track.people.values()]) / size
            if 0.6 < ratio < 1.7:
                subject.update(track.people)
    return subject


def _with_id(frames: PeopleByFrame, person: str | int, source: str | Path) -> dict[int, Person]:
    known = ids_of(frames)
    if str(person) not in known:
        raise InputError(source, f"has no person {person}", remedy=f"ids in it: {_listed(known)}; or auto")
    chosen: dict[int, Person] = {}
    for index, people in frames.items():
        same = [p for p in people if p.id == str(person)]
        if same:
            chosen[index] = max(same, key=lambda p: p.weight)
    return chosen


def _listed(ids: set[str]) -> str:
    texts = sorted(ids, key=lambda s: (len(s), s))
    return first_of(texts, 20)
