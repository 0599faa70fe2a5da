"""Flexion of hip, knee and ankle by markers against a laboratory's own inverse kinematics of the same markers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.points.tracked_points import fit_of, middle_of, residuals_of, root_mean_square, run_of
from benchmarks.support.common import tell
from estimator.data.formats.opensim import read_mot
from estimator.runs.coordinate_errors import wrapped_degrees
from estimator.runs.gait_coordinates import GAIT_MODELS, gait_coordinates
from estimator.runs.run_file import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

TRIALS = ("squats1", "STS1", "walking1", "walkingTS1")
OWN = "own"
JOINTS = {"hip": ("hip_flexion", "hip_flexion"), "knee": ("knee_flexion", "knee_angle"),
          "ankle": ("ankle_dorsiflexion", "ankle_angle")}  # fmt: skip
"""Of a leg: our joint, and the gait model's coordinate."""
KINDS = ("gait coordinates", "joints")
LEGEND = (
    "RMS [degrees] to the laboratory's inverse kinematics, the constant offset of each side (in brackets: left, right)"
    " removed, both sides together. gait coordinates: as `kinemode export --format rajagopal-mot` has them; joints: our"
    " own angles. markers: RMS of all markers, smoothed trajectory."
)


class Offset(NamedTuple):
    """Angles (T,) against others: mean difference, and RMS of what is left without it [deg]."""

    mean: float
    rest: float


def offset(ours: np.ndarray, theirs: np.ndarray) -> Offset:
    """Of two series of angles (T,) [deg], frames without either left out; whole turns do not count."""
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
    ours = sagittal(run.body, run.q)
    return {k: {name: offset(angle, turn * known[name]) for name, angle in of.items()} for k, of in ours.items()}


def measure_laboratory(folder: Path, work: Path, fits: Sequence[str], seconds: float, seed: int) -> dict[str, Any]:
    """Some seconds in the middle of every trial, with the person fitted on them and on those of each other trial that
    `fits` names."""
    subject, figures = load_subject("human34"), dict[str, Any]()
    parts = {trial: middle_of(folder / f"{trial}.trc", seconds) for trial in {*TRIALS, *fits} - {OWN}}
    fitted = {t: fit_of(subject, folder / f"{t}.trc", seed=seed, part=parts[t]) for t in fits if t != OWN}
    for trial in TRIALS:
        for name in fits:
            path, person = folder / f"{trial}.trc", subject if name == OWN else fitted[name].subject
            how, out = "auto" if name == OWN else "off", work / f"{trial}_{name}.run"
            run = run_of(person, path, out, fit=how, seed=seed, part=parts[trial])
            by_kind = differences(run, folder / f"{trial}_manual_scaling_ik.mot")
            apart = residuals_of(run).apart
            figures[f"{trial} {name}"] = {
                "trial": trial, "fit": name, "frames": len(run), "markers_mm": 1e3 * root_mean_square(apart),
                **{kind: {c: list(o) for c, o in of.items()} for kind, of in by_kind.items()},
            }  # fmt: skip
            tell(f"{trial}, fitted on {name}: markers {1e3 * root_mean_square(apart):.1f} mm")
    _show(figures)
    return figures


def pooled(offsets: Sequence[Sequence[float]]) -> float:
    """RMS of what is left without the offsets, of several series together [deg]."""
    return float(np.sqrt(np.mean([rest**2 for _, rest in offsets])))


def _show(figures: dict[str, Any]) -> None:
    for kind in KINDS:
        title = f"flexion against the laboratory's inverse kinematics: {kind}"
        made = report.table(title, "trial, fitted on", "frames", *JOINTS, "all", "markers [mm]")
        for of in figures.values():
            made.add_row(f"{of['trial']}, {of['fit']}", str(of["frames"]), *_cells(of[kind]), f"{of['markers_mm']:.1f}")
        report.console().print(made)
    report.print_lines([LEGEND])


def _cells(of: dict[str, list[float]]) -> list[str]:
    cells = []
    for _, coordinate in JOINTS.values():
        sides = [of[f"{coordinate}_{side}"] for side in "lr"]
        cells.append(f"{pooled(sides):.2f} ({', '.join(f'{mean:.1f}' for mean, _ in sides)})")
    return [*cells, f"{pooled(list(of.values())):.2f}"]
