"""Joint angles of phone films against markers, in degrees, and two learned peers on the same frames.

The films, the truth (OpenSim's inverse kinematics of markers) and the peers' answers are OpenCap's (Uhlrich et al.,
PLOS Computational Biology 2023). Angles are the coordinates of its gait model, the pelvis' after the one turn that fits
the clip; own: with each angle's mean error of the clip taken away, as models define their zeros differently. Then how
often the truth lies in the run's 90 % intervals (`benchmarks.accuracy.degree_bands`).
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from cyclopts import Parameter
from scipy.spatial.transform import Rotation

import kinemode as km
from benchmarks.accuracy.degree_bands import COORDINATES, calibration, central_levels
from benchmarks.support.common import Data, Json, Several, data_folder, save
from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.numerics.alignment import rotation_onto, similarity_onto
from estimator.runs.coordinate_errors import GROUPS as LEG_GROUPS, wrapped_degrees
from estimator.runs.coordinates import turns_zxy
from estimator.runs.gait_coordinates import GAIT_MODELS, gait_coordinates
from estimator.runs.run_reader import Run
from kinemode.terminal import report

FILMS = ("walk", "squat")
PEERS = ("peer_mono", "peer_wham")
_PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
_LUMBAR = ("lumbar_extension", "lumbar_bending", "lumbar_rotation")
_OF_MODEL = {joint.replace("abduction", "adduction"): c for joint, c in COORDINATES.items() if c not in _LUMBAR}
GROUPS = {group: tuple(name for name in names if name in _OF_MODEL) for group, names in LEG_GROUPS.items()} | {
    "pelvis tilt": ("pelvis_tilt",), "lumbar": ("lumbar_extension",),
}  # fmt: skip
_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
_LIMBS = tuple(f"{side}_{joint}" for joint in _JOINTS for side in ("left", "right"))


class Motion(NamedTuple):
    """time (T,) [s]; angles (T,) [deg] by name; pelvis (T, 3, 3) in OpenSim's axes; points (T, 12, 3) [m]."""

    time: np.ndarray
    angles: Mapping[str, np.ndarray]
    pelvis: np.ndarray
    points: np.ndarray


def columns_of(path: Path) -> dict[str, np.ndarray]:
    """The columns (T,) of a table of a film by their names, NaN where a cell is empty."""
    with gzip.open(path, "rt", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def film_run(
    place: Path, seed: int, *, end: float | None = None, focal: str | None = None, settings: Path | None = None
) -> Run:
    """A film tracked by its own folder's video and keypoints, without a camera file; see `main`."""
    return km.track(
        "human34", place / f"{place.name}.mp4", keypoints=place / f"{place.name}.json", cues="off", seed=seed, end=end,
        focal=focal, settings=settings,
    )  # fmt: skip


def tabled(path: Path) -> Motion:
    """A table of the truth or of a peer."""
    column = columns_of(path)
    points = np.stack([np.stack([column[f"{name}_{axis}"] for axis in "xyz"], axis=1) for name in _LIMBS], axis=1)
    angles = {name: column[name] for name in (*_LUMBAR, *_OF_MODEL)}
    return Motion(column["time"], angles, rotations([column[name] for name in _PELVIS]), points)


def tracked(run: Run) -> Motion:
    """A run, as the gait model's coordinates."""
    names, values = gait_coordinates(run.body, run.q, GAIT_MODELS["rajagopal"])
    column = dict(zip(names, values.T, strict=True))
    angles = {ours: column[theirs] for ours, theirs in _OF_MODEL.items()} | {name: column[name] for name in _LUMBAR}
    points = run.landmarks[:, [run.body.landmark_names.index(name) for name in _LIMBS]]
    return Motion(run.time, angles, rotations([column[name] for name in _PELVIS]), points)


def rotations(zxy: Sequence[np.ndarray]) -> np.ndarray:
    """(T, 3, 3) from turns [deg] about z, then x, then y, each about the turned axes."""
    return np.asarray(Rotation.from_euler("ZXY", np.transpose(zxy), degrees=True).as_matrix())


def at(motion: Motion, time: np.ndarray) -> Motion:
    """The same at other times, straight between the samples."""

    def along(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        return np.stack([np.interp(time, motion.time, c) for c in flat.T], axis=1).reshape(len(time), *values.shape[1:])

    angles = {n: np.degrees(along(np.unwrap(np.radians(a)))) for n, a in motion.angles.items()}
    return Motion(time, angles, along(motion.pelvis), along(motion.points))


def errors(method: Motion, truth: Motion, time: np.ndarray) -> dict[str, tuple[float, float]]:
    """Mean absolute error by group, unchanged and with each angle's own zero; PA [mm] twice."""
    ours, theirs = at(method, time), at(truth, time)
    a, b = (motion.points - motion.points[:, :2].mean(axis=1, keepdims=True) for motion in (ours, theirs))
    turn = R_OPENSIM_WORLD @ rotation_onto(a.reshape(-1, 3), b.reshape(-1, 3)) @ R_OPENSIM_WORLD.T
    tilts = [np.degrees(turns_zxy(R)[:, 0]) for R in (turn @ ours.pelvis, theirs.pelvis)]
    off = {name: ours.angles[name] - theirs.angles[name] for name in theirs.angles} | {
        "pelvis_tilt": tilts[0] - tilts[1]
    }
    mean: dict[str, tuple[float, float]] = {}
    for group, names in GROUPS.items():
        of_group = [wrapped_degrees(off[name]) for name in names]
        own = [np.abs(o - o.mean()).mean() for o in of_group]
        mean[group] = float(np.mean([np.abs(o).mean() for o in of_group])), float(np.mean(own))
    fits = [similarity_onto(x, y, scaled=True) for x, y in zip(ours.points, theirs.points, strict=True)]
    pa = [np.linalg.norm(f.of(x) - y, axis=1).mean() for f, x, y in zip(fits, ours.points, theirs.points, strict=True)]
    return mean | {"PA [mm]": (1e3 * float(np.mean(pa)),) * 2}


def bands(run: Run, truth: Motion) -> dict[str, float]:
    """How often the run's intervals contain the truth, in every third frame, as neighbours are similar."""
    frames = np.flatnonzero((run.time >= truth.time[0]) & (run.time <= truth.time[-1]))[::3]
    known = at(truth, run.time[frames]).angles
    theirs = {_OF_MODEL.get(name, name): values for name, values in known.items()}
    return calibration(central_levels(run, frames, theirs))


def main(
    *,
    films: Annotated[tuple[str, ...], Several] = FILMS,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    end: float | None = None,
    focal: str | None = None,
    settings: Annotated[Path | None, Parameter(name="--settings")] = None,
    data: Data = None,
    json: Json = None,
) -> None:
    """Print errors of joint angles on phone films without a camera file, beside two peers'.

    Parameters
    ----------
    films
        Which of them.
    seeds
        Of the tracker; errors are their means.
    end
        Only so much of each film [s].
    focal
        The lens, in the form of `kinemode track --focal`; guessed unless given.
    settings
        A TOML file of settings for the tracker.
    """
    folder = data_folder(data)
    if folder is None or not (folder / "opencap").is_dir():
        print("the data has no folder opencap: nothing is measured")
        return
    made = report.table("mean absolute error [deg], unchanged / own zero", "film", "method", *GROUPS, "PA [mm]")
    held = report.table("truths in 90 % intervals", "film", "all joints", "fewest", "most", "calibration error")
    figures: dict[str, Any] = {}
    for film in films:
        place = folder / "opencap" / film
        truth = tabled(place / "truth.csv.gz")
        runs = [film_run(place, seed, end=end, focal=focal, settings=settings) for seed in seeds]
        methods = {"kinemode": [tracked(run) for run in runs]} | {p: [tabled(place / f"{p}.csv.gz")] for p in PEERS}
        time = runs[0].time
        time = time[(time >= truth.time[0]) & (time <= truth.time[-1])]
        figures[film] = {}
        for name, motions in methods.items():
            all_ = [errors(motion, truth, time) for motion in motions]
            mean = {group: np.mean([e[group] for e in all_], axis=0) for group in all_[0]}
            cells = [f"{mean[g][0]:.1f} / {mean[g][1]:.1f}" for g in GROUPS]
            made.add_row(film, name, *cells, f"{mean['PA [mm]'][0]:.1f}")
            figures[film][name] = {group: value.tolist() for group, value in mean.items()}
        in_bands = [bands(run, truth) for run in runs]
        mean_bands = {name: float(np.mean([b[name] for b in in_bands])) for name in in_bands[0]}
        held.add_row(
            film, *(f"{100 * mean_bands[k]:.0f} %" for k in ("90 %", "fewest", "most")), f"{mean_bands['error']:.3f}"
        )
        figures[film]["intervals"] = mean_bands
    report.console().print(made)
    report.console().print(held)
    save(json, figures)
