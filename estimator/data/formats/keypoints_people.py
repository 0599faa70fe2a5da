"""People found in single frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from estimator.data.formats.checked_json import BEYOND, LARGEST, WITHIN
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError

LAYOUT_BY_COUNT = {3 * len(names): layout for layout, names in reversed(FORMATS.items())}


@dataclass(frozen=True)
class Person:
    """One detection of a person: points (J, 3) with x, y [px], NaN where missing, and confidence, 0 where missing.

    world (J, 3): the same points in space [m], see `estimator.data.formats.keypoints_own`; None where a file has none.
    """

    points: np.ndarray
    id: str | None = None
    world: np.ndarray | None = None

    @cached_property
    def size(self) -> float:
        """Diagonal of the points' bounding box [px], 0 for fewer than two."""
        xy = self.points[self.points[:, 2] > 0.0, :2]
        return float(np.hypot(*(xy.max(axis=0) - xy.min(axis=0)))) if len(xy) > 1 else 0.0

    @cached_property
    def weight(self) -> float:
        """Size times mean confidence."""
        return self.size * float(self.points[:, 2].mean())


@dataclass
class Notes:
    """Number of corrections while reading."""

    counts: dict[str, int] = field(default_factory=dict)

    def add(self, what: str, count: int) -> None:
        """Count `count` further cases of `what`."""
        if count:
            self.counts[what] = self.counts.get(what, 0) + count

    def say(self, what: str) -> None:
        """Add the note `what` once."""
        self.counts.setdefault(what, 0)

    @property
    def texts(self) -> tuple[str, ...]:
        """One line for each kind."""
        return tuple(f"{what} ({count} times)" if count else what for what, count in self.counts.items())


def cleaned(points: np.ndarray, notes: Notes, source: str | Path, place: str) -> np.ndarray:
    """Points (J, 3) with missing ones as NaN and confidence 0, confidences in [0, 1].

    A point is missing where its confidence is 0 (OpenPose writes 0, 0, 0) or where both coordinates are NaN.
    """
    points = points.copy()
    xy, confidence = points[:, :2], points[:, 2]
    if (
        np.abs(points).max(initial=0.0) < LARGEST
        and confidence.min(initial=1.0) > 0.0
        and confidence.max(initial=0.0) <= 1.0
    ):
        return points  # nothing to correct, as with most people of a crowd
    missing = np.isnan(xy).all(axis=1)
    points[missing, 2] = 0.0
    wrong = ~missing & ~(np.abs(points) < LARGEST).all(axis=1)
    if wrong.any():
        bad = int(np.flatnonzero(wrong)[0])
        raise InputError(source, BEYOND, place=f"{place}, keypoint {bad}", remedy=WITHIN)
    notes.add("confidence above 1 taken as 1", int((confidence > 1.0).sum()))
    notes.add("negative confidence taken as 0: a missing point", int((confidence < 0.0).sum()))
    confidence[:] = np.clip(confidence, 0.0, 1.0)
    xy[confidence == 0.0] = np.nan
    return points
