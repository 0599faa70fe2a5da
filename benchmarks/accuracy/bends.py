"""Who stands straight stands straight: joint angles of people of several builds by one to four virtual phones.

Poses are a laboratory's, from its markers; lengths, the places of keypoints and their errors are drawn independently
for every person and camera (`benchmarks.accuracy.bend_clips`). What is compared is the angle of the same joint of the
same model.
"""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.accuracy.bend_clips import JOINTS, RIGS, WINDOWS, BendRun
from benchmarks.support.common import (
    Changes,
    Data,
    Json,
    Several,
    Work,
    check_known,
    data_folder,
    nested,
    save,
    work_folder,
)
from benchmarks.support.measured_people import measured_run
from benchmarks.support.result_store import Figures, ResultStore, all_done
from kinemode.terminal import report
from kinemode.testing.calibration import coverage

LEGS = JOINTS[:3]
SIDES = ("left", "right")
COLUMNS = (
    "standing: knees", "elbows", "all frames: legs", "hips", "knees", "ankles", "elbows", "90 %: hips", "knees",
    "ankles", "elbows", "knees, standing",
)  # fmt: skip
LEGEND = (
    "mean absolute errors [deg] of both sides, means of windows; in brackets the mean error. standing: frames in which"
    " both knees are bent by less than 12 degrees. 90 %: share of true angles in the run's intervals.",
)


def main(
    *,
    data: Data = None,
    rigs: Annotated[tuple[str, ...], Several] = tuple(RIGS),
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track a laboratory's people of several builds from virtual phones, and print how far their joints are off.

    Parameters
    ----------
    rigs
        One phone before the person, 45 degrees aside, at the side; two 60 degrees apart; three; four around.
    seeds
        Of people, errors and tracker.
    changes
        Changes to the settings: group.name=value.
    jobs
        Windows tracked at a time, each in a process of its own.
    """
    check_known("--rigs", rigs, tuple(RIGS))
    folder = data_folder(data)
    windows = [w for w in WINDOWS if folder is not None and (folder / f"{w[0]}.trc").is_file()]
    if folder is None or not windows:
        print("the data has no trials with markers: nothing is measured")
        return
    changed = json_module.dumps(nested(changes), sort_keys=True)
    with work_folder(work) as place:
        poses = {label: poses_of(folder / f"{label}.trc", place) for label in dict.fromkeys(w[0] for w in windows)}
        runs = [
            BendRun(poses[label], label, start, seconds, rig, seed, changed)
            for rig in rigs for label, start, seconds in windows for seed in seeds
        ]  # fmt: skip
        results = list(zip(runs, all_done("bends", ResultStore(place), runs, jobs), strict=True))
    made = report.table("joint angles by rig", "rig", *COLUMNS)
    figures = dict[str, Any]()
    for rig in rigs:
        own = [result for run, result in results if run.rig == rig]
        figures[rig] = summary(own)
        made.add_row(rig, *cells(figures[rig]))
    report.console().print(made)
    report.print_lines(LEGEND)
    save(json, {"measure": "bends", "settings": nested(changes), **figures})


def poses_of(trial: Path, place: Path) -> Path:
    """The file of a trial's poses on human34, made by its markers unless it is there."""
    path = place / f"{trial.parent.name}_{trial.stem}.npz"
    if not path.is_file():
        run, rows = measured_run(trial, np.inf)
        np.savez(path, q=run.q[rows], time=run.time[rows])
    return path


def summary(results: Sequence[Figures]) -> dict[str, float]:
    """Figures of a rig by name."""
    figures = {}
    for joint in ("knee_flexion", "elbow_flexion"):
        standing = [
            np.array(r["errors"][f"{side}_{joint}"])[np.array(r["stands"])]
            for r in results for side in SIDES if any(r["stands"])
        ]  # fmt: skip
        figures[f"standing {joint}"] = float(np.mean([np.abs(e).mean() for e in standing]))
        figures[f"standing {joint}, mean"] = float(np.mean([e.mean() for e in standing]))
    for joint in JOINTS:
        figures[joint] = float(np.mean([np.abs(r["errors"][f"{s}_{joint}"]).mean() for r in results for s in SIDES]))
        levels = np.concatenate([r["levels"][f"{s}_{joint}"] for r in results for s in SIDES])
        figures[f"90 % {joint}"] = _inside(levels)
    figures["legs"] = float(np.mean([figures[joint] for joint in LEGS]))
    straight = [
        np.array(r["levels"][f"{s}_knee_flexion"])[np.array(r["stands"])[:: r["every"]]] for r in results for s in SIDES
    ]
    figures["90 % standing"] = _inside(np.concatenate(straight))
    return figures


def _inside(below: np.ndarray) -> float:
    """Share of truths in the central 90 % intervals, by the probabilities below them (N,)."""
    return float(coverage(np.abs(2.0 * below - 1.0), 0.9)[0])


def cells(figures: Mapping[str, float]) -> list[str]:
    """One row."""
    standing = [
        f"{figures[f'standing {joint}']:.1f} ({figures[f'standing {joint}, mean']:+.1f})"
        for joint in ("knee_flexion", "elbow_flexion")
    ]
    errors = [f"{figures[name]:.1f}" for name in ("legs", *JOINTS)]
    shares = [f"{figures[name]:.0%}" for name in (*(f"90 % {joint}" for joint in JOINTS), "90 % standing")]
    return [*standing, *errors, *shares]
