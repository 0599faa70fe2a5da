"""How long a frame takes from its keypoints to its pose, frame by frame: the delay of live tracking.

Processor time is beside the wall's clock: on a machine that others use too, the difference is theirs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import kinemode as km
from benchmarks.support.common import Changes, Data, Json, data_folder, nested, save, tell, work_folder
from kinemode.demo import CAMERA, make_clip
from kinemode.terminal import report

TARGET = 60.0  # ms, 95 % of the frames
WARM_UP = 3  # frames of a tracker before, in which kernels are loaded
SHARES = (50, 95, 100)


@dataclass(frozen=True)
class Job:
    """keypoints (T, K, 3) of one camera at times (T,) [s]; given: the other arguments of `kinemode.Tracker`."""

    title: str
    points: np.ndarray
    times: np.ndarray
    given: dict[str, Any]


def main(
    *,
    frames: int | None = None,
    modes: int = 7,
    lag: int = 0,
    seed: int = 0,
    changes: Changes = (),
    data: Data = None,
    json: Json = None,
) -> None:
    """Median, 95th percentile and longest of a frame's time, with one camera's keypoints: cam01 of beam4cam, or the
    demonstration's where that is not here. The person is fitted beforehand.

    Parameters
    ----------
    frames
        Only so many of the first.
    modes, lag, seed
        As `kinemode.Tracker` has them.
    changes
        Changes to the settings, as css.budget.searches=30.
    """
    given = {"modes": modes, "lag": lag, "seed": seed, "settings": nested(changes)}
    with work_folder(None) as folder:
        job = make_job(data, folder, frames, given)
    timed(job, WARM_UP)
    wall, processor = timed(job, None)
    figures = {name: summary(each) for name, each in (("wall clock", wall), ("processor", processor))}
    show(figures, f"{job.title}, {len(wall)} frames, {modes} modes, lag {lag}")
    save(json, {"measure": "latency", "clip": job.title, "frames": len(wall), **given, "ms": figures})


def make_job(data: Path | None, work: Path, frames: int | None, given: dict[str, Any]) -> Job:
    """The clip that is there, with the person fitted to it."""
    folder = data_folder(data)
    beam = None if folder is None else folder / "beam4cam"
    if beam is not None and (beam / "calibration.json").is_file():
        title, cameras, file = "cam01 of beam4cam", beam / "calibration.json", beam / "keypoints" / "cam01.json"
    else:
        clip = make_clip(work, videos=False)
        title, cameras, file = "the demonstration", clip.cameras, clip.keypoints[CAMERA]
    seen = km.load_keypoints(file)
    tell(f"{title}: fitting the person")
    person = km.fit("human34", None, cameras=cameras, keypoints={file.stem: file}).subject
    points = np.concatenate([seen.pixels, seen.confidence[..., None]], axis=2)[:frames]
    camera = km.load_cameras(cameras)[file.stem]
    own = {"subject": person, "camera": camera, "layout": seen.layout, **given}
    return Job(title, points, np.arange(len(points)) / (seen.fps or 30.0), own)


def timed(job: Job, count: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Wall-clock and processor time [ms] of every frame, (T,) each."""
    tracker = km.Tracker(**job.given)
    wall, processor = [], []
    for points, at in zip(job.points[:count], job.times.tolist(), strict=False):
        began = time.perf_counter(), time.process_time()
        tracker.step(points, time=at)
        wall.append(time.perf_counter() - began[0])
        processor.append(time.process_time() - began[1])
    return 1e3 * np.array(wall), 1e3 * np.array(processor)


def summary(ms: np.ndarray) -> dict[str, float]:
    """The shares of the frames after the first, which finds the person, and that one."""
    rest = ms[1:] if len(ms) > 1 else ms
    return {**{f"p{share}": float(np.percentile(rest, share)) for share in SHARES}, "first": float(ms[0])}


def show(figures: dict[str, dict[str, float]], title: str) -> None:
    made = report.table(title, "ms a frame", "median", "95 %", "longest", "first frame")
    for name, each in figures.items():
        made.add_row(name, *(f"{value:.1f}" for value in each.values()))
    made.add_row("target", "", f"{TARGET:.0f}", "", "")
    report.console().print(made)
