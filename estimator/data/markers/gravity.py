"""Which axis points up, by where a person's head and feet are, and by how one stands and walks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.data.cameras.camera import UPS, axis_of, nearest_axis
from estimator.data.formats.markers import body_ends
from estimator.numerics.axes import mean_direction

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
