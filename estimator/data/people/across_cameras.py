"""One person in several cameras: the one that they see together, chosen by geometry; with notes for the user.

Every camera's detections are linked over time and cut where two people may have changed places. Pieces of two cameras
are one person's where the rays of the landmarks both saw meet, frame after frame; pieces are joined greedily by the
evidence for it, and the largest person that at least two cameras see is the subject. A camera contributes the pieces
that fit, and nothing where none does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack, PeopleFile
from estimator.data.formats.people_tracks import AUTO, crowded, ids_of, jump_note, select
from estimator.data.people.agreement import FIT, PairAffinities, median_distance, pair_affinities, piece_affinities
from estimator.data.people.changes import cut_where_people_change
from estimator.data.people.choice_of_subject import subject_rows
from estimator.data.people.pieces import CameraDetections, Table, table_of
from humanoid.support.errors import InputError

_DOUBTFUL = 0.02  # body sizes: two people who stand near each other may fit as well as this


def no_common_person(names: Sequence[str]) -> InputError:
    """Note for clips in which no two cameras see a person together."""
    problem = f"of several people in {', '.join(names)} none is seen by two cameras: rays of no two of them meet"
    remedy = (
        "are calibration, sizes and clocks of the files right? or name the person for each camera: --person CAMERA=WHO"
    )
    return InputError("keypoints", problem, remedy=remedy)


def summary(table: Table, affinities: PairAffinities, subject: np.ndarray, names: Sequence[str]) -> str:
    """The cameras' common choice, and how well they agree."""
    used = subject[affinities.first] & subject[affinities.second]
    seen = [name for c, name in enumerate(names) if subject[table.camera == c].any()]
    if not used.any():
        return f"several people: no one in the other cameras fits the person given for {', '.join(seen)}"
    share = float(np.nanmedian(affinities.distance[used]))
    together = f"several people: {', '.join(seen)} see the same person"
    if share > _DOUBTFUL:
        doubt = "are they the same, and calibration, sizes and clocks right? --person CAMERA=WHO chooses another"
        return f"{together}, but their rays miss each other by {share:.1%} of the body's size: {doubt}"
    return f"{together}, their rays meet within {share:.1%} of the body's size; --person CAMERA=WHO chooses another"


def selection_note(table: Table, ids_there: int, rows: np.ndarray, c: int, given: str) -> str:
    """The person chosen in camera c: some rows of the table. ids_there: number of ids in its file. given: the user's
    choice, or "auto"."""
    if given != AUTO:
        return f"person {given}, as given"
    if not len(rows):
        return "no one in it fits the person of the other cameras: it is not used"
    ids = sorted({table.people[row].id for row in rows} - {None}, key=str)
    tracks = np.unique(table.track[rows]).tolist()
    total = len(np.unique(table.track[table.camera == c]))
    chosen = f"id {', '.join(map(str, ids))}" if ids else f"track {', '.join(map(str, tracks))}"
    frames = len(np.unique(table.frame[rows]))
    return f"{chosen} of {ids_there or total} people, in {frames} frames"


def misfits(names: Sequence[str], table: Table, affinities: PairAffinities, *, several: bool) -> tuple[str, ...]:
    """Cameras whose person, chosen without the others, fits few of theirs. several: whether there was a choice."""
    limit = _DOUBTFUL if several else FIT
    apart = np.array([[median_distance(table, affinities, a, b) for b in range(len(names))] for a in range(len(names))])
    by_camera: dict[str, str] = {}
    for c, name in enumerate(names):
        known = np.isfinite(apart[c])
        if known.any() and np.mean(apart[c, known] > limit) > 0.5:
            far = np.flatnonzero(known & (apart[c] > limit)).tolist()
            share, others = min(apart[c, far]), ", ".join(names[k] for k in far)
            by_camera[name] = (
                f"not where {others} sees one (rays pass each other by {share:.0%} of the body's size or more):"
                " another person, another time, or a wrong calibration?"
            )
    some = dict(list(by_camera.items())[: 1 if len(names) == 2 else None])  # of two, each is as far from the other
    return tuple(f"{name}: its person is {what}" for name, what in some.items())


def left_out(lengths: Sequence[int], fewest: int) -> tuple[str, ...]:
    """People who are seen for too short a time: in so many frames each."""
    if not lengths:
        return ()
    frames = f"{min(lengths)} to {max(lengths)} frames" if min(lengths) < max(lengths) else f"{max(lengths)} frames"
    who = "one person" if len(lengths) == 1 else f"{len(lengths)} people"
    return (f"{who} seen in {frames} alone, fewer than {fewest}, left out: ghosts of the detector, or passers-by",)


def seen_by_one(
    names: Sequence[str], table: Table, rows: np.ndarray, people: np.ndarray, fewest: int
) -> tuple[str, ...]:
    """People (D,) whom one camera alone sees, at some rows (D,) of the table; those of fewer frames are not
    reported."""
    notes = []
    for c, name in enumerate(names):
        here = rows & (table.camera == c)
        counts = np.unique(people[here], return_counts=True)[1]
        lengths = counts[counts >= fewest].tolist()
        if lengths:
            who = "one person" if len(lengths) == 1 else f"{len(lengths)} people"
            notes.append(
                f"{name}: {who} in {', '.join(map(str, lengths))} frames whom no other camera sees, left out: a track"
                f" of {name} alone has them"
            )
    return tuple(notes)


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
