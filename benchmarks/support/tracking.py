"""A tracked clip with the times it took, by the public interface."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import kinemode as km
from estimator.runs.run_reader import Run
from humanoid.subject.subject import Subject
from kinemode.progress import Progress

Fitted = Literal["auto", "proportions", "markers", "off"]
"""The fitted parts of a subject, see `kinemode.track`."""


@dataclass(frozen=True)
class Times:
    """Seconds: until the first frame is done (files, fit, start), the other frames, what follows them (smoothing).

    count: frames. cpu: seconds of processor time a frame, of tracking and smoothing, without the first two frames, in
    which kernels are loaded; NaN where there are no others. cpu_tracking: that of tracking alone.
    """

    before: float
    frames: float
    after: float
    count: int
    cpu: float
    cpu_tracking: float

    @property
    def rate(self) -> float:
        """Frames per second of tracking and smoothing, without files, fit and start."""
        return (self.count - 1) / max(self.frames + self.after, 1e-9)


def timed_track(
    keypoints: Mapping[str, Path] | None,
    cameras: Path,
    out: Path,
    *,
    clips: Mapping[str, Path] | None = None,
    cues: str = "off",
    background: Mapping[str, Path] | None = None,
    subject: Subject | Path | str = "human34",
    fit: Fitted = "auto",
    tracker: str = "css",
    seed: int = 0,
    modes: int | None = None,
    settings: Mapping[str, Any] | None = None,
    frames: int | None = None,
    **more: Any,
) -> tuple[Run, Times]:
    """Track from keypoints, and from pictures where clips are given and cues not off; `frames`: stop after these. more:
    other arguments of `kinemode.track`."""
    marks = [_now()]

    @contextmanager
    def timed(stage: str) -> Iterator[Progress]:
        def mark(done: int, total: int) -> None:
            if stage == "tracking":
                marks.append(_now())
                if done == frames:
                    raise _Enough

        yield mark

    with suppress(_Enough):
        km.track(
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
            **more,
        )
    marks.append(_now())
    run = km.open_run(out)
    clock = [mark[0] for mark in marks]
    tracking, smoothing = _cpu(marks)
    seconds = clock[1] - clock[0], clock[-2] - clock[1], clock[-1] - clock[-2]
    return run, Times(*seconds, len(run), tracking + smoothing, tracking)


class _Enough(Exception):  # noqa: N818, not an error
    """The requested number of frames is done."""


def _now() -> tuple[float, float]:
    """The clock and the processor time of this process [s]."""
    return time.perf_counter(), time.process_time()


def _cpu(marks: list[tuple[float, float]]) -> tuple[float, float]:
    """Time of tracking and of smoothing a frame, see `Times`; marks: at the start, after each frame, at the end."""
    spent = [mark[1] for mark in marks]
    frames = len(marks) - 2
    if frames < 3:
        return float("nan"), float("nan")
    return (spent[-2] - spent[2]) / (frames - 2), (spent[-1] - spent[-2]) / frames
