"""Gait of a run: events, strides, and reasons for which they are not given.

A foot strikes when it begins to stand. In walking its toes leave the ground when they are farthest behind the pelvis,
which is nearer to force plates than the time at which they cease to stand by their own speed; where the other foot does
not stand, as in running, they leave when they cease to stand. Feet whose contact is not to be trusted have both events
by where they are relative to the pelvis alone, see `estimator.runs.events`. Walking on a treadmill is analysed in the
frame of its belt, where everything is as on a floor at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from estimator.inference.belt import Belt
from estimator.runs.contact import Contact, contact_of_run
from estimator.runs.events import SIDES, SLOWEST, Event, Feet, filtered, gait_events, walking_direction
from estimator.runs.run_reader import Run
from estimator.runs.strides import Stride, strides_of, write_strides
from humanoid.support.errors import InputError

Method = Literal["contact", "pelvis"]
METHODS: dict[Method, str] = {
    "contact": "when feet begin and cease to stand, toe-offs of walking by where toes are relative to the pelvis",
    "pelvis": "where feet are relative to the pelvis (Zeni et al. 2008)",
}
"""How events are found."""
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
