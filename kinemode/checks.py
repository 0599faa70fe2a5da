"""Checks of a request's options together, before anything runs and before the libraries are loaded that do
the work. `kinemode.track` stops at the first fault, `kinemode.batch` lists those of all checks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from humanoid.support.errors import InputError
from kinemode.detection.detectors import DetectorChoice
from kinemode.inputs.declared import noises, offsets, part, rates, sizes, wants_all
from kinemode.inputs.phones import checked_phone
from kinemode.named import named_pairs, named_paths
from kinemode.option import Option, options_of
from kinemode.request import (
    AUTO,
    BY_INDEX,
    OFF,
    DetectorOptions,
    FileOptions,
    KeypointOptions,
    LensOptions,
    MethodOptions,
    PointOptions,
)

MARKERS = "markers"
"""The tracker of points, and the fit to them."""
_FITS = (AUTO, MARKERS, OFF)
_WITH_POINTS = frozenset({"up", "fps", "floor", "start", "end", "sync"})
"""Options of files that hold for points too, or that `off` leaves without effect."""
_OF_CAMERAS = ("clips", "cues", "index", "height")  # beside those of files


def check_together(request: Any) -> None:
    """Raise InputError for options that contradict each other or that cannot be read."""
    for check in CHECKS.values():
        check(request)


def check_exists(path: str | os.PathLike[str]) -> None:
    """Raise InputError where there is no such file or folder."""
    if not Path(path).exists():
        raise InputError(str(path), "there is no such file")


def _files(request: Any) -> None:
    """Files that do not exist."""
    for name, declared in options_of(type(request)).items():
        value = getattr(request, name)
        if declared.files and value is not None:
            named_paths(value, declared.files)
        elif declared.is_read and isinstance(value, (str, Path)) and not is_word(declared, value):
            check_exists(value)


def is_word(declared: Option, value: str | Path) -> bool:
    """Whether a value of an option that names a file is a keyword in place of one: cameras that are found, or a set of
    markers by its name."""
    if declared.name == MARKERS:
        return Path(value).suffix != ".toml"
    return declared.name == "cameras" and value == AUTO


def _lens(request: Any) -> None:
    if not isinstance(request, LensOptions):
        return
    if request.phone is not None:
        if request.focal is not None:
            raise InputError("--phone", "gives the focal length, as --focal does", remedy="leave one of them out")
        checked_phone(request.phone)
    if request.lenses is None:
        return
    if isinstance(request, FileOptions) and request.cameras != AUTO:
        problem = "is for cameras that are found from a person"
        raise InputError("--lenses", problem, remedy="add --cameras auto, or give the file as --cameras")
    for option, given in (("--focal", request.focal), ("--phone", request.phone)):
        if given is not None:
            raise InputError("--lenses", f"gives the focal length, as {option} does", remedy="leave one of them out")


def _by_camera(request: Any) -> None:
    """Values by camera; which cameras there are is known when the files are opened."""
    readers: Iterable[tuple[str, Callable[..., Any]]] = (
        ("keypoint_size", sizes), ("fps", rates), ("offset", offsets), ("keypoint_noise", noises),
    )  # fmt: skip
    for name, read in readers:
        if (value := getattr(request, name, None)) is not None:
            read(value, [camera for camera, _ in named_pairs(value) if camera] or [""])


def _part(request: Any) -> None:
    if isinstance(request, FileOptions):
        if request.begins_by_index and not isinstance(request, MethodOptions):
            raise InputError("start", f"{BY_INDEX!r} is for a track", remedy="a number of seconds")
        part(request)


def _detector(request: Any) -> None:
    if not isinstance(request, KeypointOptions) or not isinstance(request, DetectorOptions):
        return
    if not request.detect:
        for name, declared in options_of(DetectorOptions).items():
            if getattr(request, name) != declared.default:
                raise InputError(name, "is for --detect, which is not given", remedy="add --detect, or leave it out")
        return
    if not _has_clips(request):
        raise InputError("detect", "there is no clip", remedy="name one")
    DetectorChoice.of(request).check()


def _has_clips(request: Any) -> bool:
    """Whether there are clips; those of a program, which are read once, are not counted."""
    clips = request.clips
    return clips is not None and (not hasattr(clips, "__len__") or len(clips) > 0)


def _points(request: Any) -> None:
    if not isinstance(request, PointOptions):
        if isinstance(request, MethodOptions) and request.fit == MARKERS:
            raise InputError("fit", "no points are given", remedy="leave it out")
        return
    if request.points is None:
        for name, declared in options_of(PointOptions).items():
            if getattr(request, name) != declared.default:
                problem = "is for points, which are not given"
                raise InputError(name, problem, remedy="add --points FILE, or leave it out")
    fit = getattr(request, "fit", AUTO)
    if request.points is None and fit == MARKERS:
        raise InputError("fit", "no points are given", remedy="add --points FILE, or leave it out")
    if request.points is not None:
        if fit not in _FITS:
            problem = f"{fit!r} is of keypoints, and points are given"
            raise InputError("fit", problem, remedy=f"one of {', '.join(_FITS)}")
        if request.static is not None and fit == OFF:
            problem = f"is for the fit, and fit is {fit!r}"
            raise InputError("static", problem, remedy="use --fit markers, or leave it out")
        _no_cameras(request)


def _no_cameras(request: Any) -> None:
    """Options of cameras, where points are given."""
    for name, declared in options_of(type(request)).items():
        if name not in _OF_CAMERAS and (name not in options_of(FileOptions) or name in _WITH_POINTS):
            continue
        value = getattr(request, name)
        plain = value[0] if isinstance(value, (tuple, list)) and len(value) == 1 else value
        if plain is not None and plain not in (declared.default, OFF, (), []):
            raise InputError(name, "is of cameras, and points are given", remedy="leave one of them out")


def _person(request: Any) -> None:
    if not isinstance(request, KeypointOptions) or request.person == AUTO:
        return
    if isinstance(request, PointOptions) and isinstance(request, MethodOptions) and wants_all(request.person):
        return  # `track` alone follows all people
    from kinemode.inputs.declared import persons_of  # it imports numpy, which a missing file does not wait for

    persons_of(request.person, [camera for camera, _ in named_pairs(request.person) if camera])


CHECKS: Mapping[str, Callable[[Any], None]] = {
    "lens": _lens,
    "part": _part,
    "detector": _detector,
    "points": _points,
    "by camera": _by_camera,
    "files": _files,
    "person": _person,
}
"""The checks of a request, in this order."""
