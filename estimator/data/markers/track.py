"""Points over time, as they are read and as they are used."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np


class MarkerTrack(NamedTuple):
    """Named points over time. names (M). points (T, M, 3): in a world whose z points up [m], NaN where missing.
    time (T,) [s], rising. source: the names of the files. notes: what is worth knowing. up: the axis of the first file
    that was taken to point up, one of `UPS`."""

    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray
    source: str
    notes: tuple[str, ...] = ()
    up: str = "z"


class PointFile(NamedTuple):
    """Content of one file. names (M). points (T, M, 3): along the axes of the file, in `unit`, NaN where missing.
    time (T,) [s]. unit, up, rate [1/s]: empty, None and NaN where the file does not have them. usual_up: the axis that
    points up in most files of its kind, None where either does. y_or_z: whether worlds with y and z up are both common
    there. notes: what is worth knowing."""

    path: Path
    names: tuple[str, ...]
    points: np.ndarray
    time: np.ndarray
    unit: str = ""
    up: str | None = None
    rate: float = np.nan
    notes: tuple[str, ...] = ()
    usual_up: str | None = None
    y_or_z: bool = False


class DeclaredUnits(NamedTuple):
    """The user's options for files: the axis that points up, the unit of length, frames per second [1/s]."""

    up: str | None = None
    unit: str | None = None
    fps: float | None = None

    @property
    def options(self) -> Mapping[str, str]:
        """Values by the name of their option, those that are given."""
        return {name: f"{value}" for name, value in self._asdict().items() if value is not None}
