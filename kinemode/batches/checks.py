"""What `track` would refuse of a row, found before anything runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache, partial
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError, shown
from kinemode.batches.columns import BY_CAMERA, CLIPS, OF_A_ROW, PERSON, PERSON_ID, SUBJECT, column_of
from kinemode.batches.faults import FaultList
from kinemode.batches.values import RowValues, is_built_in
from kinemode.detection.detectors import DETECTORS, DetectorChoice
from kinemode.inputs.declared import AUTO, Declared, moment, wants_all
from kinemode.inputs.files import InputFiles
from kinemode.inputs.named import named_pairs
from kinemode.inputs.point_options import MARKERS, check_fit, check_no_cameras, check_no_points, check_static
from kinemode.options import USUAL, DetectorOptions, InputOptions, PointOptions, TrackerOptions

_RENAMED = {"mask": "masks"}
"""Arguments of `track` that are called otherwise than the command's options."""
_TRACKER = "tracker"


def track_arguments(row: RowValues) -> dict[str, Any]:
    """The arguments of `kinemode.track` that a row gives, without subject and clips; raises InputError for options of a
    detector that has nothing to detect."""
    given = {PERSON if n == PERSON_ID else n: value for n, value in row.values.items() if n not in OF_A_ROW}
    by = _those_of(DetectorOptions, given)
    files = InputOptions(by=DetectorOptions(**by), **_those_of(InputOptions, given))
    points = PointOptions(**_those_of(PointOptions, given))
    how = TrackerOptions(**_those_of(TrackerOptions, given))
    arguments = files.arguments() | points.arguments() | how.arguments() | {_TRACKER: given.get(_TRACKER)}
    if arguments["detect"]:
        arguments["detect"] = by or True
    wanted = {_RENAMED.get(name, name) for name in given}
    return {name: value for name, value in arguments.items() if name in wanted}


def _names_of(group: type) -> list[str]:
    return [field.name for field in fields(group)]


def _those_of(group: type, given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: given[name] for name in _names_of(group) if name in given}


def check_row(row: RowValues, faults: FaultList) -> None:
    """Add to the faults what is wrong with a row whose cells are right by themselves."""
    if not {CLIPS, "keypoints", "points"} & (row.places.keys()):
        faults.add(row.place, "has neither clips nor keypoints", "name a video in the column clips")
    for check in (_arguments, _declared, _files, _points, _person, _detector, _height, _method):
        _collected(check, row, faults)


def _collected(check: Callable[[RowValues, Callable[..., Any]], None], row: RowValues, faults: FaultList) -> None:
    """Run a check; every InputError in it, and in the parts that it tries, becomes a fault."""

    def tried(part: Callable[..., Any], *arguments: Any) -> None:
        try:
            part(*arguments)
        except InputError as error:
            column = column_of(error.source)
            if column is None:
                faults.add(row.place, f"{error.source}: {error.problem}", error.remedy)
            else:
                place = row.places.get(column.name, row.place)
                faults.add(place, error.problem, error.remedy, column=column.name)

    tried(check, row, tried)


def _arguments(row: RowValues, tried: Callable[..., None]) -> None:
    if "detect" not in row.faulty:
        track_arguments(row)


def _declared(row: RowValues, tried: Callable[..., None]) -> None:
    """Values that the files do not say; which cameras there are is known when they are opened."""
    given = _those_of(Declared, row.values)
    given["start"], _ = moment(given.get("start"))
    declared = Declared(**given)
    tried(declared.check_lens)
    tried(declared.known_floor)
    tried(declared.part)
    readers = {
        "keypoint_size": declared.sizes, "keypoint_noise": declared.noises, "fps": declared.rates,
        "offset": declared.offsets,
    }  # fmt: skip
    for name, read in readers.items():
        tried(read, [camera for camera, _ in named_pairs(given.get(name)) if camera] or [""])


def _files(row: RowValues, tried: Callable[..., None]) -> None:
    if row.faulty & {*BY_CAMERA, "cameras", "lenses"}:
        return  # a file that is missing has no name to compare
    backgrounds = row.get("background")
    declared = Declared(focal=row.get("focal"), phone=row.get("phone"))
    InputFiles(
        row.get(CLIPS), row.get("keypoints"), row.get("cameras"), row.get("mask"), backgrounds, declared=declared,
        depths=row.get("depth"), lenses=row.get("lenses"),
    ).checked()  # fmt: skip


def _points(row: RowValues, tried: Callable[..., None]) -> None:
    """Points in space, or what is said of them."""
    fit = row.get("fit", USUAL.fit)
    if row.faulty:
        return
    given = track_arguments(row)
    if not row.get("points"):
        tried(check_no_points, row.get("markers", AUTO), row.get("unit"), row.get("static"))
        tried(partial(check_fit, points=False), fit)
        return
    tried(check_no_cameras, given | {CLIPS: row.get(CLIPS)})
    tried(partial(check_fit, points=True), fit)
    if row.get("static"):
        tried(check_static, fit)
    for name in ("markers", "unit"):
        if row.get(name, AUTO) != AUTO:
            tried(_refused, name, row.get(name))


def _person(row: RowValues, tried: Callable[..., None]) -> None:
    given = row.get(PERSON_ID)
    if given is None or wants_all(given):
        return
    from kinemode.inputs.persons import persons_of  # it imports numpy, which a missing file does not wait for

    try:
        persons_of(given, [camera for camera, _ in named_pairs(given) if camera])
    except InputError as error:
        raise InputError(PERSON_ID, error.problem, remedy=error.remedy) from None


def _detector(row: RowValues, tried: Callable[..., None]) -> None:
    names = _names_of(DetectorOptions)
    if row.get("detect") and not row.faulty & {*names}:
        if not row.get(CLIPS) and CLIPS not in row.places:
            raise InputError("detect", "there is no clip", remedy="name one in the column clips")
        given = DetectorOptions(**_those_of(DetectorOptions, row.values))
        if given.detector not in DETECTORS:
            remedy = f"one of {', '.join(DETECTORS)}"
            raise InputError("detector", f"{shown(given.detector)} is unknown", remedy=remedy)
        if given.people < 1:
            raise InputError("people", f"must be 1 or more, got {given.people}")
        model, boxes = (None if path is None else Path(path) for path in (given.model, given.boxes))
        try:
            DetectorChoice(given.detector, model, boxes, given.people).check()
        except InputError as error:
            raise InputError("detector", f"{error.source}: {error.problem}", remedy=error.remedy) from None


def _height(row: RowValues, tried: Callable[..., None]) -> None:
    height, subject = row.get("height"), row.get(SUBJECT, USUAL.subject)
    if height is None:
        return
    if SUBJECT not in row.faulty and not is_built_in(subject):
        raise InputError("height", f"{shown(subject)} is taken as measured", remedy="leave it out")
    tried(_refused, "height", height)


def _method(row: RowValues, tried: Callable[..., None]) -> None:
    """Tracker, its settings and the cues: known once the libraries are loaded, which takes seconds, so only where they
    are said, and once for all rows that say the same."""
    names = (_TRACKER, "settings", "modes")
    if any(row.get(name) is not None for name in names) and not row.faulty & {*names}:
        usual = MARKERS if row.get("points") else None
        tried(_refused, _TRACKER, (row.get(_TRACKER, usual), *(row.get(name) for name in names[1:])))
    if row.get("cues") is not None:
        tried(_refused, "cues", row.get("cues"))


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
        if what == "height":
            from kinemode.jobs import check_stature

            check_stature(given)
        elif what == "markers":
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
