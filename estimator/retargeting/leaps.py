"""Jumps of a source: faster than people move, as from an exporter's rest pose to the motion, or to another person.

A step is a leap where it is long and differs from the steps before and after it by more than noise and any acceleration
explain, or is faster than anybody. Of 105 captured motions (CMU) at 10 to 60 frames per second, exact and with 30 mm of
noise, steps of the hips' middle differ by 0.25 m at most, those of other joints by 0.85 m at 10, 0.54 m at 15 and
0.57 m at 30 frames per second; hips have 4 m/s and joints 18 m/s. One more, 07_12, leaps by 2.4 m after its
first frame.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimator.retargeting.source import SourceMotion
from humanoid.support.errors import first_of

_HIPS = ("left_hip", "right_hip")
_LISTED = 4
_FIRST = 3  # frames that an exporter writes before the motion
_SHARE = 0.1  # of the motion, at most
_AWAY = 0.5  # of the motion: what is elsewhere for longer is where the motion is
_SEVERAL = 2  # joints that leap at once: a pose of its own, not a joint that was mistaken


class _Pace(NamedTuple):
    """A motion impossible for any body part: a step off its neighbours by `least` [m] and `acceleration` [m/s^2] times
    the square of its duration, or faster than `speed` [m/s]."""

    least: float
    acceleration: float
    speed: float


_ROOT, _JOINT = _Pace(0.3, 60.0, 12.0), _Pace(0.6, 300.0, 30.0)


class Leap(NamedTuple):
    """From a frame to one after it. distance [m]: of the hips' middle, else of the joint that moves farthest. whole:
    the body leaps, not one joint of it. what: for messages."""

    before: int
    after: int
    distance: float
    whole: bool
    what: str

    @property
    def sentence(self) -> str:
        """A sentence about it."""
        return f"{self.what} leaps {self.distance:.1f} m between frames {self.before} and {self.after}"


def leaps_of(source: SourceMotion) -> tuple[Leap, ...]:
    """The leaps of a motion in order, between frames in which what leaps is known."""
    leaps = dict[tuple[int, int], list[tuple[str, float]]]()
    for name, points in _parts(source).items():
        known = np.flatnonzero(np.isfinite(points).all(axis=1))
        steps = np.diff(points[known], axis=0)
        for k in np.flatnonzero(_is_leap(steps, np.diff(source.times[known]), _ROOT if name == "" else _JOINT)):
            span = int(known[k]), int(known[k + 1])
            leaps.setdefault(span, []).append((name, float(np.linalg.norm(steps[k]))))
    return tuple(_leap(span, parts) for span, parts in sorted(leaps.items()))


def without_rest_pose(source: SourceMotion) -> SourceMotion:
    """The motion with its first frames missing if it leaps right after them, as exporters put a rest pose before a
    motion, with a note."""
    first = min(_FIRST, int(_SHARE * len(source.times)))
    leap = next((leap for leap in leaps_of(source) if leap.whole and leap.after <= first), None)
    if leap is None:
        return source
    points = source.points.copy()
    points[: leap.after] = np.nan
    frames = "frame 0 is" if leap.after == 1 else f"frames 0 to {leap.after - 1} are"
    note = f"{source.source}: {leap.sentence}: {frames} left out"
    return replace(source, points=points, notes=(*source.notes, note))


def leap_findings(source: SourceMotion, leaps: tuple[Leap, ...]) -> tuple[str, ...]:
    """One sentence of all leaps; nothing without any."""
    if not leaps:
        return ()
    listed = first_of([leap.sentence for leap in leaps], _LISTED)
    return (f"{source.source}: {listed}: faster than anybody moves, so the frames there are hard",)


def leap_frames(source: SourceMotion, leaps: tuple[Leap, ...]) -> np.ndarray:
    """Frames (T,) bool beside a leap, and those between a leap there and one back."""
    frames = np.zeros(len(source.times), dtype=bool)
    for leap in leaps:
        frames[leap.before : leap.after + 1] = True
    for there, back in pairwise(leaps):
        between = slice(there.after, back.before + 1)
        if between.stop - between.start < _AWAY * len(frames) and _goes_on_without(source, between):
            frames[between] = True
    return frames


def _goes_on_without(source: SourceMotion, between: slice) -> bool:
    """Whether nothing leaps from the frame before some to the frame after them."""
    points = source.points.copy()
    points[between] = np.nan
    return not any(
        leap.before < between.stop and leap.after > between.start for leap in leaps_of(replace(source, points=points))
    )


def _parts(source: SourceMotion) -> dict[str, np.ndarray]:
    """Paths (T, 3) of the landmarks, and of the middle of the hips, which has no name."""
    parts = {name: source.points[:, k] for k, name in enumerate(source.names)}
    if set(_HIPS) <= set(source.names):
        parts[""] = 0.5 * (source.landmark(_HIPS[0]) + source.landmark(_HIPS[1]))
    return parts


def _is_leap(steps: np.ndarray, dt: np.ndarray, pace: _Pace) -> np.ndarray:
    """Which of steps (S, 3) [m] in times (S,) [s] are leaps, (S,) bool."""
    if not len(steps):
        return np.zeros(0, dtype=bool)
    velocity, length = steps / dt[:, None], np.linalg.norm(steps, axis=1)
    far, fast = length > pace.least, length > pace.speed * dt
    if len(steps) == 1:
        return np.asarray(far & fast)
    before, after = np.concatenate([velocity[1:2], velocity[:-1]]), np.concatenate([velocity[1:], velocity[-2:-1]])
    off = np.minimum(*(np.linalg.norm(velocity - other, axis=1) * dt for other in (before, after)))
    return np.asarray(far & (fast | (off > np.maximum(pace.least, pace.acceleration * dt**2))))


def _leap(span: tuple[int, int], parts: list[tuple[str, float]]) -> Leap:
    """What jumps together; the hips represent the body."""
    farthest = max(parts, key=lambda part: (part[0] == "", part[1]))
    whole = farthest[0] == "" or len(parts) >= _SEVERAL
    return Leap(*span, farthest[1], whole, "the source" if whole else farthest[0])
