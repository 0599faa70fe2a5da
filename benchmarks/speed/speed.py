"""Speed of tracking from keypoints alone, where its time goes, and how far it is from kinematics alone."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.speed.meter import KINDS, Meter
from benchmarks.support.common import Changes, Data, Json, data_folder, nested, save, spread
from benchmarks.support.tracking import timed_track
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.descent.compiled_seek import CompiledSeeker
from estimator.energy.descent.solution import Solution, StepCounts
from estimator.fitting.person import fit_person
from estimator.trackers.base import TrackerProtocol, energy_of
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body, PosedBody
from humanoid.subject.subject import Subject, load_subject
from kinemode import demo
from kinemode.inputs.load import load_inputs
from kinemode.progress import unreported
from kinemode.request import FileOptions
from kinemode.terminal import report

TARGET = 30.0
SAMPLE = 500  # evaluations that are timed by themselves


@dataclass(frozen=True)
class Job:
    """The tracked clip: keypoint files by camera, the subject with its fitted proportions, the observations."""

    name: str
    keypoints: dict[str, Path]
    cameras: Path
    subject: Subject
    observations: list[Observation]


@dataclass
class Tally:
    """Searches by their kind (explore, refine), steps tried in them, and ends of some: energies with their poses."""

    searches: Counter[int] = field(default_factory=Counter)
    steps: Counter[int] = field(default_factory=Counter)
    ends: list[tuple[Cost, PosedBody]] = field(default_factory=list)


def main(
    *,
    data: Data = None,
    camera: str = "cam01",
    repeats: int = 5,
    modes: int | None = None,
    seed: int = 0,
    tracker: str = "css",
    changes: Changes = (),
    json: Json = None,
) -> None:
    """Frames per second on beam4cam, or on the built-in clip where that is absent, and the share of every library.

    Parameters
    ----------
    camera
        Which of its cameras.
    repeats
        How often each measurement is repeated.
    modes, seed, tracker
        As in `kinemode track`.
    changes
        Changes to the settings, as cost.nu=8 css.samples=10.
    """
    nest = nested(changes)
    settings = settings_for(tracker, modes=modes, changes=nest)
    kept = getattr(settings.own, "modes", 1)
    with tempfile.TemporaryDirectory() as folder:
        job = make_job(data, camera, Path(folder), seed)
        make = lambda: make_tracker(tracker, Body(job.subject), settings)  # noqa: E731
        warm = track_all(make(), job, seed)
        figures = {"measure": "speed", "clip": job.name, "modes": kept, "settings": nest, "machine": unit(job, warm)}
        figures |= speeds(job, make, tracker, nest, modes, seed, repeats, Path(folder) / "one.run")
        figures |= searched(job, make, seed)
        figures |= shares(job, make, seed, repeats)
        figures |= floor(job, figures)
    show(figures, repeats)
    save(json, figures)


def make_job(data: Path | None, camera: str, folder: Path, seed: int) -> Job:
    shared = data_folder(data)
    beam = shared / "beam4cam" if shared is not None else None
    if beam is not None and beam.is_dir():
        files, cameras, name = {camera: beam / "keypoints" / f"{camera}.json"}, beam / "calibration.json", "beam4cam"
    else:
        clip = demo.make_clip(folder, videos=False, progress=unreported)
        name, camera = "the built-in clip", demo.CAMERA
        files, cameras = {camera: clip.keypoints[camera]}, clip.cameras
    subject = load_subject("human34")
    observations = load_inputs(Body(subject), FileOptions(None, keypoints=files, cameras=cameras)).observations
    subject = fit_person(subject, observations, seed=seed).subject
    return Job(f"{name} {camera}", files, cameras, subject, observations)


def track_all(tracker: TrackerProtocol[Any], job: Job, seed: int) -> list[np.ndarray]:
    """Poses of every mode of every frame; as a side effect everything compiled is warm."""
    return [q for result, _ in run(tracker, job.observations, seed) for q in result.q]


def unit(job: Job, poses: list[np.ndarray], rounds: int = 7) -> dict[str, float]:
    """Processor time of the kinematics alone, the yardstick of a machine [us]."""
    model = job.subject.model
    data = model.createData()
    v = np.full(model.nv, 1e-3)
    body = Body(job.subject)
    poses = poses[:500]
    return {
        "jacobians_us": _each(lambda q: pin.computeJointJacobians(model, data, q), poses, rounds),
        "all_terms_us": _each(lambda q: pin.computeAllTerms(model, data, q, v), poses, rounds),
        "integrate_us": _each(lambda q: pin.integrate(model, q, v), poses, rounds),
        "body_at_us": _each(body.at, poses, rounds),
    }


def _each(call: Callable[[Any], object], items: Sequence[Any], rounds: int) -> float:
    times = []
    for _ in range(rounds):
        start = time.process_time()
        for item in items:
            call(item)
        times.append((time.process_time() - start) / len(items))
    return 1e6 * float(np.median(times))


def speeds(
    job: Job, make: Callable[[], TrackerProtocol[Any]], name: str, changes: dict[str, Any], modes: int | None, seed:
    int, repeats: int, out: Path,
) -> dict[str, Any]:  # fmt: skip
    """Frames per second of the tracker alone, by the wall's clock and the processor's, and with the run file."""
    count = len(job.observations)
    wall, cpu, later, filed, smoothing = [], [], [], [], []
    for _ in range(repeats):
        tracker = make()
        marks = [(time.perf_counter(), time.process_time())]
        for _ in run(tracker, job.observations, seed):
            marks.append((time.perf_counter(), time.process_time()))
        wall.append(count / (marks[-1][0] - marks[0][0]))
        cpu.append(count / (marks[-1][1] - marks[0][1]))
        later.append((count - 1) / (marks[-1][1] - marks[1][1]))
        _, times = timed_track(
            job.keypoints, job.cameras, out, subject=job.subject, tracker=name, seed=seed, modes=modes, settings=changes
        )
        filed.append(times.rate)
        smoothing.append(1e3 * times.after / count)
    return {
        "frames": count, "fps_wall": wall, "fps_cpu": cpu, "fps_cpu_after_first": later, "fps_with_file": filed,
        "after_ms_per_frame": smoothing,
    }  # fmt: skip


@contextmanager
def tallied(tally: Tally) -> Iterator[None]:
    """Count the searches, by the budget they were given, and their steps."""
    seek = CompiledSeeker.seek

    def counted(self: CompiledSeeker, cost: Cost, q: np.ndarray, settings: Any = None) -> Solution:
        solution = seek(self, cost, q, settings)
        budget = (settings or self.settings).max_iterations
        tally.searches[budget] += 1
        tally.steps[budget] += solution.iterations
        if len(tally.ends) < SAMPLE:
            tally.ends.append((cost, solution.quadratic.posed))
        return solution

    CompiledSeeker.seek = counted  # type: ignore[method-assign]
    try:
        yield
    finally:
        CompiledSeeker.seek = seek  # type: ignore[method-assign]


def searched(job: Job, make: Callable[[], TrackerProtocol[Any]], seed: int) -> dict[str, Any]:
    """Searches a frame and steps a search, and who settled the steps; the first frame, a start, is counted apart."""
    tracker, tally = make(), Tally()
    results = run(tracker, job.observations, seed)
    next(results)
    counted = energy_of(tracker, "this tracker").seeker.solver
    before = counted.counts
    with tallied(tally):
        frames = sum(1 for _ in results)
    steps = StepCounts.between(before, counted.counts)
    return {
        "searches_per_frame": sum(tally.searches.values()) / frames,
        "steps_per_search": sum(tally.steps.values()) / max(1, sum(tally.searches.values())),
        "by_budget": {
            str(b): {"searches_per_frame": n / frames, "steps_per_search": tally.steps[b] / n}
            for b, n in sorted(tally.searches.items())
        },
        "evaluations_per_frame": (sum(tally.steps.values()) + sum(tally.searches.values())) / frames,
        "evaluation_us": {
            "gauss_newton": _each(lambda end: end[0].of(end[1]), tally.ends, 5),
            "exact": _each(lambda end: end[0].of(end[1], exact=True), tally.ends, 5),
        },
        "steps": steps._asdict(),
        "step_solver": counted.step_solver,
    }


def shares(job: Job, make: Callable[[], TrackerProtocol[Any]], seed: int, repeats: int) -> dict[str, Any]:
    """Share of the time inside each library, without what measuring cost."""
    plain, metered, kinds = [], [], []
    meter = Meter()
    for _ in range(repeats):
        start = time.perf_counter()
        track_all(make(), job, seed)
        plain.append(time.perf_counter() - start)
        meter = Meter()
        with meter.installed():
            tracker = make()
            meter.clear()  # what making the tracker took
            start = time.perf_counter()
            track_all(tracker, job, seed)
            wall = time.perf_counter() - start
        each, whole = meter.corrected(wall)
        metered.append(whole)
        kinds.append([each[k] / whole for k in KINDS])
    middle = np.median(np.array(kinds), axis=0)
    count = len(job.observations)
    return {
        "share": {**dict(zip(KINDS, middle.tolist(), strict=True)), "python and numpy": 1.0 - float(middle.sum())},
        "calls_per_frame": {k: meter.calls[k] / count for k in KINDS},
        "wrapper_us": {"inside": 1e6 * meter.inside, "around": 1e6 * meter.around},
        "metered_over_plain": float(np.median(metered) / np.median(plain)),
        "heaviest": {
            name: {"ms_per_frame": 1e3 * (s - meter.inside * meter.names[name]) / count,
                   "calls_per_frame": meter.names[name] / count}
            for name, s in sorted(meter.by_name.items(), key=lambda item: -item[1])[:12]
        },
    }  # fmt: skip


def floor(job: Job, figures: dict[str, Any]) -> dict[str, Any]:
    """Frames per second if Pinocchio's kinematics for the same evaluations were the only cost."""
    machine = figures["machine"]
    ms = 1e-3 * figures["evaluations_per_frame"] * (machine["jacobians_us"] + machine["integrate_us"])
    frame = 1e3 / float(np.median(figures["fps_cpu"]))
    later = 1e3 / float(np.median(figures["fps_cpu_after_first"]))
    return {
        "floor_ms_per_frame": ms, "ms_per_frame": frame, "times_the_floor": frame / ms,
        "frame_over_jacobians": 1e3 * later / machine["jacobians_us"],
        "evaluation_over_all_terms": {
            name: each / machine["all_terms_us"] for name, each in figures["evaluation_us"].items()
        },
        "smoothing_over_all_terms": 1e3 * float(np.median(figures["after_ms_per_frame"])) / machine["all_terms_us"],
    }  # fmt: skip


def show(f: dict[str, Any], repeats: int) -> None:
    out = report.console()
    made = report.table(f"tracking {f['clip']}, {f['modes']} modes, median of {repeats}", "frames per second", "")
    made.add_row("tracker alone, wall clock", spread(f["fps_wall"]))
    made.add_row("tracker alone, processor time", spread(f["fps_cpu"]))
    made.add_row("  after the first frame", spread(f["fps_cpu_after_first"]))
    made.add_row("with run file and smoothing, after the first frame, wall clock", spread(f["fps_with_file"]))
    made.add_row("target", f"{TARGET:.0f}")
    out.print(made)
    out.print(f"smoothing takes {np.median(f['after_ms_per_frame']):.1f} ms a frame, what follows is the tracker alone")
    made = report.table("where the time goes", "inside", "share", "calls a frame")
    for kind, share in f["share"].items():
        made.add_row(kind, f"{share:.1%}", f"{f['calls_per_frame'][kind]:.0f}" if kind in f["calls_per_frame"] else "")
    out.print(made)
    made = report.table("the heaviest", "call", "ms a frame", "calls a frame", "us a call")
    for name, spent in f["heaviest"].items():
        made.add_row(
            name, f"{spent['ms_per_frame']:.2f}", f"{spent['calls_per_frame']:.0f}",
            f"{1e3 * spent['ms_per_frame'] / spent['calls_per_frame']:.1f}",
        )  # fmt: skip
    out.print(made)
    made = report.table("searches", "budget of steps", "a frame", "steps a search")
    for budget, spent in f["by_budget"].items():
        made.add_row(budget, f"{spent['searches_per_frame']:.1f}", f"{spent['steps_per_search']:.2f}")
    made.add_row("all", f"{f['searches_per_frame']:.1f}", f"{f['steps_per_search']:.2f}")
    out.print(made)
    steps = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in f["steps"].items())
    out.print(f"steps by solver, search.step_solver being {f['step_solver']}: {steps}")
    out.print(
        f"a wrapper costs {f['wrapper_us']['around']:.2f} us, taken away;"
        f" metered and unmetered time then agree to a factor of {f['metered_over_plain']:.2f}"
    )
    out.print(
        f"floor: {f['evaluations_per_frame']:.0f} evaluations a frame at {f['machine']['jacobians_us']:.2f} us of"
        f" kinematics, and their integrations, are {f['floor_ms_per_frame']:.2f} ms; a frame takes"
        f" {f['ms_per_frame']:.1f} ms, {f['times_the_floor']:.0f} times the floor; after the first one it takes"
        f" {f['frame_over_jacobians']:.0f} times one call of pin.computeJointJacobians"
    )
    over = f["evaluation_over_all_terms"]
    out.print(
        f"over one call of pin.computeAllTerms ({f['machine']['all_terms_us']:.1f} us): an evaluation with derivatives"
        f" {over['gauss_newton']:.2f}, with the exact Hessian {over['exact']:.2f}; smoothing a frame"
        f" {f['smoothing_over_all_terms']:.0f}"
    )
