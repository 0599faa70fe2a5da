"""A tracked clip with the time it took, by the public interface."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from estimator.formats.run_file import Run
from humanoid.subject import Subject
from kinemode import api


def timed_track(
    keypoints: Mapping[str, Path],
    cameras: Path,
    out: Path,
    *,
    subject: Subject | str = "human34",
    tracker: str = "css",
    seed: int = 0,
    modes: int = 7,
    settings: Mapping[str, Any] | None = None,
) -> tuple[Run, float]:
    """Track from keypoints alone; the run, and frames per second after the first frame, files and fit not counted."""
    marks: list[tuple[float, int]] = []
    run = api.track(
        subject,
        None,
        cameras=cameras,
        keypoints=keypoints,
        tracker=tracker,
        seed=seed,
        modes=modes,
        settings=settings,
        out=out,
        overwrite=True,
        progress=lambda done, total: marks.append((time.perf_counter(), done)),
    )
    if len(marks) < 2:
        return run, float("nan")
    return run, (marks[-1][1] - marks[0][1]) / max(marks[-1][0] - marks[0][0], 1e-9)
