"""Why a person's motion, or where cameras stand, leaves a rig in doubt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.numerics.angles import angle_between

_SHORT = 8.0  # s: fewer leave the cameras in doubt
_PLACE, _LINE = 0.2, 0.08  # m: standard deviations of a path that stays in one place, and that is a line
_FLAT = 0.06  # m: of points in a plane, across it
NARROW = 25.0
"""Degrees between cameras, seen from the person, below which they tell little of depth."""


def causes(points: np.ndarray, seconds: float, centres: np.ndarray, c: int) -> list[str]:
    """What leaves camera c in doubt, in words; none where nothing stands out.

    points (T, J, 3) [m]: of the person, NaN where unknown, over so many seconds. centres (C, 3) [m]: of the cameras.
    """
    named = [f"the clips share {seconds:.1f} s"] if seconds < _SHORT else []
    path = _spread(np.nanmean(points[np.isfinite(points).any(axis=(1, 2))], axis=1))
    if path[0] < _PLACE:
        named.append("the person stays in one place")
    elif path[1] < _LINE:
        named.append("the person moves along one line")
    if _spread(points[np.isfinite(points).all(axis=2)])[2] < _FLAT:
        named.append("all points are nearly in one plane")
    if is_narrow(points, centres, c):
        named.append("it looks from the same side as the others")
    return named


def is_narrow(points: np.ndarray, centres: np.ndarray, c: int) -> bool:
    """Whether camera c looks from the same side as all others; see `causes`."""
    ways = centres - np.nanmean(points, axis=(0, 1))
    return bool((np.degrees(angle_between(ways[c], np.delete(ways, c, axis=0))) < NARROW).all())


def in_words(named: Sequence[str]) -> str:
    """As part of a sentence, empty of none."""
    *others, last = named or [""]
    return f" ({', '.join(others)} and {last})" if others else f" ({last})" if last else ""


def _spread(points: np.ndarray) -> np.ndarray:
    """Standard deviations (3,) [m] of points (N, 3) along their principal axes, the largest first."""
    off = points - points.mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(off.T @ off / len(off))[::-1], 0.0)))
