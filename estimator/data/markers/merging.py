"""Several files of points of the same instants as one, in a world whose z points up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.formats.opensim import frame_rate, upright_world
from estimator.data.markers.gravity import up_by_motion
from estimator.data.markers.track import MarkerTrack, PointFile
from humanoid.support.errors import InputError, shown

_LATE = 0.1  # of a frame's duration: by how much the instants of two files may differ


def merged(files: Sequence[PointFile], up: str | None) -> MarkerTrack:
    """Files with points in metres as one; up: the axis that points up instead of what they say.

    Raises
    ------
    InputError: other instants, a point in two files, or no word about which axis points up.
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
    return MarkerTrack(names, np.concatenate(points, axis=1), first.time, source, (*notes, *told))


def _axes(files: Sequence[PointFile], up: str | None) -> tuple[list[str], tuple[str, ...]]:
    """The axis of every file that points up, and notes: what a file does not say its motion may; else InputError."""
    if up is not None:
        return [up] * len(files), ()
    unsaid = [file for file in files if file.up is None]
    notes = tuple(
        f"{file.path.name}: {file.up} is taken to point up, but the body moves as if {moves} did: --up says which"
        for file in files
        if file.up is not None and (moves := up_by_motion(file.points, file.time)) not in (None, file.up)
    )
    told = up_by_motion(np.concatenate([file.points for file in unsaid], axis=1), files[0].time) if unsaid else None
    if unsaid and told is None:
        problem = "does not say which axis points up, and its motion leaves it open"
        raise InputError(unsaid[0].path, problem, remedy="--up x, y or z says it, or -z")
    if told is not None:
        notes += (f"{unsaid[0].path.name} does not say which axis points up: {told}, by its motion; --up says another",)
    return [file.up or told or "z" for file in files], notes


def _check_instants(first: PointFile, other: PointFile) -> None:
    """Raise InputError where two files are not of the same instants."""
    allowed = _LATE / frame_rate(first.time)
    if first.time.shape == other.time.shape and (np.abs(first.time - other.time) <= allowed).all():
        return
    problem = f"is of other instants than {first.path.name}: {_span(other)} against {_span(first)}"
    raise InputError(other.path, problem, remedy="cut and resample them alike")


def _span(file: PointFile) -> str:
    return f"{len(file.time)} frames at {frame_rate(file.time):.4g}/s from {file.time[0]:.4g} s on"
