"""A laboratory's people, whose joints are known from markers: the trials that are there, tracked on human34."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import kinemode as km
from estimator.runs.run_reader import Run

TRIALS = {
    "opencap/subject4": ("squats1", "STS1", "walking1", "walkingTS1", "static1"),
    "forces/another": ("walking2", "walking3", "DJ4"),
    "forces/light": ("walking1",),
}
"""By folder of the data, whose name is the person's."""


def measured_files(folder: Path) -> list[Path]:
    """The trials that are there."""
    trials = [folder / place / f"{name}.trc" for place, names in TRIALS.items() for name in names]
    return [path for path in trials if path.is_file()]


def measured_run(path: Path, fps: float) -> tuple[Run, np.ndarray]:
    """A trial by its markers, and the rows of the run that have a pose, about so many a second; all with fps
    infinite."""
    run = km.track("human34", points=path)
    step = max(1, round(1.0 / (fps * float(np.median(np.diff(run.time))))))
    return run, np.flatnonzero(np.isfinite(run.q).all(axis=1))[::step]
