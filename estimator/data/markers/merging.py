"""Several files of points of the same instants as one, in a world whose z points up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.formats.opensim import frame_rate, upright_world
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
    axes = [up or file.up for file in files]
    if None in axes:
        unsaid = files[axes.index(None)]
        raise InputError(unsaid.path, "does not say which axis points up", remedy="--up x, y or z says it, or -z")
    points = [file.points @ upright_world(axis or "z").T for file, axis in zip(files, axes, strict=True)]
    names = tuple(name for file in files for name in file.names)
    source = ", ".join(file.path.name for file in files)
    return MarkerTrack(names, np.concatenate(points, axis=1), first.time, source, tuple(notes))


def _check_instants(first: PointFile, other: PointFile) -> None:
    """Raise InputError where two files are not of the same instants."""
    allowed = _LATE / frame_rate(first.time)
    if first.time.shape == other.time.shape and (np.abs(first.time - other.time) <= allowed).all():
        return
    problem = f"is of other instants than {first.path.name}: {_span(other)} against {_span(first)}"
    raise InputError(other.path, problem, remedy="cut and resample them alike")


def _span(file: PointFile) -> str:
    return f"{len(file.time)} frames at {frame_rate(file.time):.4g}/s from {file.time[0]:.4g} s on"
