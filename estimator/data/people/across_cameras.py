"""One person in several cameras: the one that they see together, chosen by geometry.

Every camera's detections are linked over time and cut where two people may have changed places. Pieces of two cameras
are one person's where the rays of the landmarks both saw meet, frame after frame; pieces are joined greedily by the
evidence for it, and the largest person that at least two cameras see is the subject. A camera contributes the pieces
that fit, and nothing where none does.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.formats.people_choice import AUTO, crowded, ids_of, jump_note, select
from estimator.data.people.agreement import pair_affinities, piece_affinities
from estimator.data.people.changes import cut_where_people_change
from estimator.data.people.choice_of_subject import subject_rows
from estimator.data.people.notes import misfits, no_common_person, selection_note, summary
from estimator.data.people.pieces import CameraDetections, Table, table_of

PersonOf = Mapping[str, str | int]


def subject_tracks(
    files: Mapping[str, PeopleFile],
    cameras: Mapping[str, Camera],
    persons: PersonOf,
    times: Mapping[str, np.ndarray] | None = None,
) -> tuple[dict[str, KeypointTrack], tuple[str, ...]]:
    """Keypoints of the subject in each camera, and notes on the choice.

    Parameters
    ----------
    files, cameras: by the same names; the cameras are those of pictures of the size that the files were made from.
    persons: the chosen person in each camera, "auto" or a person of that file (see `people_choice.select`); "auto" for
    a camera that is not named.
    times: of each frame of a file [s], on one clock; without them frames of the same number were recorded together.

    Where there are several people and several cameras, those left to "auto" are chosen to fit each other and the ones
    given; otherwise each file is chosen from alone, with a note on what does not fit.

    Raises
    ------
    InputError: a person that a file does not have; no person in any camera fits one in another.
    """
    given = {name: str(persons.get(name, AUTO)) for name in files}
    instants = instants_of(times or {})
    free = [name for name in files if given[name] == AUTO]
    if len(files) < 2 or not free or not any(crowded(file.frames) for file in files.values()):
        return _each_for_itself(files, cameras, given, instants)
    all_detections = [
        camera_detections(file, cameras[name], given[name], instants.get(name)) for name, file in files.items()
    ]
    table = table_of(all_detections)
    affinities = pair_affinities(table, [s.camera for s in all_detections])
    table = cut_where_people_change(table, affinities)
    subject = subject_rows(table, [s.camera for s in all_detections], piece_affinities(table, affinities))
    if not subject.any():
        raise no_common_person(list(files))
    tracks, notes = {}, [summary(table, affinities, subject, list(files))]
    for c, (name, file) in enumerate(files.items()):
        rows = np.flatnonzero(subject & (table.camera == c))
        tracks[name] = track_of_rows(file, table, rows)
        notes.append(f"{name}: {selection_note(table, len(ids_of(file.frames)), rows, c, given[name])}")
    return tracks, tuple(notes)


def track_of_rows(file: PeopleFile, table: Table, rows: np.ndarray) -> KeypointTrack:
    """The keypoints of some rows of the table, all of one camera; of several in a frame the largest."""
    chosen = {int(table.frame[row]): table.people[row] for row in rows[np.argsort(table.weight[rows])]}
    return file.track_of(chosen, [jump_note(chosen)])


def instants_of(times: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Numbers of the instants that the files' frames show, counted at the highest rate of all."""
    steps = [float(np.median(np.diff(of))) for of in times.values() if len(of) > 1]
    begin = min((float(of[0]) for of in times.values() if len(of)), default=0.0)
    step = min(steps, default=1.0)
    return {name: np.round((of - begin) / step).astype(np.int64) for name, of in times.items()}


def camera_detections(file: PeopleFile, camera: Camera, person: str, instants: np.ndarray | None) -> CameraDetections:
    """Content of a camera's file; person: the chosen one there, "auto" for the one that fits the others."""
    chosen = None if person == AUTO else select(file.frames, person, file.source)[0]
    return CameraDetections(camera, file.reading.names, file.frames, chosen, instants)


def _each_for_itself(
    files: Mapping[str, PeopleFile],
    cameras: Mapping[str, Camera],
    given: Mapping[str, str],
    instants: Mapping[str, np.ndarray],
) -> tuple[dict[str, KeypointTrack], tuple[str, ...]]:
    """The tracks that each file chooses alone, and notes on cameras whose person fits none of the others'."""
    tracks = {name: file.one(given[name]) for name, file in files.items()}
    if len(files) < 2:
        return tracks, ()
    all_detections = [
        CameraDetections(cameras[n], f.reading.names, {}, select(f.frames, given[n], f.source)[0], instants.get(n))
        for n, f in files.items()
    ]
    table = table_of(all_detections)
    several = any(crowded(file.frames) for file in files.values())
    return tracks, misfits(
        list(files), table, pair_affinities(table, [s.camera for s in all_detections]), several=several
    )
