"""Four cameras' keypoints triangulated and tracked as points, beside the same keypoints tracked in the pictures."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.points.tracked_points import residuals_of, root_mean_square, run_of
from benchmarks.support.common import tell
from benchmarks.support.tracking import timed_track
from estimator.data.formats.opensim import write_trc
from estimator.data.observation import Observation
from estimator.runs.evaluation import Reference, evaluate
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.marker_set import LANDMARKS
from humanoid.subject.subject import load_subject
from kinemode.inputs.load import load_inputs
from kinemode.request import FileOptions
from kinemode.terminal import report

CAMERAS = ("cam01", "cam02", "cam03", "cam04")
PICTURES = "keypoints in pictures"
WAYS = {"points, all cameras": np.inf, "points, cameras left out": 20.0}
"""Mean distance [px] from a landmark's keypoints, beyond which cameras are left out."""
MOST = 1.15  # error of the points by that of the pictures
_FEWEST = 2  # views of a point
_SPREAD = 1e-6  # least share of the rays' directions in what makes a point certain
LEGEND = (
    "[mm] over the 12 limb joints, smoothed trajectory; MPJPE: hips aligned; PA: after the best similarity. Points: the"
    " place nearest to the rays of a landmark, weighted by the detector's confidence; of all cameras, or of as many as"
    " agree within 20 px, as other programs triangulate. This clip's detector exchanges left and right in some views."
)


def measure_cameras(folder: Path, work: Path, seed: int) -> dict[str, Any]:
    """The figures of the clip beam4cam; the person is fitted in every way."""
    files = {name: folder / "keypoints" / f"{name}.json" for name in CAMERAS}
    reference = Reference.load(folder / "reference3d.npz")
    body = Body(load_subject("human34"))
    observations = load_inputs(
        body, FileOptions(None, keypoints=files, cameras=folder / "calibration.json")
    ).observations
    by_pictures, _ = timed_track(files, folder / "calibration.json", work / "pictures.run", seed=seed)
    figures: dict[str, Any] = {"frames": len(observations), PICTURES: _errors(by_pictures, reference)}
    for way, most in WAYS.items():
        points = np.array([triangulated(observation, most) for observation in observations])
        run = _tracked(body, points, np.array([o.time for o in observations]), work, seed)
        apart = 1e3 * root_mean_square(residuals_of(run).apart)
        figures[way] = {**_errors(run, reference), "markers_mm": apart, "missing": _missing(points)}
        tell(f"{way}: {apart:.1f} mm from the points")
    _show(figures)
    return figures


def _tracked(body: Body, points: np.ndarray, time: np.ndarray, work: Path, seed: int) -> Run:
    """From points (T, L, 3) of the landmarks, through a file."""
    seen = np.isfinite(points).any(axis=(0, 2))
    names = [name for name, some in zip(body.landmark_names, seen, strict=True) if some]
    write_trc(work / "points.trc", names, points[:, seen], time)
    return run_of(body.subject, work / "points.trc", work / "points.run", fit="auto", seed=seed, markers=LANDMARKS)


def _missing(points: np.ndarray) -> float:
    """Share of the landmarks that are ever there."""
    known = np.isfinite(points).all(axis=2)
    return float(1.0 - known[:, known.any(axis=0)].mean())


def triangulated(observation: Observation, most: float) -> np.ndarray:
    """Places (L, 3) [m] of the landmarks; NaN where none is near to the rays of two cameras. most [px]: mean distance
    from the keypoints, beyond which cameras are left out, as few as can be."""
    seen = (observation.confidence > 0.0) & np.isfinite(observation.pixels).all(axis=2)
    places = np.full((seen.shape[1], 3), np.nan)
    for k, views in enumerate(seen.T):
        cameras = np.flatnonzero(views).tolist()
        for count in range(len(cameras), _FEWEST - 1, -1):
            tried = [_nearest(observation, k, some) for some in combinations(cameras, count)]
            off, place = min(tried, key=lambda pair: pair[0])
            if off <= most:
                places[k] = place
                break
    return places


def _nearest(observation: Observation, k: int, some: Sequence[int]) -> tuple[float, np.ndarray]:
    """The place (3,) nearest to a landmark's rays in some cameras, weighted by the squares of its confidence, and its
    mean distance from their keypoints [px]; infinite where the rays are parallel."""
    precision, pull = np.zeros((3, 3)), np.zeros(3)
    for c in some:
        origin, direction = observation.cameras[c].rays(observation.pixels[c, k])
        across = observation.confidence[c, k] ** 2 * (np.eye(3) - np.outer(direction, direction))
        precision, pull = precision + across, pull + across @ origin
    if not np.isfinite(precision).all() or np.linalg.eigvalsh(precision)[0] <= _SPREAD * np.trace(precision):
        return np.inf, np.full(3, np.nan)
    place = np.linalg.solve(precision, pull)
    off = [np.linalg.norm(observation.cameras[c].project(place) - observation.pixels[c, k]) for c in some]
    return float(np.nan_to_num(np.mean(off), nan=np.inf)), place


def _errors(run: Run, reference: Reference) -> dict[str, float]:
    errors = evaluate(run, reference)
    return {"mpjpe": 1e3 * errors.mpjpe, "pa": 1e3 * errors.pa_mpjpe}


def _show(figures: dict[str, Any]) -> None:
    made = report.table("beam4cam by four cameras", "tracked from", "MPJPE", "PA")
    for name in (PICTURES, *WAYS):
        made.add_row(name, *(f"{figures[name][key]:.1f}" for key in ("mpjpe", "pa")))
    for way in WAYS:
        ratios = (figures[way][key] / figures[PICTURES][key] for key in ("mpjpe", "pa"))
        made.add_row(f"{way}, of the pictures'", *(f"{ratio:.2f}" for ratio in ratios))
    made.add_row("target", *[f"{MOST:.2f}"] * 2)
    report.console().print(made)
    report.print_lines([LEGEND])
