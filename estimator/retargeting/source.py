"""The motion that a body is to follow, as landmarks over time, and its gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from estimator.numerics.stretches import stretches
from humanoid.support.errors import InputError, first_of

_LISTED = 4  # stretches in a note
_TINY = 1e-9  # s


@dataclass(frozen=True)
class SourceMotion:
    """Landmarks of a moving person or robot.

    names (L): of the landmarks as subjects have them (left_hip, right_big_toe, head_top, ...). points (T, L, 3) [m]:
    in a world whose z points up, NaN where missing. times (T,) [s], rising. source: the file, for messages. notes: what
    is worth knowing of how it was read.
    """

    names: tuple[str, ...]
    points: np.ndarray
    times: np.ndarray
    source: str
    notes: tuple[str, ...] = ()

    def landmark(self, name: str) -> np.ndarray:
        """Points (T, 3) [m] of a landmark; raises InputError where the motion has none of this name."""
        if name not in self.names:
            raise InputError(self.source, f"has no landmark {name}", remedy=f"it has {first_of(self.names, 12)}")
        return self.points[:, self.names.index(name)]


def filled(source: SourceMotion, longest: float) -> SourceMotion:
    """The motion with its gaps of at most `longest` seconds filled, and notes of what was filled and what was not.

    A gap lasts from the last frame in which a landmark is known to the next. Inside it follows cubics that do not
    overshoot (Fritsch and Butland, A method for constructing local monotone piecewise cubic interpolants, SIAM J. Sci.
    Stat. Comput. 5(2), 1984), two known frames being joined by a line; before the first known frame and after the last
    the landmark stays where it is. Longer gaps stay NaN, as do landmarks that are never known.
    """
    points, short, long, never = source.points.copy(), dict[str, int](), list[str](), list[str]()
    for column, name in enumerate(source.names):
        own = points[:, column]
        known = np.isfinite(own).all(axis=1)
        if not known.any():
            never.append(name)
            continue
        for first, after in stretches(~known):
            if _duration(source.times, first, after) > longest + _TINY:
                begin, end = source.times[first], source.times[after - 1]
                long.append(f"{name} from {begin:.2f} to {end:.2f} s")
                continue
            own[first:after] = _between(source.times, source.points[:, column], known, slice(first, after))
            short[name] = short.get(name, 0) + after - first
    notes = list(source.notes)
    if short:
        listed = first_of([f"{name} in {count} frames" for name, count in short.items()], _LISTED)
        notes.append(f"{source.source}: gaps of at most {longest:g} s are filled: {listed}")
    if long:
        notes.append(f"{source.source}: missing for longer than {longest:g} s, not filled: {first_of(long, _LISTED)}")
    if never:
        notes.append(f"{source.source}: never known: {first_of(never, 2 * _LISTED)}")
    return replace(source, points=points, notes=tuple(notes))


def _duration(times: np.ndarray, first: int, after: int) -> float:
    """The duration of a gap [s], from the known frame before it to the next, where these exist."""
    return float(times[min(after, len(times) - 1)] - times[max(first - 1, 0)])


def _between(times: np.ndarray, points: np.ndarray, known: np.ndarray, gap: slice) -> np.ndarray:
    """Values of points (T, 3) in a gap between, before or after known frames."""
    at, there = times[known], points[known]
    asked = np.clip(times[gap], at[0], at[-1])
    if len(at) < 2:
        return np.repeat(there, len(asked), axis=0)
    return np.asarray(PchipInterpolator(at, there)(asked))
