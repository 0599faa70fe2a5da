"""How overconfident modes are that the filter finds in pictures: errors over their own deviations, and how long these
errors last.

Captured motions of people by whom nothing was set, rendered and tracked from pictures alone. Smoothed trajectories are
tied to the modes with their standard deviations times the factor (`smooth.overconfidence`), frames counting by the time
that errors last (`smooth.lasting`): after that time their correlation is 1 / e.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

import kinemode as km
from benchmarks.accuracy.mocap import PICTURES, Task, tracked
from benchmarks.support.common import Data, Json, Several, Work, in_processes, save, work_folder
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES
from benchmarks.support.scores import Outcome
from benchmarks.training.calibration_clips import UNSEEN, motions
from benchmarks.training.pose_prior import prior_settings
from estimator.runs.run_reader import Run
from estimator.tracking.smoothing import SmoothSettings
from estimator.tracking.smoothing.filtered_mode import principal_axes
from kinemode.terminal import report

_NORMAL_MEDIAN = 0.6745  # of the absolute value of a standard normal variable
RANKS = 4  # groups of as many axes each, from the stiffest to the weakest
_FAR = 3.0  # typical errors, beyond which larger ones do not count more in the correlation


@dataclass(frozen=True)
class Deviations:
    """Of one clip: absolute errors of the best modes along their principal axes (N,), the modes' own standard
    deviations there (N,), and the correlation of errors `smooth.lasting` apart."""

    error: np.ndarray
    std: np.ndarray
    correlation: float

    def factor(self, some: np.ndarray | slice = slice(None)) -> float:
        """Error over standard deviation, of a normal distribution with the same median."""
        return float(np.median(self.error[some] / self.std[some]) / _NORMAL_MEDIAN)

    @property
    def by_stiffness(self) -> list[float]:
        """The factors of the axes in groups, the stiffest first."""
        return [self.factor(some) for some in np.array_split(np.argsort(self.std, kind="stable"), RANKS)]


def main(
    *,
    data: Data = None,
    clips: Annotated[tuple[str, ...], Several] = UNSEEN,
    seconds: float = 1.5,
    clip_seed: int = 2,
    seed: int = 0,
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Measure the errors of filtered modes over their own standard deviations, from pictures alone.

    Parameters
    ----------
    clips
        Names of BVH files in mocap_more, without the ending.
    seconds
        So much of each.
    clip_seed
        Seed of the clips: room, clothes and noise.
    seed
        Seed of the tracker.
    jobs
        Clips tracked at a time, each in a process of its own.
    """
    files = motions(data, clips)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    with work_folder(work) as folder:
        settings = prior_settings("unseen", [f.stem for f in files], data, {}, folder / "priors")
        how: dict[str, Any] = {"seed": seed, "modes": 7}
        tasks = [
            Task(f, clip_seed, seconds, False, folder / f.stem, (PICTURES,), how | {"settings": s})
            for f, s in zip(files, settings, strict=True)
        ]
        outcomes = [each[PICTURES] for each in in_processes(tracked, tasks, jobs)]
        by_clip = {f.stem: deviations_of(folder / f.stem) for f in files}
    factor = float(np.exp(np.mean([np.log(of.factor()) for of in by_clip.values()])))
    show(by_clip, outcomes, factor)
    figures = {
        name: {"factor": of.factor(), "by stiffness": of.by_stiffness, "correlation": of.correlation}
        for name, of in by_clip.items()
    }
    save(json, {"measure": "overconfidence", "factor": factor, "clips": figures})


def deviations_of(folder: Path) -> Deviations:
    """Of the run in a task's folder, without its first frame, whose keypoints are given."""
    run = km.open_run(folder / f"{PICTURES.replace(' ', '_')}.run")
    with np.load(folder / "truth.npz") as truth:
        return deviations(run, truth["q"])


def deviations(run: Run, truth: np.ndarray) -> Deviations:
    """Of a run's best modes from true configurations (T, nq) of a body with the same joints."""
    errors, stds, away = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
    for t in range(1, len(run)):
        result = run.result(t)
        std, axes = principal_axes(result.covariance[0])
        away.append(run.body.difference(result.q[0], truth[t]))
        errors.append(np.abs(axes @ away[-1]))
        stds.append(std)
    apart = round(SmoothSettings().lasting / float(np.median(np.diff(run.time))))
    return Deviations(np.concatenate(errors), np.concatenate(stds), correlation(np.array(away), apart))


def correlation(errors: np.ndarray, apart: int) -> float:
    """Of errors (T, nv) so many frames apart, about zero, every degree of freedom counting alike."""
    typical = np.median(np.abs(errors), axis=0)
    scaled = np.clip(errors[:, typical > 0.0] / typical[typical > 0.0], -_FAR, _FAR)
    return float(np.mean(scaled[apart:] * scaled[: len(scaled) - apart]) / np.mean(np.square(scaled)))


def show(by_clip: dict[str, Deviations], outcomes: list[Outcome], factor: float) -> None:
    """By clip, and the geometric mean."""
    groups = [f"axes {k + 1} of {RANKS}" for k in range(RANKS)]
    columns = ("clip", "all", *groups, "correlation", "filtered", "smoothed [mm]")
    made = report.table("errors of modes over their deviations", *columns)
    for (name, of), scored in zip(by_clip.items(), outcomes, strict=True):
        errors = (f"{scored.errors[which].mean:.1f}" for which in ("filtered", "smoothed"))
        ranks = (f"{x:.1f}" for x in of.by_stiffness)
        made.add_row(name, f"{of.factor():.2f}", *ranks, f"{of.correlation:.2f}", *errors)
    means = (np.mean([scored.errors[which].mean for scored in outcomes]) for which in ("filtered", "smoothed"))
    lasting = f"{np.mean([of.correlation for of in by_clip.values()]):.2f}"
    made.add_section()
    made.add_row("mean, of all geometric", f"{factor:.2f}", *[""] * RANKS, lasting, *(f"{m:.1f}" for m in means))
    report.console().print(made)
    print("axes from the stiffest to the weakest; medians as those of a normal distribution; joints in the world")
