"""Errors and certificates of a run, as the measures report them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from benchmarks.support.tracking import Times
from estimator.data.cameras.camera import Camera
from estimator.energy.descent.seek import SeekSettings
from estimator.runs.evaluation import (
    FAR,
    FAR_PX,
    FAR_PX_SIZE,
    HIPS,
    Reference,
    evaluate,
    evaluate_points,
    largest_penetration,
    limit_violations,
    mpjpe,
    pa_mpjpe,
    trajectory_errors,
)
from estimator.runs.pairs import paired
from estimator.runs.run_reader import Run
from estimator.trackers.base import capabilities_of
from estimator.tracking.registry import make_tracker
from estimator.tracking.smoothing import FixedLag
from kinemode.explain import as_tracked, reopened_cues, run_settings

FAR_MM = 1e3 * FAR
LOST = (
    f"a joint error over {FAR_MM:.0f} mm or a distance in the image over {FAR_PX:.0f} px of {FAR_PX_SIZE[0]} x"
    f" {FAR_PX_SIZE[1]}, in larger pictures as much of the diagonal"
)
TRAJECTORIES = ("smoothed", "filtered", "best of K")


@dataclass(frozen=True)
class Scores:
    """One run against a reference; errors and overlaps in millimetres.

    mpjpe, pa: the best trajectory, smoothed over the whole clip. lag_mpjpe, lag_pa: some frames behind the track.
    filtered_mpjpe, filtered_pa: the best of each frame as it was tracked, without looking back.
    best_mpjpe, best_pa: of that of a frame's K hypotheses nearest to the reference (best of K).
    worst: mpjpe of the worst frame. far: frames where it is over `FAR_MM`.
    violations: frames where any hypothesis leaves a joint limit. overlap, overlap_all: largest interpenetration of the
    best hypothesis and of all modes. overlap_frames: frames where the best overlaps by over 10 mm.
    converged: share of the modes whose KKT residual is below the tolerance. kkt, kkt_all: largest residual among those,
    and among all.
    """

    mpjpe: float
    pa: float
    lag_mpjpe: float
    lag_pa: float
    filtered_mpjpe: float
    filtered_pa: float
    best_mpjpe: float
    best_pa: float
    worst: float
    far: int
    violations: int
    overlap: float
    overlap_all: float
    overlap_frames: int
    converged: float
    kkt: float
    kkt_all: float


def score(run: Run, reference: Reference) -> Scores:
    """Measure a run with the functions of `estimator.runs.evaluation`."""
    best = evaluate(run, reference)
    modes = run.mode_landmarks
    names, time, lagged = run.body.landmark_names, run.time, fixed_lag(run)
    pairs = paired(names, time, reference)
    frames = 1e3 * mpjpe(pairs.of(run.landmarks), pairs.truth, pairs.shared.root)
    lag = evaluate_points(names, lagged, lagged[:, None], time, reference)
    filtered = evaluate_points(names, modes[:, 0], modes[:, :1], time, reference)
    residual = run.mode_kkt_residual[np.isfinite(run.mode_kkt_residual)]
    done = residual[residual < SeekSettings().kkt_tolerance]
    overlaps = [largest_penetration(run.body, pose[None]) for pose in run.q]
    return Scores(
        mpjpe=1e3 * best.mpjpe,
        pa=1e3 * best.pa_mpjpe,
        lag_mpjpe=1e3 * lag["mpjpe"],
        lag_pa=1e3 * lag["pa_mpjpe"],
        filtered_mpjpe=1e3 * filtered["mpjpe"],
        filtered_pa=1e3 * filtered["pa_mpjpe"],
        best_mpjpe=1e3 * best.best_of_k_mpjpe,
        best_pa=1e3 * best.best_of_k_pa_mpjpe,
        worst=float(np.nanmax(frames, initial=0.0)),
        far=int(np.sum(frames > FAR_MM)),
        violations=max(limit_violations(run.body, q) for q in (run.q, *np.moveaxis(run.mode_q, 1, 0))),
        overlap=1e3 * best.penetration,
        overlap_all=1e3 * largest_penetration(run.body, run.mode_q.reshape(-1, run.body.nq)),
        overlap_frames=int(np.sum(np.array(overlaps) > 0.01)),
        converged=len(done) / max(1, len(residual)),
        kkt=float(np.max(done, initial=0.0)),
        kkt_all=float(np.max(residual, initial=0.0)),
    )


def fixed_lag(run: Run) -> np.ndarray:
    """Landmarks (T, L, 3) of the trajectory that is smoothed some frames behind the track; NaN before the first pose.

    Pictures are read again, as they are in live tracking. A tracker whose hypotheses have no energy has the track
    itself.
    """
    settings = run_settings(run)
    energy = capabilities_of(make_tracker(run.header.tracker, run.body, settings)).energy
    if energy is None:
        return np.asarray(run.mode_landmarks[:, 0])
    smoother = FixedLag(energy, settings.smooth, run.header.floor)
    with reopened_cues(run, settings) as reader:
        seen = (as_tracked(run, i, reader) for i in range(len(run)))
        given = [g for i, o in enumerate(seen) for g in smoother.push(o, run.result(i))] + smoother.flush()
    points = np.full((run.frame_count, len(run.body.landmark_names), 3), np.nan)
    for index, q in given:
        points[index] = run.body.landmarks(run.body.at(q))
    return points


def mean_scores(scores: Iterable[Scores]) -> Scores:
    """Mean errors and convergence, worst of the rest."""
    rows = [asdict(s) for s in scores]
    worst = ("worst", "far", "violations", "overlap", "overlap_all", "overlap_frames", "kkt", "kkt_all")
    return Scores(**{f.name: (max if f.name in worst else np.mean)([r[f.name] for r in rows]) for f in fields(Scores)})


COLUMNS = (
    "MPJPE", "PA", "lag", "PA    ", "filtered", "PA ", "best K", "PA  ", "limits", "overlap", "modes'", ">1 cm",
    "conv.", "KKT", "fps",
)  # fmt: skip


def cells(s: Scores, rate: float) -> list[str]:
    """A row under `COLUMNS`."""
    errors = (s.mpjpe, s.pa, s.lag_mpjpe, s.lag_pa, s.filtered_mpjpe, s.filtered_pa, s.best_mpjpe, s.best_pa)
    return [
        *(f"{e:.1f}" for e in errors), f"{s.violations:.0f}", f"{s.overlap:.1f}", f"{s.overlap_all:.1f}",
        f"{s.overlap_frames:.0f}", f"{s.converged:.1%}", f"{s.kkt:.1e}", f"{rate:.1f}",
    ]  # fmt: skip


LEGEND = (
    "[mm] over the 12 limb joints, hips aligned; PA: after the best similarity.\n"
    "MPJPE: best trajectory, smoothed; lag: smoothed with a fixed lag, as for live use; filtered: best of each frame as"
    " tracked.\n"
    "limits: frames with a limit violated by any hypothesis. overlap: deepest interpenetration [mm], of the best"
    " hypothesis and of all modes; >1 cm: frames where the best overlaps more.\n"
    "conv.: modes with a KKT residual below 1e-6; KKT: the largest residual of those."
)


@dataclass(frozen=True)
class TrackErrors:
    """One trajectory of limb joints against the exact truth.

    mean, worst: of the mean joint error, over the frames and in the worst one [mm], in the world: nothing is aligned.
    pixels: mean distance of the joints from the true ones in the image, in the worst frame [px].
    lost: the first lost frame, see `estimator.runs.evaluation.TrajectoryErrors`, None without any. of_limits:
    the largest error of any frame in terms of the limit from which it is lost, infinite where a frame has no pose or
    none in the image. aligned, pa: mean error with the hips aligned, NaN for a body without hips, and after the best
    similarity of each frame [mm].
    """

    mean: float
    worst: float
    pixels: float
    lost: int | None
    of_limits: float
    aligned: float
    pa: float


def track_errors(names: tuple[str, ...], points: np.ndarray, truth: np.ndarray, camera: Camera) -> TrackErrors:
    """Errors of points (T, L, 3), NaN in frames without a pose, against truth (T, L, 3) [m]; names (L)."""
    hips = [names.index(hip) for hip in HIPS] if set(HIPS) <= set(names) else None
    errors = trajectory_errors(points, truth, hips, (camera,))
    lost = np.flatnonzero(errors.lost)
    return TrackErrors(
        mean=1e3 * float(errors.world.mean()),
        worst=1e3 * float(errors.world.max()),
        pixels=float(errors.pixels.max()),
        lost=int(lost[0]) if len(lost) else None,
        of_limits=float(np.nan_to_num(errors.of_limits, nan=np.inf).max()),
        aligned=1e3 * float(errors.aligned.mean()) if hips else float("nan"),
        pa=1e3 * float(pa_mpjpe(points, truth).mean()),
    )


def trajectories(run: Run, truth: Reference) -> dict[str, TrackErrors]:
    """Errors of a run, in the image those in its first camera, by `TRAJECTORIES`: smoothed; the best of each frame as
    it was tracked; of each frame's K hypotheses the one whose joints are nearest."""
    pairs = paired(run.body.landmark_names, run.time, truth)
    names, ours, true = pairs.shared.names, pairs.shared.ours, pairs.truth_of_frames(len(run.time))
    modes = run.mode_landmarks[:, :, ours]
    distance = mpjpe(modes, true[:, None])
    nearest = np.where(np.isnan(distance), np.inf, distance).argmin(axis=1)
    chosen = (run.landmarks[:, ours], modes[:, 0], modes[np.arange(len(modes)), nearest])
    camera = run.header.cameras[0]
    return {name: track_errors(names, points, true, camera) for name, points in zip(TRAJECTORIES, chosen, strict=True)}


@dataclass(frozen=True)
class Outcome:
    """A run on a rendered clip: errors by trajectory, frames per second, and the notes on the input."""

    errors: dict[str, TrackErrors]
    fps: float
    notes: tuple[str, ...]


def outcome(run: Run, times: Times, truth: Path) -> Outcome:
    """Measure a run against the truth that was rendered."""
    return Outcome(trajectories(run, Reference.load(truth)), times.rate, run.header.notes)


TRACK_COLUMNS = ("mean", "worst frame", "image, worst [px]", "first lost")


def track_cells(errors: TrackErrors) -> list[str]:
    """A row under `TRACK_COLUMNS`."""
    lost = "none" if errors.lost is None else str(errors.lost)
    return [f"{errors.mean:.1f}", f"{errors.worst:.1f}", f"{errors.pixels:.1f}", lost]


TRACK_LEGEND = (
    "[mm] mean over the limb joints, in the world: nothing is aligned.\n"
    "smoothed: best hypothesis, along the path back and smoothed; filtered: best of each frame as tracked; best of K:"
    " of each frame's K hypotheses the nearest.\n"
    f"first lost: the first frame with {LOST}.\n"
    "fps: tracking and smoothing, without start and fit."
)
