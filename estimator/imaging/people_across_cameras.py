"""One person in several cameras: whom they see together, chosen by geometry.

Every camera's detections are linked over time and cut where two people may have changed places. Pieces of two cameras
are one person's where the rays of the landmarks both saw meet, frame after frame; pieces are put together greedily by
how much speaks for it, and the largest person that at least two cameras see is the subject. A camera contributes the
pieces that fit, and nothing where nobody does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from estimator.formats.keypoints import KeypointTrack, PeopleFile
from estimator.formats.people_choice import AUTO, crowded, ids_of, jump_note, select
from estimator.imaging.camera import Camera
from estimator.imaging.people_agreement import FIT, Evidence, affinity_of, evidence_of, median_distance
from estimator.imaging.people_changes import cut_where_people_change
from estimator.imaging.people_pieces import Sighting, Table, table_of
from estimator.imaging.people_subject import subject_rows
from humanoid.errors import InputError

PersonOf = Mapping[str, str | int]
_MISFIT = 2.0 * FIT  # body sizes: a camera whose person is farther than this from all others' is pointed out


def subject_tracks(
    files: Mapping[str, PeopleFile], cameras: Mapping[str, Camera], persons: PersonOf
) -> tuple[dict[str, KeypointTrack], tuple[str, ...]]:
    """Keypoints of the subject in each camera, and notes on the choice.

    Parameters
    ----------
    files, cameras: by the same names. persons: whom the user wants in each camera, "auto" or a person of that file (see
        `people_choice.select`); a camera that is not named is "auto".

    Where there is somebody to choose between and several cameras, those left to "auto" are chosen to fit each other and
    the ones given; otherwise each file chooses for itself, and what does not fit is told.

    Raises
    ------
    InputError: a person that a file has not; nobody in any camera fits anybody in another.
    """
    given = {name: str(persons.get(name, AUTO)) for name in files}
    free = [name for name in files if given[name] == AUTO]
    if len(files) < 2 or not free or not any(crowded(file.frames) for file in files.values()):
        tracks = {name: file.one(given[name]) for name, file in files.items()}
        return tracks, _misfits(files, cameras, given) if len(files) > 1 else ()
    sightings = [_sighting(file, cameras[name], given[name]) for name, file in files.items()]
    table = table_of(sightings)
    evidence = evidence_of(table, [s.camera for s in sightings])
    table = cut_where_people_change(table, evidence)
    subject = subject_rows(table, [s.camera for s in sightings], affinity_of(table, evidence))
    if not subject.any():
        raise _nobody(files)
    tracks, notes = {}, [_summary(table, evidence, subject, list(files))]
    for c, (name, file) in enumerate(files.items()):
        rows = np.flatnonzero(subject & (table.camera == c))
        chosen = {int(table.frame[row]): table.people[row] for row in rows[np.argsort(table.weight[rows])]}
        tracks[name] = file.track_of(chosen, [jump_note(chosen)])
        notes.append(f"{name}: {_told(table, file, rows, c, given[name])}")
    return tracks, tuple(notes)


def _sighting(file: PeopleFile, camera: Camera, person: str) -> Sighting:
    chosen = None if person == AUTO else select(file.frames, person, file.source)[0]
    return Sighting(camera, file.reading.names, file.frames, chosen)


def _nobody(files: Mapping[str, PeopleFile]) -> InputError:
    problem = f"of several people in {', '.join(files)} nobody is seen by two cameras: rays of no two of them meet"
    remedy = (
        "check that calibration and clips belong together and start at once, or name the person: CAMERA=WHO for each"
    )
    return InputError("keypoints", problem, remedy=remedy)


def _summary(table: Table, evidence: Evidence, subject: np.ndarray, names: Sequence[str]) -> str:
    """What the cameras agree on, and how well."""
    used = subject[evidence.first] & subject[evidence.second]
    seen = [name for c, name in enumerate(names) if subject[table.camera == c].any()]
    if not used.any():
        return f"several people: nobody in the other cameras fits the person given for {', '.join(seen)}"
    share = float(np.nanmedian(evidence.distance[used]))
    return (
        f"several people: {', '.join(seen)} see the same person, their rays meet within {share:.1%} of the body's size;"
        " --person CAMERA=WHO chooses another"
    )


def _told(table: Table, file: PeopleFile, rows: np.ndarray, c: int, given: str) -> str:
    """Who was chosen in a camera."""
    if given != AUTO:
        return f"person {given}, as given"
    if not len(rows):
        return "nobody in it fits the person of the other cameras: it contributes nothing"
    ids = sorted({table.people[row].id for row in rows} - {None}, key=str)
    tracks = np.unique(table.track[rows]).tolist()
    total = len(np.unique(table.track[table.camera == c]))
    whom = f"id {', '.join(map(str, ids))}" if ids else f"track {', '.join(map(str, tracks))}"
    frames = len(np.unique(table.frame[rows]))
    return f"{whom} of {len(ids_of(file.frames)) or total} people, in {frames} frames"


def _misfits(
    files: Mapping[str, PeopleFile], cameras: Mapping[str, Camera], given: Mapping[str, str]
) -> tuple[str, ...]:
    """Cameras whose person, each chosen by its file alone, fits none of the others'."""
    sightings = [
        Sighting(cameras[name], file.reading.names, {}, select(file.frames, given[name], file.source)[0])
        for name, file in files.items()
    ]
    table = table_of(sightings)
    evidence = evidence_of(table, [s.camera for s in sightings])
    names = list(files)
    apart = np.array([[median_distance(table, evidence, a, b) for b in range(len(names))] for a in range(len(names))])
    told = []
    for c, name in enumerate(names):
        known = np.isfinite(apart[c])
        if known.any() and (apart[c, known] > _MISFIT).all():
            others = ", ".join(names[k] for k in np.flatnonzero(known))
            share = min(1.0, float(apart[c, known].min()))
            told.append(
                f"{name}: its person is not where {others} see theirs (rays pass each other by {share:.0%} of the body's"
                " size or more): somebody else, another time, or a wrong calibration?"
            )
    return tuple(told)
