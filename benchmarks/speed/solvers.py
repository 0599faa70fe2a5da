"""The constrained step by each of its solvers on whole tracks: whose steps they were, equal bits, and the time."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.robustness.bits_cases import CASES
from benchmarks.support.common import Data, Json, Several, save, spread, tell
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import write_keypoints
from estimator.data.observation import Observation
from estimator.energy.descent.qp import ACTIVE_SET, PROXQP, STEP_SOLVERS, StepSolver
from estimator.energy.descent.solution import StepCounts
from estimator.fitting.person import fit_person
from estimator.synthesis import detector
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.trackers.base import energy_of
from estimator.trackers.frame_result import FrameResult
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject, load_subject
from humanoid.support.errors import InputError
from kinemode.inputs.load import load_inputs
from kinemode.request import FileOptions
from kinemode.target import made_folder
from kinemode.terminal import report

TARGET = 1.25  # time of a frame with "proxqp" over "active-set"
CLIPS = ("cam01", "four", "demo", "contact")
ARRAYS = ("q", "weight", "energy", "covariance", "kkt_residual", "penetration")
CROSSED = {"left_shoulder_elevation": 0.1, "left_shoulder_flexion": 0.5, "left_shoulder_rotation": 1.2,
           "left_elbow_flexion": 1.9}  # fmt: skip  # the left hand inside the trunk
FPS = 10.0


@dataclass(frozen=True)
class Job:
    """A clip to track: the subject with its fitted proportions, the observations."""

    name: str
    subject: Subject
    observations: Sequence[Observation]


class Watch(StepSolver):
    """Counts also the steps of ProxQP with clearance rows, and convex ones that were the active set's."""

    by_rows = convex_by_active_set = 0

    def solve(self, hessian, gradient, damping, radius, q, active, rows=None):  # type: ignore[no-untyped-def]
        before = self.counts
        step = super().solve(hessian, gradient, damping, radius, q, active, rows)
        counted = StepCounts.between(before, self.counts)
        self.by_rows += counted.proxqp if rows is not None else 0
        if counted.active_set:
            self.convex_by_active_set += int(np.linalg.eigvalsh(self._M)[0] > 0.0)
        return step


def main(
    *,
    data: Data = None,
    clips: Annotated[tuple[str, ...], Several] = CLIPS,
    frames: int | None = None,
    repeats: int = 5,
    seed: int = 0,
    json: Json = None,
) -> None:
    """Track clips from keypoints with every `search.step_solver`; compare steps, bits and processor time.

    Parameters
    ----------
    clips
        Of cam01 and four (beam4cam with one and four cameras), demo, and contact (a hand pressed into the trunk).
    frames
        At most so many of each.
    repeats
        Pairs of tracks whose times are compared, who comes first in turn; 0 for none.
    seed
        Seed of the trackers.
    """
    if unknown := set(clips) - set(CLIPS):
        raise InputError("--clips", f"there is no {min(unknown)!r}", remedy="of " + ", ".join(CLIPS))
    figures: dict[str, Any] = {"measure": "solvers", "repeats": repeats, "clips": {}}
    for clip in clips:
        with tempfile.TemporaryDirectory() as folder:
            job = made(clip, Path(folder), data, frames, seed)
        figures["clips"][clip] = {"frames": len(job.observations), **compared(job, seed), **timed(job, seed, repeats)}
        tell(f"{clip}: done")
    show(figures)
    save(json, figures)


def made(clip: str, folder: Path, data: Path | None, frames: int | None, seed: int) -> Job:
    if clip != "contact" and (reason := CASES[clip].absent(data)):
        raise InputError("--clips", f"{clip} cannot be tracked: {reason}")
    given = crossing(folder) if clip == "contact" else CASES[clip].given(made_folder(folder), None, data)
    subject = load_subject("human34")
    files = FileOptions(None, keypoints=given["keypoints"], cameras=given["cameras"])
    observations = load_inputs(Body(subject), files).observations
    if clip != "contact":
        subject = fit_person(subject, observations, seed=seed).subject
    return Job(clip, subject, observations[:frames])


def crossing(folder: Path, count: int = 12) -> dict[str, Any]:
    """Keypoint files of four cameras that see the left hand go into the trunk and out of it again."""
    body, rng = Body(load_subject("human34")), np.random.default_rng(1)
    end = body.neutral.copy()
    for name, angle in CROSSED.items():
        end[body.model.idx_qs[body.model.getJointId(name)]] = angle
    move, share = body.difference(body.neutral, end), 0.5 - 0.5 * np.cos(np.linspace(0.0, 2.0 * np.pi, count))
    q = np.array([body.integrate(body.neutral, s * move) for s in share])
    points = np.array([body.landmarks(body.at(each)) for each in q])
    cameras = framing_cameras(points, ViewSettings(count=4))
    files = {camera.name: folder / f"{camera.name}.json" for camera in cameras}
    for camera, track in zip(
        cameras, detector.keypoints(body, q, cameras, rng, DetectorSettings(1.0), fps=FPS), strict=True
    ):
        write_keypoints(files[camera.name], track)
    write_cameras(folder / "cameras.json", cameras)
    return {"keypoints": files, "cameras": folder / "cameras.json"}


def tracked(job: Job, solver: str, seed: int, watched: bool) -> tuple[list[FrameResult], StepSolver, float]:
    """The results, the step solver with its counts, and the processor time a frame without the first [ms]."""
    tracker = make_tracker("css", Body(job.subject), settings_for("css", changes={"search": {"step_solver": solver}}))
    seeker = energy_of(tracker, "this tracker").seeker
    if watched:
        seeker.solver = Watch(seeker.body, solver)
    results, began = [], 0.0
    for result, _ in run(tracker, job.observations, seed):
        results.append(result)
        began = began or time.process_time()
    return results, seeker.solver, 1e3 * (time.process_time() - began) / max(1, len(results) - 1)


def compared(job: Job, seed: int) -> dict[str, Any]:
    """Steps by solver, and how far the tracks are from that of the active set."""
    ends = {solver: tracked(job, solver, seed, watched=True) for solver in STEP_SOLVERS}
    reference = ends[ACTIVE_SET][0]
    figures: dict[str, Any] = {}
    for name, (results, solver, _) in ends.items():
        assert isinstance(solver, Watch)
        figures[name] = {
            **solver.counts._asdict(), "with_rows": solver.by_rows, "uncertified": solver.uncertified,
            "convex_by_active_set": solver.convex_by_active_set, "apart": apart(results, reference),
        }  # fmt: skip
    return figures


def apart(results: Sequence[FrameResult], others: Sequence[FrameResult]) -> float:
    """Largest difference of any array of `ARRAYS`, 0.0 where all bits are equal; infinite where shapes differ."""
    largest = 0.0
    for a, b in zip(results, others, strict=True):
        for name in ARRAYS:
            mine, other = getattr(a, name), getattr(b, name)
            if mine.shape != other.shape:
                return np.inf
            if mine.tobytes() != other.tobytes():
                largest = max(largest, float(np.max(np.abs(mine - other))), 5e-324)
    return largest


def timed(job: Job, seed: int, repeats: int) -> dict[str, Any]:
    """Processor time of a frame with "proxqp" and "active-set", and its ratio, (repeats,) each."""
    times: dict[str, list[float]] = {PROXQP: [], ACTIVE_SET: []}
    for k in range(repeats):
        for solver in (PROXQP, ACTIVE_SET)[:: 1 if k % 2 else -1]:
            times[solver].append(tracked(job, solver, seed, watched=False)[2])
    ratio = np.array(times[PROXQP]) / np.array(times[ACTIVE_SET])
    return {"ms_per_frame": times, "ratio": ratio.tolist()}


def show(figures: dict[str, Any]) -> None:
    out = report.console()
    made = report.table("steps by solver", "clip", "setting", "free", "active set", "of them convex", "ProxQP",
                        "of them with rows", "failed", "answers refused", "track over active-set")  # fmt: skip
    for clip, f in figures["clips"].items():
        for name in STEP_SOLVERS:
            s = f[name]
            made.add_row(
                clip, name, *(str(s[k]) for k in ("free", "active_set", "convex_by_active_set", "proxqp", "with_rows",
                "failed", "uncertified")), "equal bits" if s["apart"] == 0.0 else f"{s['apart']:.1e} apart",
            )  # fmt: skip
    out.print(made)
    if not figures["repeats"]:
        return
    made = report.table(
        "processor time of a frame", "clip", "frames", "active-set [ms]", "proxqp [ms]", "ratio of pairs"
    )
    for clip, f in figures["clips"].items():
        ms, ratio = f["ms_per_frame"], f["ratio"]
        pairs = f"{np.median(ratio):.2f} ({min(ratio):.2f} to {max(ratio):.2f})"
        made.add_row(clip, str(f["frames"]), spread(ms[ACTIVE_SET]), spread(ms[PROXQP]), pairs)
    made.add_row("target", "", "", "", f"{TARGET:.2f}")
    out.print(made)
