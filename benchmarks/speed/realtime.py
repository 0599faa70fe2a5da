"""Sustained frames per second with keypoints and pictures, and where the time goes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from threadpoolctl import threadpool_limits

import kinemode as km
from benchmarks.support.common import CUES, Changes, Json, Several, Work, nested, save, spread, tell, work_folder
from benchmarks.support.stopwatch import Stopwatch
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.data.observation import Observation
from estimator.data.sequence import assemble
from estimator.search.frame_search import FrameSearch
from estimator.trackers.base import TrackerProtocol
from estimator.tracking.registry import Settings, make_tracker, settings_for
from estimator.tracking.runner import run
from estimator.vision.cues.image_likelihood import CameraLikelihood
from estimator.vision.cues.reader import CueReader, ReadAhead
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

TARGET, WANTED = 15.0, 25.0
WAYS = {False: "cues read on demand", True: "cues read ahead"}
WARM_UP = 5  # frames in which kernels are loaded and hypotheses found
REST = "proposals, weights and the rest"
PARTS: dict[str, list[tuple[type, str]]] = {
    "cues of the picture": [(CueReader, "at")],
    "flow followed": [(CameraLikelihood, "follow"), (CameraLikelihood, "since")],
    "prediction and assignment": [(CameraLikelihood, "assigned")],
    "searches": [(FrameSearch, "explore"), (FrameSearch, "refine")],
    "looks": [(FrameSearch, "score"), (FrameSearch, "score_keypoints")],
}


@dataclass(frozen=True)
class Job:
    """What is tracked: the body, its observations, the clip with its pictures' camera, and how."""

    body: Body
    observations: list[Observation]
    video: Path
    settings: Settings
    seed: int
    used: tuple[str, ...]

    @contextmanager
    def cues(self, ahead: bool) -> Iterator[CueReader | ReadAhead]:
        """The pictures' cues that are `used`, by name; read ahead in a thread or on demand."""
        reader = CueReader([self.video], self.observations[0].cameras, cue_settings(self.used))
        opened = ReadAhead(reader) if ahead else reader
        try:
            yield opened
        finally:
            opened.close()

    def tracker(self) -> TrackerProtocol[Any]:
        return make_tracker("css", self.body, self.settings)


def main(
    *,
    seconds: float = 4.0,
    fps: float = 25.0,
    cues: Annotated[tuple[str, ...], Several] = CUES,
    repeats: int = 3,
    modes: int = 7,
    seed: int = 0,
    changes: Changes = (),
    work: Work = None,
    json: Json = None,
) -> None:
    """Frames per second of human34 turning and reaching, 640 x 480, from a detector's keypoints and the pictures.

    Parameters
    ----------
    seconds, fps
        How much of the motion is rendered, and its frame rate.
    cues
        Cues of the pictures beside the keypoints.
    repeats
        How often each way is run; they take turns.
    modes, seed
        As in `kinemode track`.
    changes
        Changes to the settings, as cost.nu=8 css.budget.searches=30.
    """
    settings = settings_for("css", modes=modes, changes=nested(changes))
    with work_folder(work) as folder, threadpool_limits(limits=1):
        job = make_job(folder, seconds, fps, settings, seed, cues)
        rates: dict[bool, list[float]] = {ahead: [] for ahead in WAYS}
        for _ in range(repeats):
            for ahead, name in WAYS.items():
                rates[ahead].append(rate(job, ahead))
                tell(f"{name}: {rates[ahead][-1]:.1f} frames a second")
        parts = shares(job)
    show(rates, parts, f"keypoints, {', '.join(job.used)}, {len(job.observations)} frames")
    rows = [{"ahead": ahead, "fps": of_way} for ahead, of_way in rates.items()]
    save(
        json,
        {
            "measure": "realtime",
            "cues": job.used,
            "frames": len(job.observations),
            "rates": rows,
            "ms_per_frame": parts,
        },
    )


def make_job(folder: Path, seconds: float, fps: float, settings: Settings, seed: int, cues: tuple[str, ...]) -> Job:
    clip = km.render(folder, "turn_reach", fps=fps, seconds=seconds, seed=1)
    body, cameras = Body(load_subject(clip.subject)), load_cameras(clip.cameras)
    ((name, video),) = clip.videos.items()
    times = np.arange(round(seconds * fps)) / fps
    observations = assemble(body, {name: load_keypoints(clip.keypoints[name])}, cameras, times)
    return Job(body, observations, video, settings, seed, cues)


def rate(job: Job, ahead: bool) -> float:
    """Frames per second by the wall's clock, once warm."""
    tracker = job.tracker()
    with job.cues(ahead) as cues:
        marks = [time.perf_counter() for _ in run(tracker, job.observations, job.seed, cues=cues)]
    return (len(marks) - WARM_UP) / (marks[-1] - marks[WARM_UP - 1])


def shares(job: Job) -> dict[str, float]:
    """Processor time of every part [ms a frame], once warm."""
    tracker, watch = job.tracker(), Stopwatch()
    with job.cues(False) as cues, watch.installed(PARTS):
        results = run(tracker, job.observations, job.seed, cues=cues)
        for _ in range(WARM_UP):
            next(results)
        watch.seconds.clear()
        begin = time.process_time()
        count = sum(1 for _ in results)
        whole = 1e3 * (time.process_time() - begin) / count
    spent = {part: 1e3 * watch.seconds[part] / count for part in PARTS}
    return {**spent, REST: whole - sum(spent.values())}


def show(rates: dict[bool, list[float]], parts: dict[str, float], title: str) -> None:
    out = report.console()
    made = report.table(title, "way", "frames per second")
    for ahead, of_way in rates.items():
        made.add_row(WAYS[ahead], spread(of_way))
    made.add_row("target", f"{TARGET:.0f}")
    out.print(made)
    whole = sum(parts.values())
    made = report.table("where the time goes", "part", "ms a frame", "share")
    for part, ms in parts.items():
        made.add_row(part, f"{ms:.1f}", f"{ms / whole:.0%}")
    made.add_row("all", f"{whole:.1f}", "100%")
    out.print(made)
    best = max(float(np.median(of_way)) for of_way in rates.values())
    if best < WANTED:
        over = whole * (1.0 - best / WANTED)
        out.print(f"{WANTED:.0f} frames a second need {over:.0f} ms less of a frame's {whole:.0f} ms")
