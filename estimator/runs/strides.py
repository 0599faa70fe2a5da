"""Strides: from a strike of a foot to its next."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from pathlib import Path

import numpy as np

from estimator.runs.events import SIDES, SLOWEST, Event, Feet, Side, walking_direction
from humanoid.support.atomic import replacing

_SECONDS = (0.4, 2.5)  # of a stride
_STEP = (0.2, 0.8)  # of a stride: when the other foot strikes
_STANCE = (0.1, 0.85)  # of a stride; in running it is a third or less
_SHORTEST = 0.2  # m
_STANDING = 0.4  # of the walking speed: a foot on the ground is slower
_MIDDLE = (0.25, 0.6)  # of the stance, in which all of the foot is on the ground


@dataclass(frozen=True)
class Stride:
    """side: the foot. start, off, end [s]: it strikes, leaves the ground, strikes again. seconds: how long that takes.

    length [m]: from the heel's place at the first strike to that at the second, level, on a treadmill along its belt:
    NaN where its speed is not known, as then is the speed. width [m]: how far the other
    heel is from the line between them when it strikes, to its own side; negative where the feet cross. speed [m/s]:
    length by seconds. cadence [steps/min]: two steps a stride. stance, swing [%]: of the stride. flight [%]: of the
    stride, in which neither foot stands; none in walking. unsure: frames in it that the tracker was not sure of.
    """

    side: Side
    start: float
    off: float
    end: float
    seconds: float
    length: float
    width: float
    speed: float
    cadence: float
    stance: float
    swing: float
    flight: float
    unsure: int


_UNITS = {
    "start": "s", "off": "s", "end": "s", "seconds": "s", "length": "m", "width": "m", "speed": "m/s",
    "cadence": "steps/min", "stance": "%", "swing": "%", "flight": "%", "unsure": "frames",
}  # fmt: skip


def strides_of(feet: Feet, events: Sequence[Event], known: np.ndarray, unsure: np.ndarray) -> list[Stride]:
    """The strides between the events of filtered feet, in order of time.

    known, unsure (T,) bool: frames with landmarks, and frames in which they are not reliable. A stride is reported
    where the foot leaves the ground once, the other foot strikes once, the foot stands in between, the pelvis moves on
    and no frame is without landmarks. Anything else between two strikes is not a stride of walking or running.
    """
    strides = []
    for side in SIDES:
        strikes = [event for event in events if event.side == side and event.kind == "strike"]
        for first, last in pairwise(strikes):
            between = [event for event in events if first.time < event.time < last.time]  # in order of time
            offs = [event for event in between if event.side == side]
            others = [event for event in between if event.side != side and event.kind == "strike"]
            rows = slice(first.frame, last.frame + 1)
            if len(offs) == 1 and len(others) == 1 and known[rows].all():
                stride = _stride(
                    feet, (first, offs[0], others[0], last), _flight([*between, last]), int(unsure[rows].sum())
                )
                strides += [stride] if _walks(feet, stride, others[0], rows) else []
    return sorted(strides, key=lambda stride: stride.start)


def _flight(events: Sequence[Event]) -> float:
    """[s] in which neither foot stands, by the events in order of time after a strike of a foot until its next: who
    leaves the ground with one foot and then strikes with the other stood on none in between."""
    return sum(
        after.time - before.time
        for before, after in pairwise(events)
        if (before.kind, after.kind) == ("off", "strike") and before.side != after.side
    )


def _stride(feet: Feet, events: tuple[Event, Event, Event, Event], flight: float, unsure: int) -> Stride:
    """events: the strike, off, strike of the other foot and strike again; flight [s]."""
    first, off, other, last = events
    heel = feet.heel[first.side]
    start, end = _at(feet.time, heel, first.time), _at(feet.time, heel, last.time)
    along = end - start
    own_side = 1.0 if first.side == "right" else -1.0  # of the line, on which the other foot is
    aside = _at(feet.time, feet.heel[other.side], other.time) - start
    seconds, length = last.time - first.time, float(np.linalg.norm(along))
    left_of_line = float(along[0] * aside[1] - along[1] * aside[0]) / max(length, 1e-9)
    stance = 100.0 * (off.time - first.time) / seconds
    return Stride(
        first.side, first.time, off.time, last.time, seconds, length, own_side * left_of_line, length / seconds,
        120.0 / seconds, stance, 100.0 - stance, 100.0 * flight / seconds, unsure,
    )  # fmt: skip


def _walks(feet: Feet, stride: Stride, other: Event, rows: slice) -> bool:
    """Whether its times and lengths are those of a stride, and the foot stands while the body moves on."""
    step = (other.time - stride.start) / stride.seconds
    _, speed = walking_direction(feet)
    times = stride.start + np.array(_MIDDLE) * (stride.off - stride.start)
    foot = 0.5 * (feet.heel[stride.side] + feet.toe[stride.side])
    moved = np.linalg.norm(_at(feet.time, foot, times[1]) - _at(feet.time, foot, times[0]))
    return bool(
        _SECONDS[0] <= stride.seconds <= _SECONDS[1]
        and _STEP[0] <= step <= _STEP[1]
        and _STANCE[0] <= 0.01 * stride.stance <= _STANCE[1]
        and stride.length >= _SHORTEST
        and speed[rows].min() >= SLOWEST
        and moved <= _STANDING * stride.speed * (times[1] - times[0])
    )


def _at(time: np.ndarray, points: np.ndarray, t: float) -> np.ndarray:
    """The place (2,) on the ground of points (T, 3) at a time between frames."""
    return np.array([np.interp(t, time, column) for column in points.T[:2]])


def write_strides(strides: Sequence[Stride], path: str | Path) -> Path:
    """Write a csv, one row a stride, and return its path; raises InputError where it is not writable."""
    path = Path(path)
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow([f"{f.name} [{_UNITS[f.name]}]" if f.name in _UNITS else f.name for f in fields(Stride)])
        rows.writerows([[_cell(v) for v in asdict(s).values()] for s in strides])
    return path


def _cell(value: float | int | str) -> float | int | str:
    if not isinstance(value, float):
        return value
    return "" if np.isnan(value) else f"{value:.6g}"
