"""Several files of points of the same instants as one, in a world whose z points up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.formats.opensim import frame_rate, upright_world
from estimator.data.markers.gravity import up_by_motion, up_by_names
from estimator.data.markers.track import MarkerTrack, PointFile
from humanoid.support.errors import InputError, shown

_UNSAID = "does not declare which axis points up"
_LATE = 0.1  # of a frame's duration: largest difference of the instants of two files


def merged(files: Sequence[PointFile], up: str | None) -> MarkerTrack:
    """Files with points in metres as one; up: the axis that points up, instead of theirs.

    Raises
    ------
    InputError: different instants, a point in two files, or an unknown upward axis.
    """
    first = files[0]
    for i, file in enumerate(files[1:], 1):
        _check_instants(first, file)
        for before in files[:i]:
            twice = next((name for name in file.names if name in before.names), None)
            if twice is not None:
                raise InputError(
                    file.path, f"the point {shown(twice)} is in {before.path.name}, too", remedy="drop one"
                )
    notes = [note for file in files for note in file.notes]
    axes, told = _axes(files, up)
    points = [file.points @ upright_world(axis).T for file, axis in zip(files, axes, strict=True)]
    names = tuple(name for file in files for name in file.names)
    source = ", ".join(file.path.name for file in files)
    return MarkerTrack(names, np.concatenate(points, axis=1), first.time, source, (*notes, *told), up=axes[0])


def _axes(files: Sequence[PointFile], up: str | None) -> tuple[list[str], tuple[str, ...]]:
    """The axis of every file that points up, and notes; raises InputError where it is unknown.

    The user's choice comes first, then the file's own, then the places of head and feet by their names, then the usual
    one for the kind of file, then the motion of all files without one.
    """
    if up is not None:
        return [up] * len(files), ()
    axes, notes, open_files = list[str | None](), list[str](), list[PointFile]()
    for file in files:
        axis, note = _axis(file)
        axes.append(axis)
        notes += [f"{file.path.name}: {note}"] if note else []
        open_files += [file] if axis is None else []
    if not open_files:
        return [axis for axis in axes if axis is not None], tuple(notes)
    by_motion = up_by_motion(np.concatenate([file.points for file in open_files], axis=1), files[0].time)
    if by_motion is None:
        problem = "does not declare which axis points up, and its motion leaves it open"
        raise InputError(open_files[0].path, problem, remedy="give it with --up: x, y, z or -z")
    notes.append(f"{open_files[0].path.name}: {_UNSAID}: {by_motion}, by its motion; --up gives another")
    return [axis or by_motion for axis in axes], tuple(notes)


def _axis(file: PointFile) -> tuple[str | None, str]:
    """The axis of a file that points up, None where only the motion of all could show it; and a note, or nothing."""
    by_names = up_by_names(file.names, file.points)
    expected = file.up or file.usual_up
    if expected is None:
        return by_names, f"{_UNSAID}: {by_names}, from the feet to the head; --up gives another" if by_names else ""
    if file.y_or_z and by_names is not None and by_names[-1] in "yz":
        taken = f"{by_names} is assumed to point up, as the head is above the feet along it; --up gives another"
        return by_names, "" if by_names in ("z", expected) else taken
    other = by_names or up_by_motion(file.points, file.time)
    if other in (None, expected):
        return expected, ""
    seen = f"from feet to head the body extends along {other}" if by_names else f"the body moves as if {other} did"
    return expected, f"{expected} is assumed to point up, but {seen}: give --up, unless the person lies"


def _check_instants(first: PointFile, other: PointFile) -> None:
    """Raise InputError where two files are not of the same instants."""
    allowed = _LATE / frame_rate(first.time)
    if first.time.shape == other.time.shape and (np.abs(first.time - other.time) <= allowed).all():
        return
    problem = f"is of other instants than {first.path.name}: {_span(other)} against {_span(first)}"
    raise InputError(other.path, problem, remedy="cut and resample them alike")


def _span(file: PointFile) -> str:
    return f"{len(file.time)} frames at {frame_rate(file.time):.4g}/s from {file.time[0]:.4g} s on"
