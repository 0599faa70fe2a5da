"""A run of markers beside OpenSim's inverse kinematics: the same body, markers, weights and instants."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.points.captured_trials import FPS, SET, MarkerFaults, captured_trial
from benchmarks.points.frame_time import seconds_of_frames
from benchmarks.points.laboratory import LABORATORY
from benchmarks.points.tracked_points import middle_of, root_mean_square, run_of
from benchmarks.support.common import tell
from estimator.data.formats.opensim import R_OPENSIM_WORLD, write_trc
from estimator.runs.coordinate_errors import wrapped_degrees
from estimator.runs.coordinates import opensim_coordinates
from estimator.runs.export import export
from estimator.runs.run_reader import Run
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.explain import run_settings
from kinemode.terminal import report

TRIALS, CAPTURED = ("squats1", "walking1", "walkingTS1"), ("dance_05_10", "bend_scoop_lift_02_06")
ACCURACY = 1e-5  # of OpenSim's solver: what its tool has by default
WAYS = {"OpenSim, clamped": True, "OpenSim, free": False}
OURS, SMOOTHED = "kinemode, as tracked", "kinemode, smoothed"
_TOLERANCE = 1e-3  # degrees, or mm, beyond a limit that count
LEGEND = (
    "The fitted body as `kinemode export --format osim` writes it; OpenSim's InverseKinematicsSolver on the same"
    " markers, weights (1 / std^2 of each marker) and frames, with the accuracy of its tool. clamped: its coordinates"
    " keep to our limits (they are exported as clamped, which its solver respects); free: clamped set to false.\n"
    "markers, weighted: RMS [mm] over all markers alike and by the weights. limits: frames with a joint beyond its"
    " limit; farthest [degrees]. apart: RMS [degrees] of joint angles from ours as tracked; truth: from the true ones,"
    " of captured motion with noise, outliers and gaps. time: processor time a frame, median, without the first; ours"
    " without smoothing."
)


class Side(NamedTuple):
    """The result of either on a trial. coordinates (T, N) [deg, m] by `opensim_coordinates`; places (T, M, 3) [m] of
    the markers; seconds: processor time of each frame."""

    coordinates: np.ndarray
    places: np.ndarray
    seconds: np.ndarray


def python_with_opensim(given: Path | None) -> Path | None:
    """The Python that has OpenSim: the given one, or this; None where this has not."""
    if given is not None:
        if not given.is_file():
            raise InputError("--opensim-python", f"{given} is not a file")
        return given
    return Path(sys.executable) if find_spec("opensim") is not None else None


def measure_opensim(data: Path, work: Path, python: Path | None, seconds: float, seed: int) -> dict[str, Any]:
    """Some seconds in the middle of every trial, and the first of captured motions, the person fitted on them; of the
    data those trials that are there."""
    assert python is not None
    subject, figures = load_subject("human34"), dict[str, Any]()
    for trial in TRIALS if (data / LABORATORY).is_dir() else ():
        path, out = data / LABORATORY / f"{trial}.trc", work / f"{trial}_osim.run"
        run = run_of(subject, path, out, fit="auto", seed=seed, part=middle_of(path, seconds))
        figures[trial] = compared(run, work, python)
        tell(f"{trial}: {figures[trial][OURS]['markers_mm']:.1f} mm")
    for clip in CAPTURED if (data / "mocap").is_dir() else ():
        known = captured_trial(data / "mocap" / f"{clip}.bvh", seed, MarkerFaults(), seconds, FPS)
        path, out = known.write(work / f"{clip}_osim.trc"), work / f"{clip}_osim.run"
        run = run_of(subject, path, out, fit="auto", seed=seed, markers=SET)
        figures[clip] = compared(run, work, python, known.q)
        tell(f"{clip}: {figures[clip][OURS]['truth']:.1f} degrees")
    _show(figures)
    return figures


def compared(run: Run, work: Path, python: Path, truth: np.ndarray | None = None) -> dict[str, dict[str, float]]:
    """Figures of each side of a run; truth (T, nq): true poses, where they are known."""
    measured, weights = run.markers, 1.0 / np.square(run_settings(run).cost.markers.stds(run.body))
    assert measured is not None
    measured, weights = measured[run.index], weights / weights.max()
    low, high = limits(run)
    sides = {OURS: _ours(run, run.filtered_q), SMOOTHED: _ours(run, run.q)}
    sides[OURS] = sides[OURS]._replace(seconds=seconds_of_frames(run))
    for way, clamped in WAYS.items():
        sides[way] = solved_by_opensim(run, weights, work, python, clamped)
    first = sides[OURS].coordinates
    true = np.full_like(first, np.nan) if truth is None else opensim_coordinates(run.body, truth[run.index])[1]
    result = {}
    for name, side in sides.items():
        apart = np.linalg.norm(side.places - measured, axis=2)
        beyond = np.maximum(np.maximum(low - side.coordinates, side.coordinates - high), 0.0)
        result[name] = {
            "markers_mm": 1e3 * root_mean_square(apart),
            "weighted_mm": 1e3 * weighted_rms(apart, weights),
            "frames_beyond": int((beyond > _TOLERANCE).any(axis=1).sum()), "beyond": float(beyond.max()),
            "apart": _angles(side.coordinates - first), "truth": _angles(side.coordinates - true),
            "frames": len(run),
            "ms": 1e3 * float(np.median(side.seconds[1:])) if len(side.seconds) > 1 else float("nan"),
        }  # fmt: skip
    return result


def _angles(differences: np.ndarray) -> float:
    """RMS of the joints' (T, N) [deg]; NaN where none is known."""
    joints = wrapped_degrees(differences)[:, 6:]
    return root_mean_square(joints) if np.isfinite(joints).any() else float("nan")


def weighted_rms(apart: np.ndarray, weights: np.ndarray) -> float:
    """The weighted RMS of distances (T, M), NaN where missing, by the weights (M,) of the markers."""
    known = np.isfinite(apart)
    return float(np.sqrt((np.nan_to_num(apart) ** 2 @ weights).sum() / (known @ weights).sum()))


def limits(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values (N,) of the coordinates of a free body, infinite where they have no limits."""
    body = run.body
    ends: list[np.ndarray] = []
    for bound in (body.lower, body.upper):
        pose = body.neutral.copy()
        pose[7:] = np.where(np.isfinite(bound[7:]), bound[7:], 0.0)
        values = opensim_coordinates(body, pose[None])[1][0]
        values[6:] = np.where(np.isfinite(bound[7:]), values[6:], bound[7:])
        values[:6] = -np.inf if not ends else np.inf
        ends.append(values)
    return ends[0], ends[1]


def _ours(run: Run, q: np.ndarray) -> Side:
    return Side(opensim_coordinates(run.body, q)[1], run.body.markers_of(run.body.placed(q)), np.zeros(0))


def solved_by_opensim(run: Run, weights: np.ndarray, work: Path, python: Path, clamped: bool) -> Side:
    """By another process. Raises InputError where it fails."""
    stem, measured = f"{run.file.stem}_{'clamped' if clamped else 'free'}", run.markers
    assert measured is not None
    model, points, job, result = (work / f"{stem}{kind}" for kind in (".osim", ".trc", ".json", "_result.json"))
    export(run, model)
    write_trc(points, run.body.marker_names, measured[run.index], run.time)
    by_name = dict(zip(run.body.marker_names, weights.tolist(), strict=True))
    asked = {"model": str(model), "points": str(points), "weights": by_name, "clamped": clamped, "accuracy": ACCURACY}
    job.write_text(json.dumps(asked), encoding="utf-8")
    program = str(Path(__file__).with_name("opensim_ik.py"))
    ended = subprocess.run([str(python), program, str(job), str(result)], capture_output=True, text=True, check=False)
    if ended.returncode:
        last = (ended.stderr.strip().splitlines() or ["no output"])[-1]
        raise InputError("--opensim-python", f"OpenSim failed: {last}", remedy="give a Python that has opensim 4")
    said = json.loads(result.read_text(encoding="utf-8"))
    names = opensim_coordinates(run.body, run.q[:1])[0]
    values = np.array(said["values"])[:, [said["names"].index(name) for name in names]]
    return Side(values, np.array(said["places"]) @ R_OPENSIM_WORLD, np.array(said["seconds"]))


def _show(figures: dict[str, Any]) -> None:
    columns = ("trial, by", "markers", "weighted", "limits", "farthest", "apart", "truth", "time [ms]")
    made = report.table("the same markers by OpenSim's inverse kinematics", *columns)
    for trial, sides in figures.items():
        for name, side in sides.items():
            frames = f"{side['frames_beyond']} of {side['frames']}"
            errors = (f"{side[key]:.2f}" for key in ("markers_mm", "weighted_mm"))
            rest = (f"{side[key]:.2f}" for key in ("beyond", "apart", "truth", "ms"))
            made.add_row(f"{trial}, {name}", *errors, frames, *rest)
        made.add_section()
    report.console().print(made)
    report.print_lines([LEGEND])
