"""Several people: how long files of a crowd take to read, how long one person takes to be found in four cameras, and
what that is worth: errors of a track from four cameras with two or three people in view, beside the person alone."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np

from benchmarks.accuracy.crowd_clips import FPS, NEAREST, WAYS, Clip, made, outcome, room_cameras, written
from benchmarks.accuracy.crowd_files import WRITERS, random_crowd
from benchmarks.support.common import Json, Several, in_processes, save, spread, tell, work_folder
from estimator.data.formats.keypoints import load_keypoints, load_people
from estimator.data.people.across_cameras import subject_tracks
from estimator.synthesis.detector import crowd, placed
from estimator.synthesis.motion import authored_motion
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import FORMATS
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

LIMIT = 5.0


def reading_times(people: int, frames: int, work: Path) -> dict[str, float]:
    """Seconds of processor time to read and link a crowd: each layout as OpenPose writes, COCO 17 as others do."""
    cases = [("OpenPose", layout) for layout in FORMATS] + [(writer, "coco17") for writer in WRITERS]
    seconds: dict[str, float] = {}
    for writer, layout in dict.fromkeys(cases):
        name = f"{writer}, {layout}"
        path = WRITERS[writer](work / f"{len(seconds)}", random_crowd(layout, people, frames, 0))
        begin = time.process_time()
        load_keypoints(path)
        seconds[name] = time.process_time() - begin
        tell(f"{name}: {seconds[name]:.2f} s")
    return seconds


def selection_time(people: int, frames: int, work: Path) -> float:
    """Seconds of processor time to find one person of a crowd in four cameras, files included."""
    rng, body = np.random.default_rng(0), Body(load_subject("human34"))
    side = 0.5 * NEAREST * np.sqrt(people)
    paths = [rng.uniform(-side, side, 2) + rng.normal(0.0, 0.02, (frames, 2)).cumsum(axis=0) for _ in range(people)]
    q = authored_motion(body, np.arange(frames) / FPS)
    motions = [placed(np.roll(q, int(rng.integers(frames)), axis=0), p, rng.uniform(0.0, 2.0 * np.pi)) for p in paths]
    cameras = room_cameras(side + 0.5)
    files = written(crowd(body, motions, cameras, rng), work)
    begin = time.process_time()
    subject_tracks({name: load_people(path) for name, path in files.items()}, {c.name: c for c in cameras}, {})
    return time.process_time() - begin


def main(
    *,
    people: int = 300,
    frames: int = 100,
    clips: Annotated[tuple[int, ...], Several] = (2, 3),
    clip_frames: int = 50,
    seeds: int = 5,
    jobs: int = 1,
    json: Json = None,
) -> None:
    """Print the times and the errors.

    Parameters
    ----------
    people, frames: of the crowd that is read. clips: how many people the tracked clips have.
    clip_frames, seeds: frames of a clip, clips of each kind. jobs: processes.
    """
    with work_folder(None) as work:
        times = reading_times(people, frames, work)
        chosen = selection_time(people, frames, made(work / "crowd"))
        tasks = [Clip(n, clip_frames, seed, made(work / f"{n}_{seed}")) for n in clips for seed in range(seeds)]
        outcomes = in_processes(outcome, tasks, jobs)
    table = report.table(f"{people} people in {frames} frames, processor time [s]", "file", "time")
    for name, seconds in times.items():
        table.add_row(name, f"{seconds:.2f}" + (" !" if seconds > LIMIT else ""))
    table.add_row("one of them in four cameras, COCO 17, files included", f"{chosen:.2f}")
    report.console().print(table)
    table = report.table(
        f"four cameras, {seeds} clips of {clip_frames} frames", "people", "keypoints", "MPJPE [mm]", "hard", "mixed"
    )
    for n in clips:
        rows = [o for task, o in zip(tasks, outcomes, strict=True) if task.people == n]
        for k, way in enumerate(WAYS):
            hard, both = sum(o.hard[k] for o in rows), np.mean([o.mixed[k] for o in rows])
            table.add_row(str(n), way, spread([o.mpjpe[k] for o in rows]), str(hard), f"{both:.0%}")
    report.console().print(table)
    save(json, {"seconds": times, "selection": chosen, "clips": [asdict(o) for o in outcomes]})
