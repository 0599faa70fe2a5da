"""Notes for the user on a person chosen in several cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.formats.people_choice import AUTO
from estimator.data.people.agreement import FIT, PairAffinities, median_distance
from estimator.data.people.pieces import Table
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
