"""Whether the uncertainty can be believed: how often the truth lies in the posterior's regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from rich.table import Table

from benchmarks.support.common import Changes, Data, Json, data_folder, in_processes, nested, save, tell, work_folder
from benchmarks.training.calibration_clips import (
    CONDITIONS,
    HELD_OUT,
    STABILISED_BY,
    TRAINING,
    UNSEEN,
    Task,
    Tracked,
    motions,
    tracked,
)
from benchmarks.training.calibration_plot import write_reliability
from benchmarks.training.credible_levels import (
    KINDS,
    Levels,
    credible_levels_of,
    fitted_calibration,
    together,
)
from benchmarks.training.pose_prior import PriorChoice, prior_settings
from estimator.runs.posterior import TRAJECTORY, PosteriorCalibration
from kinemode.terminal import report
from kinemode.testing.calibration import calibration_error, coverage

PLAIN = PosteriorCalibration(
    covariance_scale=1.0,
    scale_spread=0.0,
    weight_temperature=1.0,
    prior_weight=1.0,
    limit_lean=1e-3,
    size_std=0.0,
    landmark_std=0.0,
)
SEEN, NOT_SEEN = "held out, but they set the stabilisers", "held out, seen by nothing (authored)"
UNSEEN_PEOPLE = "captured motions of unseen people"
TARGET_COVERAGE, TARGET_ERROR = (0.85, 0.95), 0.08


def main(
    *,
    data: Data = None,
    seconds: float = 2.0,
    every: int = 6,
    tracker: str = "css",
    known_body: bool = False,
    known_noise: bool = False,
    independent: bool = False,
    filtered: Annotated[bool, Parameter(negative=())] = False,
    fit: bool = False,
    unseen: bool = True,
    ablate: bool = False,
    seed: int = 0,
    changes: Changes = (),
    prior: PriorChoice = "unseen",
    jobs: int = 1,
    plot: Path | None = None,
    json: Json = None,
) -> None:
    """Track clips of known motion and measure the coverage of the posterior's regions on motions held out.

    Parameters
    ----------
    seconds
        So much of each motion.
    every
        Every n-th frame is used.
    tracker
        As in `kinemode track`.
    known_body
        Give the tracker the person's lengths instead of fitting them.
    known_noise
        Give it the true standard deviations of the keypoints.
    independent
        Keypoints without a bias that lasts, whose noise is independent from point to point and forgets itself within
        two frames, as all were before.
    filtered
        The posterior of each frame from it and those before, instead of the smoothed trajectory's.
    fit
        Fit the calibration on the training motions first; prints what belongs into `PosteriorCalibration`.
    unseen
        Also measure on motions of people that nothing was set by, where the data has mocap_more; on its own.
    ablate
        Also measure with each part of the calibration taken away.
    seed
        Of the clips; held-out clips differ from training clips in any case.
    changes
        Changes to the settings, as cost.nu=8 css.scale=4.
    prior
        Pose prior: learned from all people but the tracked one; the shipped one, which has seen all captured
        clips; or off.
    jobs
        Clips at a time, each in a process of its own.
    plot
        Write the reliability diagram here, a PNG.
    """
    here = data_folder(data)
    if here is None:
        print("only authored motions: --data DIR or KINEMODE_DATA names the folder that has mocap in it")
    known = partial(Task, known_body=known_body, known_noise=known_noise, lasting=not independent)
    known = partial(known, smooth=not filtered)
    make = partial(known, seconds=seconds, every=every, tracker=tracker)
    with work_folder(None) as folder:
        clips = partial(_clips, data, make, prior=prior, changes=nested(changes), folder=folder, jobs=jobs)
        calibration = PosteriorCalibration() if filtered else TRAJECTORY
        if fit:
            calibration = _fitted(clips(TRAINING, 1000 + 100 * seed), jobs)
        held_out = clips(HELD_OUT, 2000 + 100 * seed)
        strange = unseen and here is not None and (here / "mocap_more").is_dir()
        strangers = clips(UNSEEN, 3000 + 100 * seed) if strange else []
    levels = {name: measured(held_out, c, jobs) for name, c in _variants(calibration, ablate).items()}
    show(levels, held_out)
    apart = groups(levels["calibrated"], held_out)
    if strangers:
        apart[UNSEEN_PEOPLE] = together(measured(strangers, calibration, jobs))
    show_groups(apart)
    if plot is not None:
        pooled = {name: together(levels[name]) for name in ("as tracked", "calibrated")}
        write_reliability(plot, pooled, of_conditions(levels["calibrated"], held_out))
    apart_figures = {name: figures(of_group) for name, of_group in apart.items()}
    save(json, _figures_of_all(calibration, levels) | {"by what set the stabilisers": apart_figures})


def _fitted(training: Sequence[Tracked], jobs: int) -> PosteriorCalibration:
    """The calibration fitted to the training motions."""
    calibration = fitted_calibration(training, jobs, tell)
    print(f"fitted: {calibration}")
    return calibration


def _figures_of_all(calibration: PosteriorCalibration, levels: Mapping[str, Sequence[Levels]]) -> dict[str, Any]:
    """The saved figures, besides the conditions."""
    return {
        "measure": "calibration",
        "calibration": asdict(calibration),
        "targets": {"coverage of 90 %": TARGET_COVERAGE, "expected calibration error": TARGET_ERROR},
        "found": {name: figures(together(of_clips)) for name, of_clips in levels.items()},
    }


def _variants(calibration: PosteriorCalibration, ablate: bool) -> dict[str, PosteriorCalibration]:
    """The calibrations that are measured, by name."""
    variants = {"as tracked": PLAIN, "calibrated": calibration}
    if ablate:
        variants |= {f"without {name}": replace(calibration, **{name: vars(PLAIN)[name]}) for name in vars(PLAIN)}
    return variants


def _clips(
    data: Path | None,
    make: partial[Task],
    names: Sequence[str],
    seed: int,
    *,
    prior: PriorChoice,
    changes: Mapping[str, Any],
    folder: Path,
    jobs: int,
) -> list[Tracked]:
    files = motions(data, names)
    settings = prior_settings(prior, [f.stem for f in files], data, changes, folder)
    tasks = [
        make(m, c, seed + i, changes=s)
        for i, (m, s) in enumerate(zip(files, settings, strict=True))
        for c in CONDITIONS
    ]
    tell(f"{len(tasks)} clips to track")
    return in_processes(tracked, tasks, jobs)


def measured(cases: Sequence[Tracked], calibration: PosteriorCalibration, jobs: int) -> list[Levels]:
    """Levels of every clip under a calibration."""
    return in_processes(partial(credible_levels_of, calibration=calibration), cases, jobs)


def of_conditions(levels: Sequence[Levels], cases: Sequence[Tracked]) -> dict[str, Levels]:
    """The clips' levels by condition."""
    names = dict.fromkeys(case.condition.name for case in cases)
    return {n: together(own for own, c in zip(levels, cases, strict=True) if c.condition.name == n) for n in names}


def groups(levels: Sequence[Levels], cases: Sequence[Tracked]) -> dict[str, Levels]:
    """The clips' levels apart: motions that the stabilisers were set by, and others."""
    by_group = {}
    for name, wanted in ((SEEN, True), (NOT_SEEN, False)):
        own = [of for of, c in zip(levels, cases, strict=True) if (c.motion in STABILISED_BY) == wanted]
        if own:
            by_group[name] = together(own)
    return by_group


def show_groups(by_group: Mapping[str, Levels]) -> None:
    """Coverage by the source of the stabilisers' rest positions and deviations."""
    columns = [f"{kind}: {what}" for kind in KINDS for what in ("50 %", "90 %", "error")]
    made = report.table("calibrated: the stabilisers were set by nine captured motions and beam4cam", "", *columns)
    for name, levels in by_group.items():
        _add(made, name, levels)
    report.console().print(made)


def figures(levels: Levels) -> dict[str, dict[str, float]]:
    """Coverage of the 50 and 90 % regions and expected calibration error of every kind of region."""
    by_kind = {}
    for kind in KINDS:
        reached = getattr(levels, kind)
        half, most = coverage(reached, np.array([0.5, 0.9]))
        by_kind[kind] = {"50 %": float(half), "90 %": float(most), "error": calibration_error(reached)}
    return by_kind


def show(levels: Mapping[str, Sequence[Levels]], cases: Sequence[Tracked]) -> None:
    """The tables and verdicts."""
    out = report.console()
    columns = [f"{kind}: {what}" for kind in KINDS for what in ("50 %", "90 %", "error")]
    overall = report.table("held-out motions: coverage, expected calibration error", "", *columns)
    for name, of_clips in levels.items():
        _add(overall, name, together(of_clips))
    overall.add_section()
    for name, of_condition in of_conditions(levels["calibrated"], cases).items():
        _add(overall, name, of_condition)
    out.print(overall)
    calibrated = together(levels["calibrated"])
    joints = report.table("calibrated, by degree of freedom", "", "50 %", "90 %", "error")
    for name, column in zip(cases[0].tracked_body().v_names, calibrated.dof.T, strict=True):
        shares = coverage(column, np.array([0.5, 0.9]))
        joints.add_row(name, *(f"{s:.2f}" for s in shares), f"{calibration_error(column):.3f}")
    out.print(joints)
    low, high = TARGET_COVERAGE
    for kind, got in figures(calibrated).items():
        kept = low <= got["90 %"] <= high and got["error"] <= TARGET_ERROR
        out.print(
            f"{kind}: {100 * got['90 %']:.1f} % in the 90 % regions, target {100 * low:.0f} to {100 * high:.0f};"
            f" error {got['error']:.3f}, target {TARGET_ERROR}: {'kept' if kept else 'missed'}"
        )


def _add(table: Table, name: str, levels: Levels) -> None:
    cells = [(f"{f['50 %']:.2f}", f"{f['90 %']:.2f}", f"{f['error']:.3f}") for f in figures(levels).values()]
    table.add_row(name, *(cell for three in cells for cell in three))
