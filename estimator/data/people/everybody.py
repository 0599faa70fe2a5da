"""Everybody in several cameras: each person's keypoints in each camera, over time.

Detections are joined as for one subject (`across_cameras`), but all groups count: each exchanges detections with every
other until no exchange is an improvement, and groups that follow each other soon are one person. No detection is two
people's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.formats.people_tracks import AUTO, ids_of, jump_note, largest_first, select
from estimator.data.people.across_cameras import (
    camera_detections,
    instants_of,
    left_out,
    no_common_person,
    seen_by_one,
    track_of_rows,
)
from estimator.data.people.agreement import pair_affinities, piece_affinities
from estimator.data.people.changes import cut_where_people_change
from estimator.data.people.choice_of_subject import continues, group_everybody, seen_together
from estimator.data.people.pieces import Table, table_of
from humanoid.support.errors import InputError

FEWEST = 10
"""Least number of frames in which a person is seen, by two cameras at once where there are several."""
_LONGEST_ABSENCE = 60  # instants after which a returning person counts as another one

Tracks = dict[str, KeypointTrack]


def everybody(
    files: Mapping[str, PeopleFile], cameras: Mapping[str, Camera], times: Mapping[str, np.ndarray] | None = None
) -> tuple[list[Tracks], tuple[str, ...]]:
    """The keypoints of each person by camera, all missing in cameras that do not see them; and notes on who is left
    out. People are in order of size x confidence, summed over the frames.

    files, cameras, times: see `across_cameras.subject_tracks`. Left out are those seen in fewer than 10 frames (in
    clips of fewer than 20, half of them), and, where there are several cameras, those never seen by two at once.

    Raises
    ------
    InputError: no person is left.
    """
    if len(files) < 2:
        ((name, file),) = files.items()
        return _of_one_camera(name, file)
    instants, views = instants_of(times or {}), [cameras[name] for name in files]
    table = table_of([camera_detections(file, cameras[name], AUTO, instants.get(name)) for name, file in files.items()])
    affinities = pair_affinities(table, views)
    table = cut_where_people_change(table, affinities)
    people = _joined(table, views, group_everybody(table, piece_affinities(table, affinities))[table.piece])
    shared = seen_together(table, people)
    count = int(people.max(initial=-1)) + 1
    lengths = np.array([len(np.unique(table.instant[shared & (people == who)])) for who in range(count)])
    score = np.bincount(people[shared], table.weight[shared], count)
    enough = _enough(len(np.unique(table.instant)))
    kept = [who for who in np.argsort(-score, kind="stable").tolist() if lengths[who] >= enough]
    if not kept:
        raise no_common_person(list(files))
    notes = left_out([int(n) for n in lengths if 0 < n < enough], enough)
    notes += seen_by_one(list(files), table, np.isin(people, np.flatnonzero(lengths == 0)), people, enough)
    return [_tracks(files, table, people == who) for who in kept], notes


def _enough(frames: int) -> int:
    return max(1, min(FEWEST, frames // 2))


def _tracks(files: Mapping[str, PeopleFile], table: Table, rows: np.ndarray) -> Tracks:
    return {
        name: track_of_rows(file, table, np.flatnonzero(rows & (table.camera == c)))
        for c, (name, file) in enumerate(files.items())
    }


def _joined(table: Table, cameras: Sequence[Camera], group: np.ndarray) -> np.ndarray:
    """Person (D,) of each detection, from its group: groups that follow each other are one, the largest first."""
    shared, group = seen_together(table, group), group.copy()
    score = np.bincount(group[shared], table.weight[shared], int(group.max(initial=-1)) + 1)
    order = [g for g in np.argsort(-score, kind="stable").tolist() if score[g] > 0.0]
    for k, first in enumerate(order):
        for other in order[k + 1 :]:
            ours, theirs = group == first, group == other
            near = theirs.any() and _absence(table, ours & shared, theirs & shared) <= _LONGEST_ABSENCE
            if near and continues(table, cameras, shared, ours, theirs):
                group[theirs] = first
    return group


def _absence(table: Table, ours: np.ndarray, theirs: np.ndarray) -> float:
    """Instants between two groups of detections, 0 where they overlap; infinite where there is none."""
    a, b = table.instant[ours], table.instant[theirs]
    return max(0.0, float(b.min() - a.max()), float(a.min() - b.max())) if len(a) and len(b) else np.inf


def _of_one_camera(name: str, file: PeopleFile) -> tuple[list[Tracks], tuple[str, ...]]:
    """People by the ids of the file, or by following them through it."""
    people = [track.people for track in largest_first(file.frames)]
    if ids := ids_of(file.frames):
        people = [select(file.frames, who, file.source)[0] for who in sorted(ids)]
        people.sort(key=lambda detections: -sum(person.weight for person in detections.values()))
    enough = _enough(len(file.frames))
    kept = [of for of in people if len(of) >= enough]
    if not kept:
        raise InputError(file.source, f"has no person seen in {enough} frames", remedy="--person auto")
    notes = left_out([len(of) for of in people if len(of) < enough], enough)
    return [{name: file.track_of(of, [jump_note(of)])} for of in kept], notes
