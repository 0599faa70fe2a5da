"""Heel strikes and toe-offs from where the feet are relative to the pelvis.

J. Zeni, J. Richards, J. Higginson, Two simple methods for determining gait events during treadmill and overground
walking using kinematic data, Gait & Posture 27(4), 2008, the method by coordinates: a heel strikes when it is farthest
in front of the pelvis along the walking direction, a toe leaves when it is farthest behind. Here the direction is that
in which the pelvis moves, so that a path may bend.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
CUTOFF = 6.0
"""[Hz] of the low-pass filter (Butterworth, fourth order, forth and back) that the landmarks go through."""
SLOWEST = 0.2
"""Speed [m/s] of the pelvis below which there is no walking direction."""
_PATH_CUTOFF = 0.6  # Hz; a stride lasts about a second, and the pelvis sways with it
_LEAST_SWING = 0.1  # m that a foot comes forward, or falls back, at least
_LEAST_APART = 0.3  # s between two strikes of one foot


@dataclass(frozen=True)
class Feet:
    """Points from which gait is computed, by time (T,) [s]: points (T, 3) [m] in a world with z up, NaN where there are
    none; heel and toe by side."""

    time: np.ndarray
    pelvis: np.ndarray
    heel: dict[Side, np.ndarray]
    toe: dict[Side, np.ndarray]

    @property
    def rate(self) -> float:
        """Frames per second."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    @property
    def known(self) -> np.ndarray:
        """(T,) bool, whether all points are there."""
        points = [self.pelvis, *self.heel.values(), *self.toe.values()]
        return np.asarray(np.isfinite(points).all(axis=(0, 2)))


@dataclass(frozen=True)
class Event:
    """A foot's strike or toe-off at a time [s], between frames; frame: the nearest."""

    side: Side
    kind: Literal["strike", "off"]
    time: float
    frame: int


def filtered(feet: Feet) -> Feet:
    """Low-passed points, gaps bridged by straight lines; evenly spaced frames are assumed."""
    known, time = feet.known, feet.time

    def smooth(points: np.ndarray, cutoff: float = CUTOFF) -> np.ndarray:
        bridged = np.stack([np.interp(time, time[known], column[known]) for column in points.T], axis=1)
        return low_passed(bridged, feet.rate, cutoff)

    heel, toe = ({side: smooth(of[side]) for side in SIDES} for of in (feet.heel, feet.toe))
    return Feet(time, smooth(feet.pelvis), heel, toe)


def low_passed(points: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Points (T, 3) at `rate` [1/s] low-pass filtered at `cutoff` [Hz]; unchanged where the rate is too low."""
    if cutoff >= 0.45 * rate:
        return points
    from scipy.signal import butter, sosfiltfilt  # takes long to import, and every command would

    sections = butter(2, cutoff, fs=rate, output="sos")  # forth and back: of fourth order
    reach = min(len(points) - 1, int(np.ceil(3.0 * rate / cutoff)))
    return np.asarray(sosfiltfilt(sections, points, axis=0, padlen=reach))


def walking_direction(feet: Feet) -> tuple[np.ndarray, np.ndarray]:
    """For filtered feet: horizontal unit vectors (T, 2) along the pelvis' path, and its speed (T,) [m/s]."""
    velocity = low_passed(feet.rate * np.gradient(feet.pelvis[:, :2], axis=0), feet.rate, _PATH_CUTOFF)
    speed = np.linalg.norm(velocity, axis=1)
    return velocity / np.maximum(speed, 1e-9)[:, None], speed


def gait_events(feet: Feet) -> list[Event]:
    """Strikes and toe-offs of filtered feet in order of time, where the pelvis moves on; none is reported in the clip's
    first and last frames, where a foot may still have gone farther."""
    from scipy.signal import find_peaks  # takes long to import, and every command would

    direction, speed = walking_direction(feet)
    rate = feet.rate
    events = []
    for side in SIDES:
        ahead = {"strike": feet.heel[side], "off": feet.toe[side]}
        for kind, sign in (("strike", 1.0), ("off", -1.0)):
            along = sign * ((ahead[kind] - feet.pelvis)[:, :2] * direction).sum(axis=1)
            peaks, _ = find_peaks(along, prominence=_LEAST_SWING, distance=max(1, round(_LEAST_APART * rate)))
            for i in peaks[speed[peaks] >= SLOWEST]:
                t = feet.time[i] + _vertex(along[i - 1 : i + 2]) / rate
                events.append(Event(side, "strike" if sign > 0.0 else "off", float(t), int(i)))
    return sorted(events, key=lambda event: event.time)


def _vertex(three: np.ndarray) -> float:
    """Vertex of the parabola through three values at -1, 0, 1, at most half a step away."""
    a, b, c = three
    bend = a - 2.0 * b + c
    return float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend != 0.0 else 0.0
