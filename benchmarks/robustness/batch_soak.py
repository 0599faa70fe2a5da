"""Memory that must not grow: in one long clip with pictures, and in the workers of a batch of many clips."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kinemode as km
from benchmarks.robustness.batch_clips import FPS, short_clips
from benchmarks.support.common import quiet, tell
from benchmarks.support.proc import ResidentMemory, memory, spawned_workers
from estimator.data.formats.keypoints import write_keypoints
from estimator.data.media.clip import Clip
from estimator.data.media.film import write_film
from estimator.synthesis.settings import ViewSettings
from humanoid.support.errors import InputError
from kinemode.progress import Progress
from kinemode.terminal import report

SIZE = (320, 240)
LOOP = 90  # frames that are rendered; forward and backward again and again they make the long clip
GROWTH = 1.05  # target
DISTINCT = 24  # clips, which a batch of many has several times
FIRST = 10  # clips, after which the memory of workers is to stay
WORKERS = 2


class SoakSample(NamedTuple):
    """After so many frames: processor time since the start [s], memory [MB]."""

    frames: int
    processor: float
    now: float
    peak: float


@dataclass(frozen=True)
class LongClip:
    """The tracked clip, and how often memory is sampled [frames]."""

    given: dict[str, Any]
    out: Path
    window: int


def long_clip(folder: Path, frames: int, cues: str, settings: Path | None) -> dict[str, Any]:
    """Arguments of `kinemode.track`: a rendered clip forward and backward until it has so many frames."""
    count = min(LOOP, frames)
    clip = km.render(folder, "reach", view=ViewSettings(image_size=SIZE), fps=FPS, seconds=count / FPS, seed=1)
    ((camera, video),) = clip.videos.items()
    order = np.resize(np.concatenate([np.arange(count), np.arange(count - 2, 0, -1)]), frames)
    opened = Clip.open(video)
    pictures = [picture.copy() for picture in opened.frames()]
    opened.close()
    film = write_film(folder / "long.mp4", (pictures[i] for i in order), FPS)
    seen = km.load_keypoints(clip.keypoints[camera])
    points = folder / "long.json"
    write_keypoints(points, replace(seen, pixels=seen.pixels[order], confidence=seen.confidence[order]))
    tell(f"a clip of {frames} frames is made")
    more = {} if settings is None else {"settings": settings}
    return {"clips": {camera: film}, "cameras": clip.cameras, "keypoints": {camera: points}, "cues": cues} | more


def sampled_track(task: LongClip) -> list[SoakSample]:
    """Track; a sample after the first two frames, in which kernels are loaded, after each window, and at the end."""
    samples: list[SoakSample] = []

    def sample(frames: int) -> None:
        samples.append(SoakSample(frames, time.process_time(), *memory()))

    @contextmanager
    def progress(stage: str) -> Iterator[Progress]:
        def mark(done: int, total: int) -> None:
            if stage == "tracking" and (done == 2 or done % task.window == 0):
                sample(done)
                tell(f"{done} of {total} frames: {samples[-1].now:.0f} MB now, {samples[-1].peak:.0f} MB at most")

        yield mark

    run = km.track("human34", **task.given, out=task.out, overwrite=True, progress=progress)
    sample(len(run))
    return samples


def measure_soak(folder: Path, frames: int, window: int, cues: str, settings: Path | None) -> dict[str, Any]:
    """Print the windows; the figures. Raises InputError for fewer than two windows, or a killed process."""
    if not 2 < window <= frames // 2:
        raise InputError("--window", f"must be 3 to {frames // 2}, half of --length, got {window}")
    given = long_clip(folder / "inputs", frames, cues, settings)
    try:
        with ProcessPoolExecutor(1, get_context("spawn"), quiet) as pool:
            samples = pool.submit(sampled_track, LongClip(given, folder / "long.run", window)).result()
    except BrokenProcessPool:
        raise InputError("--soak", "the process that tracks was killed", remedy="is there memory for it?") from None
    *windows, last = samples
    made = report.table(f"{frames} frames, {cues}", "frames", "ms a frame, processor", "memory now", "peak [MB]")
    times = [1e3 * (b.processor - a.processor) / (b.frames - a.frames) for a, b in pairwise(windows)]
    for at, ms in zip(windows[1:], times, strict=True):
        made.add_row(str(at.frames), f"{ms:.1f}", f"{at.now:.0f}", f"{at.peak:.0f}")
    made.add_row(
        "smoothed",
        f"{1e3 * (last.processor - windows[-1].processor):.0f} in all",
        f"{last.now:.0f}",
        f"{last.peak:.0f}",
    )
    out = report.console()
    out.print(made)
    ratios = {
        "peak, tracked": windows[-1].peak / windows[1].peak,
        "peak, smoothed": last.peak / windows[1].peak,
        "time of the last window": times[-1] / times[0],
        "time of the slowest window": max(times) / times[0],
    }
    said = ", ".join(f"{name} {value:.3f}" for name, value in ratios.items())
    out.print(f"against the first {window} frames: {said} (target: at most {GROWTH:g})")
    listed = [sample._asdict() for sample in samples]
    return {"frames": frames, "cues": cues, "samples": listed, "ms": times, "ratios": ratios}


@dataclass(frozen=True)
class WorkerSample:
    """Memory of the workers [MB] when so many clips were finished, by process."""

    clips: int
    workers: dict[int, ResidentMemory]


def measure_many(folder: Path, clips: int, frames: int, settings: Path | None) -> dict[str, Any]:
    """Print the memory of the workers of a batch; the figures."""
    distinct = short_clips(folder / "inputs", min(clips, DISTINCT), frames, settings)
    rows = [{**distinct[i % len(distinct)], "name": f"clip{i:04d}"} for i in range(clips)]
    samples: list[WorkerSample] = []

    @contextmanager
    def progress(stage: str) -> Iterator[Progress]:
        def mark(done: int, total: int) -> None:
            if done and (done % FIRST == 0 or done == total):
                samples.append(WorkerSample(done, {pid: memory(pid) for pid in spawned_workers()}))
                each = ", ".join(f"{now:.0f} ({peak:.0f})" for now, peak in samples[-1].workers.values())
                tell(f"{done} of {total} clips: {each} MB")

        yield mark

    done = km.batch(rows, out=folder / "many", workers=WORKERS, progress=progress)
    growth = grown(samples)
    made = report.table(f"{clips} clips by {WORKERS} processes", "clips", "memory of each worker now (at most) [MB]")
    for sample in samples:
        made.add_row(str(sample.clips), ", ".join(f"{now:.0f} ({peak:.0f})" for now, peak in sample.workers.values()))
    out = report.console()
    out.print(made)
    said = ", ".join(f"{value:.3f}" for value in growth)
    out.print(f"peak memory of each worker against that after {samples[0].clips} clips: {said} (target: no growth)")
    out.print(f"clips that failed: {len(done.failed)}")
    return {"clips": clips, "samples": [asdict(s) for s in samples], "growth": growth, "failed": done.failed}


def grown(samples: Sequence[WorkerSample]) -> list[float]:
    """The peak memory of each worker at the end relative to that at the start."""
    first, last = samples[0].workers, samples[-1].workers
    return [last[pid].peak / first[pid].peak for pid in first if pid in last]
