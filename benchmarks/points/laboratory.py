"""Flexion of hip, knee and ankle by markers against a laboratory's own inverse kinematics of the same markers: how far
motion is from its, and whether its angles as they are lie in the bands of ours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.points.tracked_points import fit_of, middle_of, residuals_of, root_mean_square, run_of
from benchmarks.support.common import tell
from benchmarks.support.measured_people import measured_files
from estimator.data.formats.opensim import read_mot
from estimator.runs.coordinate_errors import wrapped_degrees
from estimator.runs.gait_coordinates import GAIT_MODELS, gait_coordinates
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

LABORATORY = "opencap/subject4"
TRIALS = ("squats1", "STS1", "walking1", "walkingTS1")
"""Trials of `LABORATORY` for the person's fit."""
OWN = "own"
_BAND = 0.9
JOINTS = {"hip": ("hip_flexion", "hip_flexion"), "knee": ("knee_flexion", "knee_angle"),
          "ankle": ("ankle_dorsiflexion", "ankle_angle")}  # fmt: skip
"""Joints of a leg: ours, and the gait model's coordinate."""
KINDS = ("gait coordinates", "joints")
LEGEND = (
    "RMS [degrees] to the laboratory's inverse kinematics, the constant offset of each side (in brackets: left, right)"
    " removed, both sides together. gait coordinates: as `kinemode export --format rajagopal-mot` has them; joints: our"
    " own angles. markers: RMS of all markers, smoothed trajectory. in 90 %: share of the laboratory's angles, offsets"
    " included, that lie in the intervals of our joints (Run.interval)."
)


class Offset(NamedTuple):
    """Angles (T,) against others: mean difference, and RMS of what is left without it [deg]; share of the others that
    lie in the bands of these, NaN where there are none."""

    mean: float
    rest: float
    inside: float = math.nan


def offset(ours: np.ndarray, theirs: np.ndarray) -> Offset:
    """The offset of two series of angles (T,) [deg], frames without either left out; whole turns do not count."""
    apart = wrapped_degrees(ours - theirs)
    apart = apart[np.isfinite(apart)]
    return Offset(float(apart.mean()), float(apart.std()))


def sagittal(body: Body, q: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """By kind and by the gait model's coordinate, angles (T,) [deg] of the legs at q (T, nq)."""
    names, values = gait_coordinates(body, q, GAIT_MODELS["rajagopal"])
    by_kind: dict[str, dict[str, np.ndarray]] = {kind: {} for kind in KINDS}
    for (joint, coordinate), side in ((pair, side) for pair in JOINTS.values() for side in ("left", "right")):
        name = f"{coordinate}_{side[0]}"
        by_kind["gait coordinates"][name] = values[:, names.index(name)]
        place = body.model.idx_qs[body.model.getJointId(f"{side}_{joint}")]
        by_kind["joints"][name] = np.degrees(q[:, place])
    return by_kind


def differences(run: Run, truth: Path) -> dict[str, dict[str, Offset]]:
    """By kind and coordinate, of a run against a motion file at the run's times."""
    theirs, time = read_mot(truth)
    known = {name: np.interp(run.time, time, theirs.values[:, k]) for k, name in enumerate(theirs.names)}
    turn = 1.0 if theirs.in_degrees else np.degrees(1.0)
    ours, ends = sagittal(run.body, run.q), run.interval(_BAND)
    low, high = (sagittal(run.body, ends[:, side])["joints"] for side in (0, 1))
    by_kind = {k: {name: offset(angle, turn * known[name]) for name, angle in of.items()} for k, of in ours.items()}
    for name, of in by_kind["joints"].items():
        inside = (turn * known[name] >= low[name]) & (turn * known[name] <= high[name])
        by_kind["joints"][name] = of._replace(inside=float(inside.mean()))
    return by_kind


def measure_laboratory(folder: Path, work: Path, fits: Sequence[str], seconds: float, seed: int) -> dict[str, Any]:
    """Some seconds in the middle of every trial of people with markers, the person fitted on them, and on those of each
    other trial of one person that `fits` names. folder: of the data."""
    subject, figures, own = load_subject("human34"), dict[str, Any](), folder / LABORATORY
    fitted = {
        t: fit_of(subject, own / f"{t}.trc", seed=seed, part=middle_of(own / f"{t}.trc", seconds))
        for t in fits
        if t != OWN
    }
    for path in measured_files(folder):
        if (truth := _truth(path)) is None:
            continue
        trial, part = f"{path.parent.name} {path.stem}", middle_of(path, seconds)
        for name in fits if path.parent == own else (OWN,):
            person = subject if name == OWN else fitted[name].subject
            out = work / f"{trial}_{name}.run"
            run = run_of(person, path, out, fit="auto" if name == OWN else "off", seed=seed, part=part)
            by_kind, apart = differences(run, truth), residuals_of(run).apart
            figures[f"{trial} {name}"] = {
                "trial": trial, "fit": name, "frames": len(run), "markers_mm": 1e3 * root_mean_square(apart),
                **{kind: {c: list(o) for c, o in of.items()} for kind, of in by_kind.items()},
            }  # fmt: skip
            tell(f"{trial}, fitted on {name}: markers {1e3 * root_mean_square(apart):.1f} mm")
    _show(figures)
    return figures


def _truth(path: Path) -> Path | None:
    """The laboratory's angles of a trial that moves."""
    names = (f"{path.stem}_manual_scaling_ik.mot", f"{path.stem}_ik.mot")
    there = (path.with_name(name) for name in names if not path.stem.startswith("static"))
    return next((file for file in there if file.is_file()), None)


def pooled(offsets: Sequence[Sequence[float]]) -> float:
    """RMS of what is left without the offsets, of several series together [deg]."""
    return float(np.sqrt(np.mean([of[1] ** 2 for of in offsets])))


def _show(figures: dict[str, Any]) -> None:
    for kind in KINDS:
        title = f"flexion against the laboratory's inverse kinematics: {kind}"
        made = report.table(title, "trial, fitted on", "frames", *JOINTS, "all", "markers [mm]")
        for of in figures.values():
            made.add_row(f"{of['trial']}, {of['fit']}", str(of["frames"]), *_cells(of[kind]), f"{of['markers_mm']:.1f}")
        report.console().print(made)
    made = report.table("the laboratory's angles as they are: offset, RMS over trials [degrees]; in 90 %", "", *JOINTS)
    every = [of["joints"] for of in figures.values() if of["fit"] == OWN]
    made.add_row(f"{len(every)} trials", *(_banded(coordinate, every) for _, coordinate in JOINTS.values()))
    report.console().print(made)
    report.print_lines([LEGEND])


def _banded(coordinate: str, trials: Sequence[dict[str, list[float]]]) -> str:
    """For both sides of all trials, the offsets and the share inside bands."""
    offsets = np.array([of[f"{coordinate}_{side}"] for of in trials for side in "lr"])
    return f"{root_mean_square(offsets[:, 0]):.1f}; {np.mean(offsets[:, 2]):.0%}"


def _cells(of: dict[str, list[float]]) -> list[str]:
    cells = []
    for _, coordinate in JOINTS.values():
        sides = [of[f"{coordinate}_{side}"] for side in "lr"]
        cells.append(f"{pooled(sides):.2f} ({', '.join(f'{mean:.1f}' for mean, *_ in sides)})")
    return [*cells, f"{pooled(list(of.values())):.2f}"]
