"""Forces of trials by their markers against force plates, joint moments against inverse dynamics with the plates, and
what the prior of the split between the feet and the bands are learned from.

Nothing of the plates enters the pipeline: they are the truth, and give the person's weight, by which errors are in
percent. Frames count in which a foot that may stand is on a plate, and the plates carry most of the weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from cyclopts import Parameter
from scipy.optimize import nnls

import kinemode as km
from benchmarks.accuracy.plates import Plates, plates_of
from benchmarks.support.common import Data, Json, data_folder, save, tell
from benchmarks.support.measured_people import measured_files
from estimator.dynamics.contact_forces import GRAVITY, ForceSettings, InverseDynamics
from estimator.dynamics.uncertainty import UncertaintySettings, accelerating
from estimator.runs.contact import contact_of_run
from estimator.runs.events import SIDES
from estimator.runs.forces import Forces
from estimator.runs.inverse_dynamics import forces_of_run, inertias_of, mass_of
from estimator.runs.run_motion import motion_of_run, usual_cutoff
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from kinemode.terminal import report

SQUAT = "opencap/squat"
RUNNER = Path("forces/runner/run200.trc")
"""A trial on an instrumented treadmill."""
_RUNNER_MARKERS = Path(__file__).with_name("runner_markers.toml")
FILM_DELAY = 0.008
"""[s] Of the film's clock behind the trial's."""
_AXES = (2, 0, 1)  # vertical, fore-aft, sideways
_CARRIED, _EDGE, _STANDS = 0.5, 5, 0.3
_FIRM = 60.0  # N
_IMPACT = 1.8  # weights
_MOMENTS = ("hip_flexion", "hip_abduction", "hip_rotation", "knee_flexion", "ankle_dorsiflexion")
LEGEND = (
    "mean absolute errors in % of the weight: vertical / fore-aft / sideways. foot: each, on a plate. pressure: of"
    " its centre, one foot standing. peak: largest vertical force of a foot, ours over the plates'. in 90 %: share of"
    " the plates' samples in the bands. moments: root mean square difference [N m/kg] from inverse dynamics of the same"
    " motion with the plates' forces, flexion of hip, knee, ankle. residual: mean size of the force that the balance of"
    " the root lacks"
)


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial: whose, its name, the run, its forces, the plates, and the weight [N] by the plates."""

    person: str
    name: str
    run: Run
    forces: Forces
    plates: Plates
    weight: float

    @cached_property
    def rows(self) -> np.ndarray:
        """The frames (T,) that count."""
        contact = contact_of_run(self.run)
        assert contact is not None
        stands = np.stack([contact.foot(side) for side in SIDES], axis=1) > _STANDS
        counts = (~stands | self.plates.loaded).all(axis=1) & (self.plates.total[:, 2] > _CARRIED * self.weight)
        counts[:_EDGE] = counts[-_EDGE:] = False
        return np.asarray(counts & np.isfinite(self.forces.total).all(axis=1))

    @property
    def loaded(self) -> np.ndarray:
        """The feet (T, 2) on a plate, of the frames that count or in which the person sits."""
        seated = np.nan_to_num(self.forces.seat[:, 2]) > 0.0
        inside = np.arange(len(seated)) >= _EDGE
        return np.asarray(self.plates.loaded & (self.rows | (seated & inside & inside[::-1]))[:, None])

    def percent(self, ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
        """Differences in percent of the weight, each of its own."""
        return np.asarray(100.0 * (ours / self.forces.weight - theirs / self.weight))


def figures_of(trial: Trial) -> dict[str, Any]:
    """The figures of a trial."""
    rows, loaded, forces, plates = trial.rows, trial.loaded, trial.forces, trial.plates
    total = trial.percent(forces.total, plates.total)
    each = trial.percent(forces.force, plates.force)
    half = {q: forces.in_percent(forces.half_width(q)) for q in ("total", "force")}
    single = rows & (plates.loaded.sum(axis=1) == 1)
    apart = 1e3 * np.linalg.norm((forces.pressure - plates.pressure)[..., :2], axis=2)[single]
    peaks = [
        (forces.force[loaded[:, k], k, 2].max() / forces.weight)
        / (plates.force[loaded[:, k], k, 2].max() / trial.weight)
        for k in range(2)
        if loaded[:, k].any()
    ]
    return {
        "frames": int(rows.sum()), "total": [float(np.abs(total[rows, k]).mean()) for k in _AXES],
        "foot": [float(np.abs(each[..., k][loaded]).mean()) for k in _AXES],
        "pressure_mm": float(np.nanmean(apart)) if np.isfinite(apart).any() else None,
        "peak": [float(p) for p in peaks],
        "total_in_90": [float(np.mean(np.abs(total[rows, k]) <= half["total"][rows, k])) for k in _AXES],
        "foot_in_90": [float(np.mean((np.abs(each[..., k]) <= half["force"][..., k])[loaded])) for k in _AXES],
        "moments": _moments(trial),
        "residual": float(np.linalg.norm(forces.in_percent(forces.residual[rows, :3]), axis=1).mean()),
    }  # fmt: skip


def _moments(trial: Trial) -> dict[str, list[float]]:
    """By joint of the leg: root mean square difference [N m/kg] from the moments with the plates' forces, and the share
    of these in the bands, of feet on plates in frames in which one foot or both are."""
    run, forces, plates, rows = trial.run, trial.forces, trial.plates, trial.rows
    theirs = moments_with_plates(run, forces, plates, trial.weight)
    half = forces.half_width("moment") / forces.mass.kilograms
    figures = {}
    for joint in _MOMENTS:
        off, inside = [], []
        for side in SIDES:
            j = forces.names.index(f"{side}_{joint}")
            own = (forces.moment[:, j] / forces.mass.kilograms - theirs[:, j])[rows]
            off.append(own)
            inside.append(np.abs(own) <= half[rows, j])
        figures[joint] = [float(np.sqrt(np.mean(np.square(np.concatenate(off))))), float(np.concatenate(inside).mean())]
    return figures


def moments_with_plates(run: Run, forces: Forces, plates: Plates, weight: float) -> np.ndarray:
    """Moments (T, J) [N m/kg] of the run's motion with the forces of the plates under its feet."""
    body, motion = run.body, motion_of_run(run)
    dynamics = InverseDynamics(body, inertias_of(body, forces.mass), ForceSettings())
    scale, joints = forces.weight / weight, np.array([body.model.getJointId(f"{s}_ankle_dorsiflexion") for s in SIDES])
    moments = np.full((len(motion.q), body.nv - body.first_joint_dof), np.nan)
    for t in np.flatnonzero(motion.known):
        torque = dynamics.torque_without_contact(motion, int(t))
        on = np.flatnonzero(np.isfinite(plates.pressure[t]).all(axis=1))
        J = body.point_jacobians(body.at(motion.q[t]), joints[on], plates.pressure[t, on])
        torque = torque - scale * np.einsum("pij,pi->j", J, plates.force[t, on])
        moments[t] = torque[body.first_joint_dof :] / forces.mass.kilograms
    return moments


def weights_of(trials: list[tuple[str, str, Run, Forces, Plates]]) -> list[float]:
    """The weight [N] by the plates in each trial: that with which their vertical force agrees best with ours, which has
    its weight in the mean of a stride; plates of a person disagree by 6 % between trials. Of trials with impacts it is
    the median of the person's others where there are any."""
    own = []
    for person, name, run, forces, plates in trials:
        rows = Trial(person, name, run, forces, plates, float(np.quantile(plates.total[:, 2], 0.95))).rows
        ours = forces.total[rows, 2] / forces.weight
        own.append(float(plates.total[rows, 2] @ ours / (ours @ ours)))
    gentle = [plates.total[:, 2].max() < _IMPACT * weight for (*_, plates), weight in zip(trials, own, strict=True)]
    people = [person for person, *_ in trials]
    return [
        weight
        if gentle[k] or not any(g for g, p in zip(gentle, people, strict=True) if p == people[k])
        else float(np.median([own[i] for i in range(len(own)) if gentle[i] and people[i] == people[k]]))
        for k, weight in enumerate(own)
    ]


class Learned(NamedTuple):
    """pivot_along, pivot_across, aim_along, aim_across: of `ForceSettings`; lost, leak: of `UncertaintySettings`, as
    root mean squares."""

    pivot_along: float
    pivot_across: float
    aim_along: float
    aim_across: float
    lost: float
    leak: float


def learned_from(trials: list[Trial]) -> Learned:
    """The constants by trials: pivots and aims of each person with both feet on the ground, lost and leak of each trial
    and direction with the same weight."""
    feet_of, rows, squares = dict[str, list[np.ndarray]](), [], []
    for trial in trials:
        feet, (off, size) = _evidence(trial)
        if feet.size:
            feet_of.setdefault(trial.person, []).append(feet)
        whole = np.square(size).sum(axis=1)
        for k in range(3):
            weight = 1.0 / max(float(np.square(off[:, k]).sum()) * np.sqrt(len(off)), 1e-9)
            rows.append(weight * len(off) * np.stack([np.square(size[:, k]), whole * (k < 2)], axis=1))
            squares.append(weight * len(off) * np.square(off[:, k]))
    people = [np.concatenate(parts, axis=1) for parts in feet_of.values()]
    pivot = np.mean([(lean * away).sum(axis=0) / np.square(away).sum(axis=0) for lean, away in people], axis=0)
    square = [np.square(lean - pivot * away).mean(axis=0) for lean, away in people]
    lost, leak = np.sqrt(nnls(np.vstack(rows), np.concatenate(squares))[0])
    return Learned(*map(float, (*pivot, *np.sqrt(np.mean(square, axis=0)), lost, leak)))


def _evidence(trial: Trial) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Of the plates' feet while both are on the ground (2, N, 2): level force along and across in weights, and the
    level way to the centre of mass over its height, times the share of the weight. Of frames: errors of the sum, and
    sizes of the force that accelerates, (T, 3) in weights."""
    run, plates, rows = trial.run, trial.plates, trial.rows
    motion = motion_of_run(run)
    dynamics = InverseDynamics(run.body, inertias_of(run.body, trial.forces.mass), ForceSettings())
    centre = dynamics.centres(motion)[:, None]
    firm = rows & (plates.force[:, :, 2] > _FIRM).all(axis=1)
    arms, force = trial.forces.in_facing(centre - plates.pressure), trial.forces.in_facing(plates.force) / trial.weight
    away = arms[firm][..., :2] / arms[firm][..., 2:] * force[firm][..., 2:]
    feet = np.stack([force[firm][..., :2], away]).reshape(2, -1, 2)
    off = 0.01 * trial.percent(trial.forces.total, plates.total)[rows]
    size = accelerating(dynamics, motion, UncertaintySettings().burst)[rows]
    return feet, (off, size)


def main(
    *,
    data: Data = None,
    learn: Annotated[bool, Parameter(help="Also print the constants by all people and without each.")] = False,
    film: Annotated[bool, Parameter(help="Also track the film of a squat by its one camera.")] = False,
    trials: Annotated[tuple[str, ...], Parameter(help="Names; all unless given.", consume_multiple=True)] = (),
    json: Json = None,
) -> None:
    """Print errors of forces and moments, trial by trial."""
    folder = data_folder(data)
    known = [] if folder is None else [*measured_files(folder), folder / RUNNER]
    files = [f for f in known if f.is_file() and (not trials or f.stem in trials)]
    if folder is None or not files:
        raise InputError("data", "there is no opencap/subject4", remedy="--data DIR or KINEMODE_DATA names the folder")
    loose = []
    for path in files:
        markers: Path | str = _RUNNER_MARKERS if path.parent.name == RUNNER.parent.name else "auto"
        run = _usual(km.track("human34", points=path, markers=markers))
        forces = forces_of_run(run, mass_of(run.body, None).kilograms)
        loose.append((path.parent.name, path.stem, run, forces, plates_of(_plate_file(path), run)))
        tell(f"{path.parent.name} {path.stem}")
    measured = [Trial(*each, weight) for each, weight in zip(loose, weights_of(loose), strict=True)]
    figures = {f"{trial.person} {trial.name}": figures_of(trial) for trial in measured}
    _show(figures)
    squats = [trial for trial in measured if trial.name == "squats1"]
    if film and squats:
        figures["film"] = _film(folder / SQUAT, squats[0])
    print("weights [kg]: " + ", ".join(f"{t.person} {t.name} {t.weight / GRAVITY:.1f}" for t in measured))
    if learn:
        _print_learned(measured)
    save(json, figures)


def _usual(run: Run) -> Run:
    """The run as `kinemode forces` filters it."""
    cutoff = usual_cutoff(run.time)
    return run.butterworth(cutoff) if cutoff else run


def _plate_file(path: Path) -> Path:
    return path.with_name(f"{path.stem}_grf.mot")


def _film(place: Path, trial: Trial) -> dict[str, float]:
    """Print and return the figures of the film of a trial: upward forces, as the film's heading is another, and
    moments against those of the markers' motion with the plates' forces."""
    run = _usual(km.track("human34", place / "squat.mp4", keypoints=place / "squat.json"))
    forces = forces_of_run(run, mass_of(run.body, None).kilograms)
    at, inside = run.time - FILM_DELAY, slice(_EDGE, -_EDGE)

    def theirs(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(at, trial.run.time, column) for column in values.T], axis=1)

    feet = theirs(trial.plates.force[:, :, 2])
    ours, total = forces.in_percent(forces.force[:, :, 2]), 100.0 * feet / trial.weight
    half = forces.in_percent(forces.half_width("force"))[..., 2]
    moments = theirs(moments_with_plates(trial.run, trial.forces, trial.plates, trial.weight))
    figures = {
        "total": float(np.abs(ours.sum(axis=1) - total.sum(axis=1))[inside].mean()),
        "foot": float(np.abs(ours - total)[inside].mean()),
        "left share": float(
            np.abs(ours[:, 0] / ours.sum(axis=1) - total[:, 0] / total.sum(axis=1))[inside].mean() * 100
        ),
        "foot in 90 %": float((np.abs(ours - total) <= half)[inside].mean() * 100),
        "peak": float(ours.sum(axis=1)[inside].max() / total.sum(axis=1)[inside].max()),
    }
    for joint in ("hip_flexion", "knee_flexion", "ankle_dorsiflexion"):
        both = [forces.names.index(f"{side}_{joint}") for side in SIDES]
        off = forces.moment[:, both] / forces.mass.kilograms - moments[:, both]
        figures[f"{joint} [N m/kg]"] = float(np.sqrt(np.nanmean(np.square(off[inside]))))
    print("film of squats1: " + ", ".join(f"{name} {value:.2f}" for name, value in figures.items()))
    return figures


def _print_learned(trials: list[Trial]) -> None:
    table = report.table("constants", "learned from", *Learned._fields)
    for without in ("", *sorted({trial.person for trial in trials})):
        own = learned_from([trial for trial in trials if trial.person != without])
        table.add_row(f"all but {without}" if without else "all", *(f"{value:.3f}" for value in own))
    report.console().print(table)


def _show(figures: dict[str, dict[str, Any]]) -> None:
    table = report.table(
        "forces against plates", "trial", "total", "foot", "pressure [mm]", "peak", "total in 90 %", "foot in 90 %",
        "moments", "in 90 %", "residual",
    )  # fmt: skip
    for name, f in figures.items():
        shares = [" ".join(f"{100 * x:.0f}" for x in f[key]) for key in ("total_in_90", "foot_in_90")]
        sagittal = [f["moments"][joint] for joint in ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")]
        table.add_row(
            name, *(" / ".join(f"{x:.1f}" for x in f[key]) for key in ("total", "foot")),
            "-" if f["pressure_mm"] is None else f"{f['pressure_mm']:.0f}", " ".join(f"{p:.2f}" for p in f["peak"]),
            *shares, " ".join(f"{rms:.2f}" for rms, _ in sagittal), " ".join(f"{100 * s:.0f}" for _, s in sagittal),
            f"{f['residual']:.2f}",
        )  # fmt: skip
    report.console().print(table)
    print(LEGEND)
