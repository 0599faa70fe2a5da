"""The motion that a run is compared with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.data.formats.opensim import Coordinates
from estimator.data.formats.reference import load_reference


@dataclass(frozen=True)
class Reference:
    """Where the points of a person, or of any body, were, and how its joints were turned.

    names (L): landmark names, COCO's where COCO has one. points (T, L, 3): world frame [m], NaN where unknown.
    time (T,): seconds since the clip's start, or None where only the frame numbers count.
    coordinates: joint angles (T), None where they are not known. upright: whether the points are in a world whose z
    points up, as exports of runs are; otherwise in that of the cameras that the run was made with.
    """

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray | None = None
    coordinates: Coordinates | None = None
    upright: bool = False

    @staticmethod
    def load(path: str | Path) -> Reference:
        """The reference in a file; see `estimator.data.formats.reference.load_reference` for kinds and errors."""
        stored = load_reference(path)
        return Reference(stored.names, stored.points, stored.time, stored.coordinates, stored.upright)

    def in_world_of(self, R_upright_given: np.ndarray | None) -> Reference:
        """The same in the world of a run, see `RunHeader.R_upright_given`."""
        if R_upright_given is None or self.upright:
            return self
        return replace(self, points=self.points @ R_upright_given.T, upright=True)
