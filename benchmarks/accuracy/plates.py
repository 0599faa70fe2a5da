"""What force plates measured under each foot of a laboratory's trial, at a run's times."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.opensim import R_OPENSIM_WORLD, read_mot
from estimator.numerics.stretches import stretches
from estimator.runs.events import SIDES
from estimator.runs.run_reader import Run

_LOADED, _PLACED = 20.0, 40.0  # N: on a plate, and enough for a centre of pressure


class Plates(NamedTuple):
    """force (T, 2, 3) [N] on the left and the right foot, in the run's world; pressure (T, 2, 3) [m], NaN below 40 N;
    total (T, 3) [N]: of all plates."""

    force: np.ndarray
    pressure: np.ndarray
    total: np.ndarray

    @property
    def loaded(self) -> np.ndarray:
        """Feet (T, 2) on a plate."""
        return np.asarray(self.force[:, :, 2] > _LOADED)


def plates_of(path: Path, run: Run, delay: float = 0.0) -> Plates:
    """The plates of a trial's file. Each stretch in which a plate is loaded is the foot's that is nearer to its centres
    of pressure. delay [s]: of the run's clock behind the trial's."""
    time = run.time - delay
    force, moved = np.zeros((len(time), 2, 3)), np.zeros((len(time), 2, 3))
    middle, total = _feet(run), np.zeros((len(time), 3))
    for own, place in each_plate(path, time):
        total += own
        for first, after in stretches(own[:, 2] > _LOADED):
            rows = slice(first, after)
            apart = np.linalg.norm(middle[rows, :, :2] - place[rows, None, :2], axis=2)
            foot = int(np.argmin(own[rows, 2] @ apart))
            force[rows, foot] += own[rows]
            moved[rows, foot] += own[rows, 2:] * place[rows]
    enough = force[:, :, 2:] > _PLACED
    return Plates(force, np.where(enough, moved / np.where(enough, force[:, :, 2:], 1.0), np.nan), total)


def each_plate(path: Path, time: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each plate of a trial's file, the force (T, 3) [N] and the centre of pressure (T, 3) [m] at times (T,) [s], in
    the world."""
    measured, times = read_mot(path)

    def vector(plate: str, kind: str) -> np.ndarray:
        columns = [measured.values[:, measured.names.index(f"{plate}{kind}{axis}")] for axis in "xyz"]
        return np.stack([np.interp(time, times, column) for column in columns], axis=1) @ R_OPENSIM_WORLD

    plates = [name.removesuffix("vy") for name in measured.names if name.endswith("vy")]
    return [(vector(plate, "v"), vector(plate, "p")) for plate in plates]


def _feet(run: Run) -> np.ndarray:
    """Middles of the feet (T, 2, 3) [m]."""
    places = dict(zip(run.body.landmark_names, run.landmarks.transpose(1, 0, 2), strict=True))
    return np.stack([0.5 * (places[f"{side}_heel"] + places[f"{side}_big_toe"]) for side in SIDES], axis=1)
