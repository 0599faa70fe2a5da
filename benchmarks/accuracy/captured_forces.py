"""Forces of captured people from rendered keypoints, against those of their true motion.

    python -m benchmarks captured_forces

The true motion has no plates; Newton's law gives the sum of its forces, after a filter, as captured motion has noise,
too.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.support.common import Changes, Data, Json, Work, in_processes, nested, save, tell, work_folder
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, render_captured, spread_of
from benchmarks.support.tracking import timed_track
from benchmarks.training.calibration_clips import LASTING
from estimator.dynamics.contact_forces import ForceSettings, InverseDynamics
from estimator.dynamics.motion import motion_of
from estimator.runs.filtering import filtered
from estimator.runs.inverse_dynamics import forces_of_run, inertias_of, mass_of
from estimator.runs.run_motion import usual_cutoff
from estimator.synthesis.settings import DetectorSettings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.shot import RenderedClip
from kinemode.terminal import report

FPS = 60.0
MASS = 70.0  # kg
DETECTOR = DetectorSettings(**LASTING)
_TRUE_CUTOFF = 6.0  # Hz: above it captured motion has noise
_EDGE = 5  # frames at either end
LEGEND = (
    "sum of the forces on the feet, % of the weight: mean absolute error, that of nothing but the weight"
    " (none), and share of the true forces in the 90 % bands; along and across the way the pelvis faces"
)


@dataclass(frozen=True)
class Task:
    """A captured motion, of which so many seconds are rendered before so many cameras with a seed of the detector's
    errors. settings: changes to those of the tracker."""

    motion: Path
    seconds: float
    cameras: int
    seed: int
    folder: Path
    settings: dict[str, Any]


@dataclass(frozen=True)
class Agreement:
    """By vertical, along, across: mean absolute error and size of what is not weight [% of the weight], and share of
    the true forces in the bands."""

    error: list[float]
    size: list[float]
    held: list[float]


def main(
    *,
    data: Data = None,
    each: int = 2,
    seconds: float = 4.0,
    cameras: int = 1,
    seed: int = 0,
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track captured people from keypoints, and compare the sum of their forces with the true one.

    Parameters
    ----------
    each
        Clips of each person.
    seconds
        Only so much of each.
    cameras
        Before how many.
    seed
        Of the detector's errors.
    changes
        Changes to the settings, as smooth.memory=0.2.
    jobs
        Clips at a time, each in a process of its own.
    """
    files = spread_of(captured_files(data), each)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    with work_folder(work) as folder:
        tasks = [Task(file, seconds, cameras, seed, folder / file.stem, nested(changes)) for file in files]
        outcomes = in_processes(agreement_or_reason, tasks, jobs)
    by_clip = {file.stem: a for file, a in zip(files, outcomes, strict=True) if isinstance(a, Agreement)}
    show(by_clip)
    refused = {file.stem: a for file, a in zip(files, outcomes, strict=True) if isinstance(a, str)}
    for name, why in refused.items():
        print(f"{name}: {why}")
    figures: dict[str, Any] = {name: vars(a) for name, a in by_clip.items()}
    save(json, {"measure": "captured_forces", "cameras": cameras, "seed": seed, "clips": figures, "refused": refused})


def agreement_or_reason(task: Task) -> Agreement | str:
    """How well forces agree, or why there are none, as of who never stands."""
    clip = render_captured(
        task.motion, task.seconds, task.seed, task.folder, detector=DETECTOR, fps=FPS, cameras=task.cameras
    )
    try:
        agreement = measured(clip, task.folder / "clip.run", task.settings)
    except InputError as error:
        return str(error)
    tell(f"{task.motion.stem}: " + " / ".join(f"{e:.1f}" for e in agreement.error))
    return agreement


def measured(clip: RenderedClip, out: Path, settings: dict[str, Any]) -> Agreement:
    """How well the forces of a tracked clip agree; raises InputError where it has none."""
    run, _ = timed_track(clip.keypoints, clip.cameras, out, settings=settings)
    cutoff = usual_cutoff(run.time)
    forces = forces_of_run(run.butterworth(cutoff) if cutoff else run, MASS)
    body = Body(load_subject(clip.subject))
    with np.load(clip.truth) as truth:
        q, time = truth["q"], truth["time"]
    motion = motion_of(body, time, filtered(body, q, time, _TRUE_CUTOFF).q)
    dynamics = InverseDynamics(body, inertias_of(body, mass_of(body, MASS)), ForceSettings())
    true = (dynamics.force_of_acceleration(motion) + np.array([0.0, 0.0, dynamics.weight]))[run.index, None]
    known = np.isfinite(forces.force).all(axis=(1, 2)) & np.isfinite(true).all(axis=(1, 2))
    rows = np.flatnonzero(known)[_EDGE:-_EDGE]
    theirs, ours = forces.in_facing(true)[rows, 0], forces.total_in_facing[rows]
    half = forces.half_width("total_in_facing")[rows]
    return Agreement(*(
        [float(np.mean(part[:, k])) for k in (2, 0, 1)]
        for part in (
            forces.in_percent(np.abs(ours - theirs)),
            forces.in_percent(np.abs(theirs - [0.0, 0.0, forces.weight])),
            np.abs(ours - theirs) <= half,
        )
    ))  # fmt: skip


def show(by_clip: dict[str, Agreement]) -> None:
    """Print the agreement of each clip, and the means."""
    table = report.table("captured people", "clip", "error", "none", "in 90 %")
    rows = np.array([[a.error, a.size, a.held] for a in by_clip.values()])
    for name, (error, size, held) in zip([*by_clip, "mean"], [*rows, rows.mean(axis=0)], strict=True):
        shares = " ".join(f"{100 * x:.0f}" for x in held)
        table.add_row(name, *(" / ".join(f"{x:.1f}" for x in part) for part in (error, size)), shares)
    report.console().print(table)
    print(LEGEND)
