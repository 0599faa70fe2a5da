"""Faults of a row that `track` would refuse, found before anything runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from humanoid.support.errors import InputError, shown
from kinemode.batches.columns import CLIPS, OF_A_ROW, PERSON, PERSON_ID, SUBJECT, column_of, columns
from kinemode.batches.tables import FaultList
from kinemode.batches.values import RowValues, is_built_in
from kinemode.checks import CHECKS, MARKERS
from kinemode.option import options_of
from kinemode.request import AUTO, USUAL_SUBJECT, DetectorOptions, TrackRequest

_TRACKER = "tracker"
_DETECTOR = ("detect", *options_of(DetectorOptions))


def track_arguments(row: RowValues) -> dict[str, Any]:
    """The arguments of `kinemode.track` that a row gives, without subject and clips."""
    return {PERSON if name == PERSON_ID else name: v for name, v in row.values.items() if name not in OF_A_ROW}


def check_row(row: RowValues, faults: FaultList) -> None:
    """Add the faults of a row whose single cells are valid."""
    if not {CLIPS, "keypoints", "points"} & (row.places.keys()):
        faults.add(row.place, "has neither clips nor keypoints", "name a video in the column clips")

    def collect(error: InputError) -> None:
        column = column_of(PERSON_ID if error.source in (PERSON, f"--{PERSON}") else error.source)
        if column is None:
            faults.add(row.place, f"{error.source}: {error.problem}", error.remedy)
        elif column.name not in row.faulty:
            place = row.places.get(column.name, row.place)
            faults.add(place, error.problem, error.remedy, column=column.name)

    request = TrackRequest(row.get(SUBJECT, USUAL_SUBJECT), row.get(CLIPS), **track_arguments(row))
    for declared in options_of(TrackRequest).values():
        with _collected(collect):
            declared.check(getattr(request, declared.name))
    files = {name for name, column in columns().items() if column.files or column.is_path}
    unread = {"files", "points"} if row.faulty & files else set()
    unread |= {"detector"} if row.faulty & {*_DETECTOR} else set()
    for name, check_options in CHECKS.items():
        if name not in unread:
            with _collected(collect):
                check_options(request)
    for check in (_height, _points, _method):
        with _collected(collect):
            check(row)


@contextmanager
def _collected(collect: Callable[[InputError], None]) -> Iterator[None]:
    """Within it an InputError is collected in place of being raised."""
    try:
        yield
    except InputError as error:
        collect(error)


def _points(row: RowValues) -> None:
    """Marker sets and units, which libraries know."""
    if row.faulty or not row.get("points"):
        return
    for name in ("markers", "unit"):
        if row.get(name, AUTO) != AUTO:
            _refused(name, row.get(name))


def _height(row: RowValues) -> None:
    height, subject = row.get("height"), row.get(SUBJECT, USUAL_SUBJECT)
    if height is None:
        return
    if SUBJECT not in row.faulty and not is_built_in(subject):
        raise InputError("height", f"{shown(subject)} is used as measured", remedy="leave it out")


def _method(row: RowValues) -> None:
    """Tracker, its settings and the cues: known once the libraries are loaded, which takes seconds, so only where they
    are given, and once for all rows that have the same."""
    names = (_TRACKER, "settings", "modes")
    if any(row.get(name) is not None for name in names) and not row.faulty & {*names}:
        usual = MARKERS if row.get("points") else None
        _refused(_TRACKER, (row.get(_TRACKER, usual), *(row.get(name) for name in names[1:])))
    if row.get("cues") is not None:
        _refused("cues", row.get("cues"))


def _of_column(column: str, check: Callable[[Any], Any], given: Any) -> None:
    """Run a check of a value; its InputError is then about the column."""
    try:
        check(given)
    except InputError as error:
        raise InputError(column, f"{error.source}: {error.problem}", remedy=error.remedy) from None


def _refused(what: str, given: Any) -> None:
    if (error := _refusal(what, given)) is not None:
        raise error


@cache
def _refusal(what: str, given: Any) -> InputError | None:
    """Why a value is refused, None where it is taken."""
    try:
        if what == "markers":
            from humanoid.subject.marker_set import marker_set

            _of_column(what, marker_set, given)
        elif what == "unit":
            from estimator.data.formats.opensim import checked_unit

            checked_unit(given)
        elif what == "cues":
            from kinemode.pictures import cue_choice

            cue_choice(given)
        else:
            from kinemode.settings import DEFAULT, choose

            tracker, settings, modes = given
            choose(tracker or DEFAULT, settings, modes)
    except InputError as error:
        return error
    return None
