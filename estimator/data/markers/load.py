"""Points in space over time from files, brought to metres, one clock and a world whose z points up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import UPS
from estimator.data.formats.checked_json import LARGEST
from estimator.data.formats.markers import (
    check_names,
    check_spread,
    is_unnamed,
    of_one_person,
    output_kind,
    outputs_note,
)
from estimator.data.formats.opensim import checked_unit, frame_rate, metres_in
from estimator.data.formats.point_arrays import checked_rate
from estimator.data.markers.merging import merged
from estimator.data.markers.readers import UNIT_OPTION, read_points
from estimator.data.markers.track import DeclaredUnits, MarkerTrack, PointFile
from estimator.data.repeats import measured_points
from humanoid.support.errors import InputError, first_of, shown

_LISTED = 6  # names in a note
_OFF = 0.02  # by which part a rate may differ from the times


def load_points(
    paths: str | Path | Sequence[str | Path],
    *,
    up: str | None = None,
    unit: str | None = None,
    fps: float | None = None,
) -> MarkerTrack:
    """Points from a TRC, C3D, npz, npy or csv file, or from several files of the same instants.

    npz: `points` (T, M, 3), `names` (M), `time` (T) or `fps`, and optionally `unit` and `up`; or a run's export. csv:
    and npy: see `estimator.data.markers.readers`. The person's prefix is removed from names
    (`ann:LKNE`). Unnamed points (`*12`, `U12`, `unlabeled`) and outputs of a gait model (`LKneeAngles`) are left out,
    and a point at exactly zero is missing, as many programs write it; with notes.

    Parameters
    ----------
    up: the axis that points up, one of `UPS`; by default the file's own, else the axis from the feet to the head by the
        names of points, y of TRC, or the vertical of an upright person's motion; with a note.
    unit: of length, m, cm or mm, or their words; by default the file's own.
    fps: frames per second, where the file has neither them nor times, or both and they differ.

    Raises
    ------
    InputError: a file that is missing, damaged, or of another kind; a unit, an axis or a rate that is missing or
        invalid; times that do not rise; points that are infinite or implausibly far apart; no points; a name that
        appears twice; files of different instants.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    if not given:
        raise InputError("points", "no file is given", remedy="a .trc, .c3d, .npz, .npy or .csv")
    declared = _checked(DeclaredUnits(up, unit, fps))
    files = [
        _measured(_sound(with_clock(read_points(Path(path), declared.unit), declared), declared)) for path in given
    ]
    track = merged(files, declared.up)
    seen = np.isfinite(track.points).all(axis=2).any(axis=0)
    never = [name for name, is_seen in zip(track.names, seen, strict=True) if not is_seen]
    notes = (f"never seen: {first_of(never, _LISTED)}",) if never else ()
    return track._replace(notes=(*track.notes, *notes))


def point_names(path: str | Path) -> tuple[str, ...]:
    """The names of a file's points, as `load_points` has them, whatever its unit and axes are; raises InputError as
    that does."""
    names = [name for name in read_points(Path(path), "m").names if _is_marker(name)]
    if not names:
        raise InputError(path, "has no points with a name")
    own = of_one_person(path, names)
    check_names(path, own)
    return own


def _checked(declared: DeclaredUnits) -> DeclaredUnits:
    """Options that can be, the unit as a key of `METRES`."""
    if declared.unit is not None:
        declared = declared._replace(unit=checked_unit(declared.unit))
    if declared.up is not None and declared.up not in UPS:
        raise InputError("up", f"{shown(declared.up)} is not an axis", remedy=f"one of {', '.join(UPS)}")
    if declared.fps is not None:
        checked_rate("fps", declared.fps)
    return declared


def _sound(file: PointFile, declared: DeclaredUnits) -> PointFile:
    """The points of a file in metres, those that have a name and are not zero; raises InputError where there are
    none."""
    path, notes = file.path, list(file.notes)
    unit = declared.unit or file.unit
    if not unit:
        raise InputError(path, "does not declare its unit of length", remedy=f"{UNIT_OPTION} m, cm or mm gives it")
    if file.unit and unit != file.unit:
        notes.append(f"{path.name} declares {file.unit}: {UNIT_OPTION} {unit} is used instead")
    kept = [i for i, name in enumerate(file.names) if _is_marker(name)]
    unnamed = [name for name in file.names if is_unnamed(name)]
    if unnamed:
        notes.append(f"{path.name}: points without a name left out: {first_of(unnamed, _LISTED)}")
    if outputs := outputs_note(file.names):
        notes.append(f"{path.name}: {outputs}")
    if not kept or not len(file.points):
        problem = "has no points" if not len(file.points) or outputs else "has no points with a name"
        raise InputError(path, problem, remedy=outputs)
    names = of_one_person(path, [file.names[i] for i in kept])
    check_names(path, names)
    points = file.points[:, kept]
    zero = (points == 0.0).all(axis=2)
    if zero.any():
        notes.append(f"{path.name}: {zero.sum()} points at exactly zero are treated as missing")
    missing = zero | np.isnan(points).any(axis=2)
    points = metres_in(unit, path, "unit", UNIT_OPTION) * np.where(missing[..., None], np.nan, points)
    _check_numbers(file, names, points)
    if missing.all():
        raise InputError(path, "has no point that is seen: all are missing")
    check_spread(points, unit, path, UNIT_OPTION)
    return file._replace(names=names, points=points, unit=unit, notes=tuple(notes))


def _is_marker(label: str) -> bool:
    return not is_unnamed(label) and output_kind(label) is None


def _measured(file: PointFile) -> PointFile:
    """The points of a file without those that only repeat the one before, which is how some programs fill gaps."""
    points, notes = measured_points(file.path.name, file.names, file.points, file.time)
    return file._replace(points=points, notes=(*file.notes, *notes))


def _check_numbers(file: PointFile, names: Sequence[str], points: np.ndarray) -> None:
    """Raise InputError for a point that is infinite or too far away, with its frame and name."""
    wrong = np.argwhere((np.abs(points) >= LARGEST).any(axis=2))
    if len(wrong):
        frame, marker = wrong[0]
        place, remedy = f"frame {frame}, {shown(names[marker])}", "leave it empty where it is missing"
        raise InputError(file.path, f"is infinite, or at least {LARGEST:g} m away", place=place, remedy=remedy)


def with_clock(file: PointFile, declared: DeclaredUnits) -> PointFile:
    """The file with a time for every frame: its own where they rise and fit its rate, else by the rate.

    Raises
    ------
    InputError: times that do not rise, with the frame, or that contradict the rate; neither times nor a rate.
    """
    path, time, fps = file.path, file.time, declared.fps
    if time.shape != (len(file.points),):
        raise InputError(path, f"has {time.size} times of {len(file.points)} frames", place="time")
    rate = file.rate if np.isfinite(file.rate) else None
    if rate is not None:
        checked_rate(path, rate)
    if np.isnan(time).all():
        counted = fps or rate
        if counted is None:
            raise InputError(path, "has neither times nor frames per second", remedy="--fps gives them")
        return file._replace(time=np.arange(len(time)) / counted, notes=file.notes + _taken(file, rate, fps))
    if not _rises(time):
        if fps is None:
            at = int(np.argmax(~(np.abs(time) < LARGEST) | ~np.append(True, np.diff(time) > 0.0)))
            what = f"{time[at - 1]:g} s is followed by {time[at]:g} s" if at else f"{time[at]:g} s is not a time"
            remedy = "correct the times, or --fps counts the frames instead"
            raise InputError(path, f"times do not rise: {what}", place=f"frame {at}", remedy=remedy)
        note = f"{path.name}: its times do not rise, frames are counted at --fps {fps:g}"
        return file._replace(time=np.arange(len(time)) / fps, notes=(*file.notes, note))
    own = frame_rate(time) if len(time) > 1 else rate or fps or frame_rate(time)
    if fps is not None:
        kept = _alike(own, fps)
        return file._replace(time=time if kept else time * own / fps, notes=file.notes + _taken(file, own, fps))
    if rate is not None and not _alike(own, rate):
        problem = f"its times have {own:.4g} frames per second, its header declares {rate:.4g}"
        raise InputError(path, problem, place="time", remedy="correct one of them, or give the right one with --fps")
    checked_rate(path, own)
    return file


def _rises(time: np.ndarray) -> bool:
    return bool((np.abs(time) < LARGEST).all() and (np.diff(time) > 0.0).all())


def _alike(first: float, second: float) -> bool:
    return abs(first / second - 1.0) < _OFF


def _taken(file: PointFile, own: float | None, fps: float | None) -> tuple[str, ...]:
    """A note where the user's rate takes the place of the file's."""
    if fps is None or own is None or _alike(own, fps):
        return ()
    return (f"{file.path.name} has {own:.4g} frames per second: --fps {fps:g} is taken",)
