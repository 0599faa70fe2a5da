"""The motion that a run is compared with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.data.formats.opensim import Coordinates
from estimator.data.formats.reference import load_reference


@dataclass(frozen=True)
class Reference:
    """Where the points of a person, or of any body, were, and how its joints were turned.

    names (L): landmark names, COCO's where COCO has one. points (T, L, 3): world frame [m], NaN where unknown.
    time (T,): seconds since the clip's start, or None where only the frame numbers count.
    coordinates: joint angles (T), None where they are not known.
    """

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray | None = None
    coordinates: Coordinates | None = None

    @staticmethod
    def load(path: str | Path) -> Reference:
        """The reference in a file; see `estimator.data.formats.reference.load_reference` for kinds and errors."""
        stored = load_reference(path)
        return Reference(stored.names, stored.points, stored.time, stored.coordinates)
