"""The motion that a run is compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.data.formats.checked_json import LARGEST
from estimator.data.formats.opensim import Coordinates
from estimator.data.formats.reference import load_reference
from humanoid.support.errors import InputError


@dataclass(frozen=True)
class Reference:
    """Points and joint angles over time of a person, or of any body.

    names (L): landmark names, COCO's where COCO has one. points (T, L, 3): world frame [m], NaN where unknown.
    time (T,): seconds since the clip's start, or None where only the frame numbers count.
    coordinates: joint angles (T), None where they are not known. upright: whether the points are in a world whose z
    points up, as exports of runs and markers are; otherwise in that of the cameras that the run was made with.
    markers: for a laboratory's markers, the marker of each landmark that has another name in the file; None where they
    are landmarks. notes: remarks.
    """

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray | None = None
    coordinates: Coordinates | None = None
    upright: bool = False
    markers: Mapping[str, tuple[str, ...]] | None = None
    notes: tuple[str, ...] = ()

    @staticmethod
    def load(path: str | Path, *, up: str | None = None, offset: float = 0.0) -> Reference:
        """The reference in a file; see `estimator.data.formats.reference.load_reference` for kinds, `up` and errors.

        offset: of its clock [s], positive where it was started after the clip.
        """
        if not abs(offset) < LARGEST:
            raise InputError("offset", f"must be a number of seconds below {LARGEST:g}, got {offset:g}")
        stored = load_reference(path, up=up)
        time = stored.time + offset
        return Reference(
            stored.names, stored.points, time, stored.coordinates, stored.upright, stored.markers, stored.notes
        )

    def in_world_of(self, R_upright_given: np.ndarray | None) -> Reference:
        """The same in the world of a run, see `RunHeader.R_upright_given`."""
        if R_upright_given is None or self.upright:
            return self
        return replace(self, points=self.points @ R_upright_given.T, upright=True)
