"""Captured clips tracked from poor keypoints in one camera, with shares of a pose prior that has not seen them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import kinemode as km
from benchmarks.common import tell
from benchmarks.mocap import DETECTOR, FPS, person
from benchmarks.scores import TrackErrors, trajectories
from benchmarks.tracking import timed_track
from estimator.results.reference_motion import Reference
from estimator.synthesis.mocap import load_mocap


@dataclass(frozen=True)
class Task:
    """One clip.

    prior: file of the mixture learned from the others. weights: its shares to try. seed: of noise and tracker.
    """

    motion: Path
    prior: Path
    weights: tuple[float, ...]
    seconds: float
    seed: int
    folder: Path


def tracked(task: Task) -> dict[str, dict[str, TrackErrors]]:
    """Errors by share of the prior and trajectory; the person has other lengths than human34, which is fitted."""
    clip = km.render(
        task.folder, task.motion, subject=person(), detector=DETECTOR, fps=FPS, seed=task.seed, videos=False,
        seconds=min(task.seconds, load_mocap(task.motion).seconds),
    )  # fmt: skip
    truth, by_weight = Reference.load(clip.truth), {}
    for weight in task.weights:
        changes = {"cost": {"pose_prior_weight": weight, "pose_prior_file": str(task.prior)}}
        run, _ = timed_track(
            clip.keypoints, clip.cameras, task.folder / f"{weight:g}.run", seed=task.seed, settings=changes
        )
        by_weight[f"{weight:g}"] = trajectories(run, truth)
    said = ", ".join(f"{w}: {e['smoothed'].aligned:.1f}" for w, e in by_weight.items())
    tell(f"{task.motion.stem}, seed {task.seed}: hips aligned [mm], by share of the prior, {said}")
    return by_weight
