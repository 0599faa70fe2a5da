"""Which of several people in one camera is the subject, by this camera alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from estimator.data.formats.keypoints_people import Person
from estimator.data.formats.people_tracks import PersonTrack, apart, link
from humanoid.support.errors import InputError, first_of

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
