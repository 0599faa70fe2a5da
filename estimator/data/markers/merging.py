"""Several files of points of the same instants as one, in a world whose z points up: by heads, feet and how people
stand.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import UPS, axis_of, nearest_axis
from estimator.data.formats.markers import body_ends
from estimator.data.formats.opensim import frame_rate, upright_world
from estimator.data.markers.track import MarkerTrack, PointFile
from estimator.numerics.vectors import mean_direction
from humanoid.support.errors import InputError, shown

_TALLER = 1.4  # extent along the axis over that along the others
_STEADY = 0.9  # of frames in which it is the longest
_STILLER = 0.5  # speed of the planted end over that of the other
_SEEN = 0.5  # of the points that a frame needs
_END = 0.25  # of the extent that counts as an end
_ALONG = 0.82  # cosine of 35 degrees: between an axis and the mean direction from the feet to the head
_ALWAYS = 0.9  # length of the mean of these directions, for a person who does not turn over
_FASTER = 0.05  # [m/s] that the upper end has to move at


def up_by_names(names: Sequence[str], points: np.ndarray) -> str | None:
    """The axis, one of `UPS`, along which the head is above the feet in points (T, M, 3) with these names (M).

    None where too few names are of head and feet, or where the direction between them turns or is along no axis, as
    when a person bends down or rolls over. For a lying person it is the axis along which the body lies.
    """
    head, foot = (_middles(points[:, end]) for end in body_ends(names))
    mean = mean_direction(head - foot)
    axis = nearest_axis(mean)
    steady = np.linalg.norm(mean) >= _ALWAYS and axis_of(axis) @ mean >= _ALONG * np.linalg.norm(mean)
    return axis if steady else None


def _middles(points: np.ndarray) -> np.ndarray:
    """Means (T, 3) of the points (T, M, 3) that each frame has, NaN where it has none."""
    known = np.isfinite(points).all(axis=2)[..., None]
    count = known.sum(axis=1)
    return np.asarray(np.where(known, points, 0.0).sum(axis=1) / np.where(count, count, np.nan))


def up_by_motion(points: np.ndarray, time: np.ndarray) -> str | None:
    """The axis, one of `UPS`, that points up in points (T, M, 3) [m] of an upright person; None where it is not clear.

    The body is longest along it in nearly all frames, and at its lower end some point rests while the upper end moves,
    as feet do on a floor. A person who lies, spreads the arms or does not move leaves it open.
    """
    seen = np.isfinite(points).all(axis=2)
    enough = seen.mean(axis=1) >= _SEEN * seen.mean(axis=1).max(initial=0.0)
    usable = enough & (seen.sum(axis=1) >= 4)
    if usable.sum() < 3:
        return None
    chosen = points[usable]
    extent = np.nanmax(chosen, axis=1) - np.nanmin(chosen, axis=1)
    order = np.argsort(np.median(extent, axis=0))
    longest, next_longest = np.median(extent, axis=0)[order[[2, 1]]]
    if longest < _TALLER * next_longest or (np.argmax(extent, axis=1) == order[2]).mean() < _STEADY:
        return None
    low, high = (_end_speed(points, usable, time, sign * axis_of("xyz"[order[2]])) for sign in (1.0, -1.0))
    slow, fast = sorted((low, high))
    if not (fast > _FASTER and slow < _STILLER * fast):
        return None
    name = "xyz"[order[2]]
    return UPS[UPS.index(name if low < high else f"-{name}")]


def _end_speed(points: np.ndarray, usable: np.ndarray, time: np.ndarray, up: np.ndarray) -> float:
    """Root mean square speed of the stillest point of the lower end [m/s] over the file."""
    height = points @ up
    low, high = (pick(height[usable], axis=1)[:, None] for pick in (np.nanmin, np.nanmax))
    at_end = height[usable] <= low + _END * (high - low)
    step = max(1, round(0.05 / float(np.median(np.diff(time))))) if len(time) > 1 else 1
    speed = np.full(points.shape[:2], np.nan)
    if len(points) > step:
        moved = np.linalg.norm(points[step:] - points[:-step], axis=2)
        speed[: len(moved)] = moved / (time[step:] - time[:-step])[:, None]
    stillest = np.where(at_end & np.isfinite(speed[usable]), speed[usable], np.inf).min(axis=1)
    stillest = stillest[np.isfinite(stillest)]
    return float(np.sqrt(np.mean(stillest**2))) if len(stillest) else np.inf


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
