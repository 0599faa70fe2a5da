"""A tracked clip with the times it took, by the public interface."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.formats.run_file import Run
from humanoid.subject import Subject
from kinemode import api
from kinemode.progress import Progress


@dataclass(frozen=True)
class Times:
    """Seconds: until the first frame is done (files, fit, start), the other frames, what follows them (smoothing)."""

    before: float
    frames: float
    after: float
    count: int

    @property
    def rate(self) -> float:
        """Frames per second of tracking and smoothing, without files, fit and start."""
        return (self.count - 1) / max(self.frames + self.after, 1e-9)


def timed_track(
    keypoints: Mapping[str, Path],
    cameras: Path,
    out: Path,
    *,
    clips: Mapping[str, Path] | None = None,
    cues: str = "off",
    background: Mapping[str, Path] | None = None,
    subject: Subject | Path | str = "human34",
    fit: str = "auto",
    tracker: str = "css",
    seed: int = 0,
    modes: int = 7,
    settings: Mapping[str, Any] | None = None,
) -> tuple[Run, Times]:
    """Track from keypoints, and from the pictures where clips are given and cues are not off."""
    marks = [time.perf_counter()]

    @contextmanager
    def timed(stage: str) -> Iterator[Progress]:
        yield lambda done, total: marks.append(time.perf_counter()) if stage == "tracking" else None

    run = api.track(
        subject,
        clips,
        cameras=cameras,
        keypoints=keypoints,
        cues=cues,
        background=background,
        tracker=tracker,
        seed=seed,
        modes=modes,
        fit=fit,
        settings=settings,
        out=out,
        overwrite=True,
        progress=timed,
    )
    marks.append(time.perf_counter())
    return run, Times(marks[1] - marks[0], marks[-2] - marks[1], marks[-1] - marks[-2], len(run))
