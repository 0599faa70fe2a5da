"""Gait of a run: events, strides, and reasons for which they are not given.

A foot strikes when it begins to stand. In walking its toes leave the ground when they are farthest behind the pelvis,
which is nearer to force plates than the time at which they cease to stand by their own speed; where the other foot does
not stand, as in running, they leave when they cease to stand. Feet whose contact is not to be trusted have both events
by where they are relative to the pelvis alone, see `estimator.runs.events`. Walking on a treadmill is analysed in the
frame of its belt, where everything is as on a floor at rest.

Strides: from a strike of a foot to its next.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from estimator.inference.belt import Belt
from estimator.runs.contact import Contact, contact_of_run
from estimator.runs.events import SIDES, SLOWEST, Event, Feet, Side, filtered, gait_events, walking_direction
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from humanoid.support.files import replacing

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


Method = Literal["contact", "pelvis"]
METHODS: dict[Method, str] = {
    "contact": "when feet begin and cease to stand, toe-offs of walking by where toes are relative to the pelvis",
    "pelvis": "where feet are relative to the pelvis (Zeni et al. 2008)",
}
"""The methods of finding events."""
_NEAR = 1.5  # s, between an event and a stride
_SAME = 0.1  # s, between a toe-off by contact and by the pelvis
_EDGE = 0.1  # s at either end of the clip, in which what was before, or comes after, is not seen
_LEAST_SECONDS, _LEAST_FRAMES = 1.0, 15
_PARTS = ("heel", "big_toe")
_WANTED = (*(f"{side}_{part}" for side in SIDES for part in _PARTS), "mid_hip")
_RUNNING = 2.3  # m/s; people walk more slowly
_UNKNOWN_SPEED = "the feet move as on a treadmill of unknown speed: strides have no length"


@dataclass(frozen=True)
class Gait:
    """events and strides in order of time; remark: why there are no strides, or a remark on them; may be empty. method:
    one of `METHODS`. belt [m/s]: speed of a treadmill, None without one; lengths and speeds are along it, and NaN where
    it is not known."""

    events: tuple[Event, ...]
    strides: tuple[Stride, ...]
    remark: str = ""
    method: Method = "contact"
    belt: float | None = None

    def write(self, path: str | Path) -> Path:
        """Write the strides as csv, and return its path; raises InputError where it is not writable."""
        return write_strides(self.strides, path)


def gait_of_run(run: Run, contact: Contact | None = None) -> Gait:
    """Gait of the best hypothesis; contact: the run's, by default found here. Raises InputError where the subject has
    no feet and hips as landmarks."""
    names = run.body.landmark_names
    missing = [name for name in _WANTED if name not in names]
    if missing:
        remedy = "gait needs a whole person, such as human34"
        raise InputError(run.header.subject_source, f"has no landmark {missing[0]}", remedy=remedy)
    stands = contact_of_run(run) if contact is None else contact
    return gait_of_landmarks(run.time, names, run.landmarks, run.status == "tracked", contact=stands)


def gait_if_whole(run: Run, contact: Contact) -> Gait | None:
    """`gait_of_run`; None where the subject has no such landmarks."""
    return gait_of_run(run, contact) if set(_WANTED) <= set(run.body.landmark_names) else None


def gait_of_landmarks(
    time: np.ndarray,
    names: Sequence[str],
    points: np.ndarray,
    sure: np.ndarray | None = None,
    *,
    contact: Contact | None = None,
) -> Gait:
    """Gait from landmarks (T, L, 3) [m] by name at times (T,) [s], z up; sure (T,) bool: reliable frames.

    contact: at the same times; without one, or with a remark on it, events are found from the pelvis. Events far from
    any stride are left out, unless feet start and cease to stand while the pelvis moves on.
    """
    trusted = None if contact is None or contact.remark else contact
    method: Method = "pelvis" if trusted is None else "contact"
    index = {name: i for i, name in enumerate(names)}
    heel, toe = ({side: points[:, index[f"{side}_{part}"]] for side in SIDES} for part in _PARTS)
    feet = Feet(time, points[:, index["mid_hip"]], heel, toe)
    belt = None if contact is None else contact.belt
    if belt is not None:
        feet = _from_belt(feet, belt)
    known = feet.known
    seconds = float(time[known][-1] - time[known][0]) if known.any() else 0.0
    if known.sum() < _LEAST_FRAMES or seconds < _LEAST_SECONDS:
        return Gait((), (), f"too short: the feet are known for {seconds:.1f} s, a stride takes about one", method)
    smooth = filtered(feet)
    by_pelvis = gait_events(smooth)
    told = by_pelvis if trusted is None else events_by_contact(trusted, by_pelvis)
    events = [event for event in told if known[event.frame]]
    strides = strides_of(smooth, events, known, ~sure if sure is not None else np.zeros(len(time), dtype=bool))
    speed = walking_direction(smooth)[1]
    kept = [
        event
        for event in events
        if any(s.start - _NEAR <= event.time <= s.end + _NEAR for s in strides)
        or (trusted is not None and speed[event.frame] >= SLOWEST)
    ]
    gait = Gait(tuple(kept), tuple(strides), _remark(smooth, events, strides, method), method)
    return gait if belt is None else _on_belt(gait, belt)


def _from_belt(feet: Feet, belt: Belt) -> Feet:
    """Feet and pelvis as they are seen from a belt."""
    heel, toe = ({side: points - belt.way for side, points in of.items()} for of in (feet.heel, feet.toe))
    return Feet(feet.time, feet.pelvis - belt.way, heel, toe)


def _on_belt(gait: Gait, belt: Belt) -> Gait:
    """The same with the belt's speed, or without what follows from a speed that is not known."""
    if belt.known:
        return replace(gait, belt=belt.speed)
    strides = tuple(replace(stride, length=np.nan, speed=np.nan) for stride in gait.strides)
    return replace(gait, strides=strides, remark=_UNKNOWN_SPEED if strides else gait.remark, belt=np.nan)


def events_by_contact(contact: Contact, by_pelvis: Sequence[Event]) -> list[Event]:
    """When feet begin and cease to stand, in order of time, but for the clip's ends; by the pelvis when toes leave
    where the other foot stands, if the two agree to a tenth of a second."""
    events, (begin, end) = [], contact.time[[0, -1]]
    for event in contact.events:
        if not begin + _EDGE <= event.time <= end - _EDGE:
            continue
        other = SIDES[1 - SIDES.index(event.side)]
        same = [e for e in by_pelvis if (e.side, e.kind) == (event.side, "off") and abs(e.time - event.time) <= _SAME]
        walks = event.kind == "off" and contact.has(other) and contact.foot(other)[event.frame] > 0.5
        events.append(min(same, key=lambda e: abs(e.time - event.time)) if walks and same else event)
    return sorted(events, key=lambda event: event.time)


def _remark(feet: Feet, events: Sequence[Event], strides: Sequence[Stride], method: Method) -> str:
    if strides:
        fast = method == "pelvis" and np.median([stride.speed for stride in strides]) > _RUNNING
        return "faster than people walk: in running the feet leave the ground sooner than this assumes" if fast else ""
    speed = float(np.median(walking_direction(feet)[1]))
    if speed < SLOWEST:
        return f"not walking: the pelvis moves at {speed:.2f} m/s"
    strikes = max(sum(e.side == side and e.kind == "strike" for e in events) for side in SIDES)
    if strikes < 2:
        return "too short, or not walking: no foot strikes the ground twice"
    return "not walking: between no two strikes of a foot does it stand and the other foot strike"
