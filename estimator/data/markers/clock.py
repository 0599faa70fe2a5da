"""The time of every frame of a file of points."""

from __future__ import annotations

import numpy as np

from estimator.data.formats.checked_json import LARGEST
from estimator.data.formats.opensim import frame_rate
from estimator.data.formats.point_arrays import checked_rate
from estimator.data.markers.track import PointFile, Said
from humanoid.support.errors import InputError

_OFF = 0.02  # by which part a rate may differ from the times


def with_clock(file: PointFile, said: Said) -> PointFile:
    """The file with a time for every frame: its own where they rise and fit its rate, else by the rate.

    Raises
    ------
    InputError: times that do not rise, with the frame, or that contradict the rate; neither times nor a rate.
    """
    path, time, fps = file.path, file.time, said.fps
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
            remedy = "mend the times, or --fps counts the frames instead"
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
