"""`--sync auto`: clocks of cameras found from their keypoints, and their uncertainty, where the truth is known.

The clip beam4cam with cameras that start, and end, too late; and motion capture that two cameras see as a detector
does, with frame rates of their own; then clips without information: no one moves, or no time is in common.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.support.common import Data, Json, beam_folder, captured_folder, in_processes, save
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.data.synchronisation import synchronised
from estimator.runs.evaluation import LIMB_JOINTS
from estimator.synthesis.detector import of_points
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from kinemode.terminal import report

NAMES = ("cam01", "cam02", "cam03", "cam04")
SHIFTS = (0.1, 1.5)  # [s]
RATE = 60.0


@dataclass(frozen=True)
class Clock:
    """One camera's clock as it was found: error in frames of the slowest camera, NaN where it could not be
    determined."""

    error: float
    sure: bool
    margin: float
    deviation: float
    shift: float

    @property
    def right(self) -> bool:
        """Within one frame."""
        return abs(self.error) <= 1.0 + 1e-6


@dataclass(frozen=True)
class Views:
    """What cameras saw: pixels (C) of (N, L, 2) at times (C) of (N,) [s] on their own clocks, which began at `begins`
    (C) [s]."""

    cameras: tuple[Camera, ...]
    pixels: tuple[np.ndarray, ...]
    times: tuple[np.ndarray, ...]
    begins: np.ndarray

    def clocks(self) -> list[Clock]:
        """The estimated clocks of all but the first camera."""
        estimate = synchronised(self.cameras, self.pixels, self.times)
        frame = max(float(np.median(np.diff(of))) for of in self.times)
        truth = self.begins - self.begins[0]
        errors = (estimate.offsets - truth) / frame
        return [
            Clock(
                float(errors[c]),
                bool(estimate.sure[c]),
                float(estimate.margin[c]),
                float(estimate.errors[c]) / frame,
                truth[c],
            )
            for c in range(1, len(self.cameras))
        ]


def shifts(rng: np.random.Generator, count: int) -> np.ndarray:
    """The start of each of some cameras [s]: 0.1 to 1.5 s earlier, or later, than the others, one at least."""
    late = rng.choice(count, rng.integers(1, count), replace=False) if count > 1 else np.zeros(1, dtype=int)
    begins = np.zeros(count)
    begins[late] = rng.uniform(*SHIFTS, len(late)) * rng.choice([-1.0, 1.0])
    return begins - begins.min()


def of_beam(rng: np.random.Generator, data: Path, detector: str, count: int, shortest: float) -> Views:
    """Some cameras of the clip, each from its start to its end: a part of 1.67 s, `shortest` at least."""
    folder = beam_folder(data)
    names = sorted(rng.choice(NAMES, count, replace=False).tolist())
    known = load_cameras(folder / "calibration.json")
    tracks = [load_keypoints(folder / detector / f"{name}.json") for name in names]
    pixels = [np.where((t.confidence > 0.0)[..., None], t.pixels, np.nan) for t in tracks]
    first = np.round(shifts(rng, count) * RATE).astype(int)
    last = [int(max(f + 6, rng.uniform(shortest, 1.0) * 100)) for f in first]
    parts = [p[a:b] for p, a, b in zip(pixels, first.tolist(), last, strict=True)]
    times = tuple(np.arange(len(p)) / RATE for p in parts)
    return Views(tuple(known[name] for name in names), tuple(parts), times, first / RATE)


def of_capture(rng: np.random.Generator, data: Path, kind: str) -> Views:
    """Two cameras and a captured person, parts of 2 to 6 s. kind: "rates" for 30 and 60 frames per second, "still" for
    one pose, "apart" for parts of the clip that do not meet."""
    files = sorted((data / "mocap").glob("*.bvh"))
    while True:
        mocap = load_mocap(files[int(rng.integers(len(files)))])
        if mocap.seconds > (2.5 if kind != "apart" else 5.0):
            break
    limbs = [mocap.names.index(name) for name in LIMB_JOINTS]
    rates = rng.permutation([30.0, 60.0]) if kind == "rates" else np.full(2, rng.choice([30.0, 60.0]))
    begins = shifts(rng, 2) + rng.uniform(0.0, 1.0)
    seconds = rng.uniform(2.0, 6.0, 2)
    if kind == "apart":
        seconds[:] = 2.0
        begins = rng.permutation([0.0, rng.uniform(2.1, 3.0)])
    step = float(rng.uniform(50.0, 130.0))
    first = float(rng.uniform(-180.0, 180.0))
    cameras, pixels, times = [], [], []
    for c in range(2):
        view = ViewSettings(azimuth=(first + c * step + 180.0) % 360.0 - 180.0, image_size=(1280, 720))
        (camera,) = framing_cameras(mocap.points, view)
        own = np.arange(int(seconds[c] * rates[c])) / rates[c]
        own = own[own + begins[c] < max(mocap.seconds - 0.02, begins[c] + 0.1)]
        at = np.full(len(own), 0.5 * mocap.seconds) if kind == "still" else own + begins[c]
        noise = DetectorSettings(float(rng.uniform(2.0, 5.0)), 0.02, 0.03)
        track = of_points(tuple(LIMB_JOINTS), "limbs", mocap.at(at)[:, limbs], camera, rng, noise, rates[c])
        cameras.append(camera)
        pixels.append(track.pixels)
        times.append(own)
    return Views(tuple(cameras), tuple(pixels), tuple(times), begins)


KINDS: dict[str, Callable[[np.random.Generator, Path], Views]] = {
    "beam4cam, four cameras": lambda rng, data: of_beam(rng, data, "keypoints", 4, 1.0),
    "the same, ends cut": lambda rng, data: of_beam(rng, data, "keypoints", 4, 0.4),
    "the same, better keypoints": lambda rng, data: of_beam(rng, data, "keypoints_multicrop", 4, 0.4),
    "beam4cam, two cameras": lambda rng, data: of_beam(rng, data, "keypoints", 2, 0.6),
    "capture, two cameras": lambda rng, data: of_capture(rng, data, ""),
    "the same, 30 and 60 frames/s": lambda rng, data: of_capture(rng, data, "rates"),
    "no one moves": lambda rng, data: of_capture(rng, data, "still"),
    "no moment in common": lambda rng, data: of_capture(rng, data, "apart"),
}


@dataclass(frozen=True)
class Task:
    """One trial."""

    kind: str
    seed: int
    data: Path


def trial(task: Task) -> list[Clock]:
    """The clocks of one trial."""
    rng = np.random.default_rng((list(KINDS).index(task.kind), task.seed))
    return KINDS[task.kind](rng, task.data).clocks()


def main(
    *,
    data: Data = None,
    trials: int = 40,
    seed: int = 0,
    jobs: int = 1,
    json: Json = None,
) -> None:
    """Print how many clocks are within one frame, and how many of the others are reported as uncertain.

    Parameters
    ----------
    trials: of each kind. seed: of the first trial. jobs: processes.
    """
    folder = captured_folder(data)
    if folder is None:
        return
    tasks = [Task(kind, seed + k, folder) for kind in KINDS for k in range(trials)]
    outcomes = in_processes(trial, tasks, jobs)
    by_kind: dict[str, list[Clock]] = {kind: [] for kind in KINDS}
    for task, clocks in zip(tasks, outcomes, strict=True):
        by_kind[task.kind] += clocks
    table = report.table(
        f"clocks of {trials} trials of each kind; offsets {SHIFTS[0]:g} to {SHIFTS[1]:g} s, both signs; right: within a"
        " frame",
        "clip", "clocks", "right, sure", "wrong, sure", "right, unsure", "wrong, unsure", "error of the sure",
    )  # fmt: skip
    for kind, clocks in by_kind.items():
        counts = [sum(c.right == right and c.sure == sure for c in clocks) for right, sure in ORDER]
        errors = [abs(c.error) for c in clocks if c.sure]
        far = f"{np.mean(errors):.2f}, at most {max(errors):.2f}" if errors else "-"
        table.add_row(kind, str(len(clocks)), *map(str, counts), far)
    report.console().print(table)
    save(json, {kind: [asdict(c) for c in clocks] for kind, clocks in by_kind.items()})


ORDER = ((True, True), (False, True), (True, False), (False, False))
