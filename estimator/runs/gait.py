"""Gait of a run: events, strides, and what keeps them from being told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.runs.events import SIDES, SLOWEST, Event, Feet, filtered, gait_events, walking_direction
from estimator.runs.run_reader import Run
from estimator.runs.strides import Stride, strides_of, write_strides
from humanoid.support.errors import InputError

_NEAR = 1.5  # s, between an event and a stride
_LEAST_SECONDS, _LEAST_FRAMES = 1.0, 15
_PARTS = ("heel", "big_toe")
_RUNNING = 2.3  # m/s; people walk more slowly


@dataclass(frozen=True)
class Gait:
    """events and strides in order of time; remark: why there are no strides, or what to know of them; may be empty."""

    events: tuple[Event, ...]
    strides: tuple[Stride, ...]
    remark: str = ""

    def write(self, path: str | Path) -> Path:
        """Write the strides as csv, and return its path; raises InputError where it cannot be written."""
        return write_strides(self.strides, path)


def gait_of_run(run: Run) -> Gait:
    """Gait of the best hypothesis; raises InputError where the subject has no feet and hips as landmarks."""
    names = run.body.landmark_names
    missing = [n for n in (*(f"{s}_{p}" for s in SIDES for p in _PARTS), "mid_hip") if n not in names]
    if missing:
        remedy = "gait needs a whole person, such as human34"
        raise InputError(run.header.subject_source, f"has no landmark {missing[0]}", remedy=remedy)
    return gait_of_landmarks(run.time, names, run.landmarks, run.status == "tracked")


def gait_of_landmarks(
    time: np.ndarray, names: Sequence[str], points: np.ndarray, sure: np.ndarray | None = None
) -> Gait:
    """Gait from landmarks (T, L, 3) [m] by name at times (T,) [s], z up; sure (T,) bool: frames to be relied on.

    Events that no stride is near are left out.
    """
    index = {name: i for i, name in enumerate(names)}
    heel, toe = ({side: points[:, index[f"{side}_{part}"]] for side in SIDES} for part in _PARTS)
    feet = Feet(time, points[:, index["mid_hip"]], heel, toe)
    known = feet.known
    seconds = float(time[known][-1] - time[known][0]) if known.any() else 0.0
    if known.sum() < _LEAST_FRAMES or seconds < _LEAST_SECONDS:
        return Gait((), (), f"too short: the feet are known for {seconds:.1f} s, a stride takes about one")
    smooth = filtered(feet)
    events = [event for event in gait_events(smooth) if known[event.frame]]
    strides = strides_of(smooth, events, known, ~sure if sure is not None else np.zeros(len(time), dtype=bool))
    near_events = [e for e in events if any(s.start - _NEAR <= e.time <= s.end + _NEAR for s in strides)]
    return Gait(tuple(near_events), tuple(strides), _remark(smooth, events, strides))


def _remark(feet: Feet, events: Sequence[Event], strides: Sequence[Stride]) -> str:
    if strides:
        fast = np.median([stride.speed for stride in strides]) > _RUNNING
        return "faster than people walk: in running the feet leave the ground sooner than this says" if fast else ""
    speed = float(np.median(walking_direction(feet)[1]))
    if speed < SLOWEST:
        return f"not walking: the pelvis moves at {speed:.2f} m/s"
    strikes = max(sum(e.side == side and e.kind == "strike" for e in events) for side in SIDES)
    if strikes < 2:
        return "too short, or not walking: no foot strikes the ground twice"
    return "not walking: between no two strikes of a foot does it stand and the other foot strike"
