"""Joint angles, lengths and bands of captured motions that were tracked from markers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.points.captured_trials import FPS, SET, CapturedTrial, MarkerFaults, captured_trial
from benchmarks.points.tracked_points import fit_of, root_mean_square, run_of
from benchmarks.support.common import tell
from estimator.fitting.fit import Fit
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import ROOT_Q, ROOT_V, Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

BAND = 0.9
_DEVIATIONS = 1.6448536269514722  # of a normal distribution within which 90 % lie
SHARES = ("by_fit", "by_covariance", "by_posterior")
FIGURES = ("rmse", "rest", "filtered", "known", "expected", "length", "worst_length", *SHARES)
_COLUMNS = (
    "clip, seed", "angles", "no offset", "filtered", "all known", "expected", "lengths", "worst", "90 %: fit",
    "smoothed", "run's",
)  # fmt: skip
LEGEND = (
    "angles: RMSE [degrees] over joints and frames, smoothed; no offset: each joint's mean error removed; filtered: as"
    " tracked. all known: with true lengths and places of markers, so noise alone. expected: RMS standard deviation of"
    " the fit's posterior, which no estimator beats on average. lengths: RMS and largest error of the body's segments"
    " [mm]. 90 %: share of true angles in the bands of the fit, in which lengths and places are unsure; of the smoothed"
    " covariance; and of the run (Run.interval)."
)


def measure_captured(
    folder: Path, work: Path, faults: MarkerFaults, clips: Sequence[str], seeds: Sequence[int], seconds: float
) -> dict[str, Any]:
    """Every clip and seed; the person is fitted on the trial itself."""
    trials, by_joint = dict[str, Any](), list[dict[str, list[float]]]()
    for clip in clips:
        for seed in seeds:
            trial = captured_trial(folder / f"{clip}.bvh", seed, faults, seconds, FPS)
            scores, joints = trial_scores(trial, work / f"{clip}_{seed}", seed)
            trials[f"{clip}, {seed}"] = scores
            by_joint.append(joints)
            tell(f"{clip}, seed {seed}: {scores['rmse']:.2f} degrees, lengths {scores['length']:.1f} mm")
    pooled = {name: np.mean([np.array(of[name]) for of in by_joint], axis=0).tolist() for name in by_joint[0]}
    figures = {"faults": vars(faults), "seconds": seconds, "trials": trials, "joints": pooled}
    _show(figures)
    return figures


def trial_scores(trial: CapturedTrial, stem: Path, seed: int) -> tuple[dict[str, float], dict[str, list[float]]]:
    """Figures of a trial by `FIGURES`; and by joint the mean square error [deg^2] and both shares inside bands."""
    path = trial.write(stem.with_name(f"{stem.name}.trc"))
    static = trial.write_static(stem.with_name(f"{stem.name}_static.trc"))
    fit = fit_of(load_subject("human34"), path, seed=seed, markers=SET, static=static)
    run = run_of(fit.subject, path, stem.with_name(f"{stem.name}.run"), seed=seed)
    known = run_of(trial.person, path, stem.with_name(f"{stem.name}_known.run"), seed=seed)
    errors, truth = angle_errors(run.q, trial.q[run.index]), trial.q[run.index]
    lengths = length_errors(run.body, Body(trial.person))
    inside = inside_covariance(run, errors), inside_interval(run, truth)
    scores = {
        "rmse": root_mean_square(errors), "rest": root_mean_square(errors - errors.mean(axis=0)),
        "filtered": root_mean_square(angle_errors(run.filtered_q, truth)),
        "known": root_mean_square(angle_errors(known.q, trial.q[known.index])),
        "expected": expected(fit), "length": root_mean_square(lengths), "worst_length": float(np.abs(lengths).max()),
        "by_fit": float(inside_fit(fit, trial.q).mean()),
        "by_covariance": float(inside[0].mean()), "by_posterior": float(inside[1].mean()), "frames": len(run),
    }  # fmt: skip
    squares, offsets = np.square(errors).mean(axis=0), np.square(errors.mean(axis=0))
    columns = squares, offsets, inside[0].mean(axis=0), inside[1].mean(axis=0)
    names = run.body.v_names[ROOT_V.stop :]
    return scores, {name: [float(c[k]) for c in columns] for k, name in enumerate(names)}


def angle_errors(q: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Errors of the joints (T, J), without the root, at q (T, nq) [deg]."""
    return np.degrees((q - truth)[:, ROOT_Q.stop :])


def length_errors(body: Body, truth: Body) -> np.ndarray:
    """Errors of the distances from each joint to the one that carries it (N,) [mm]; joints at one place have none."""
    ours, theirs = (
        np.array([np.linalg.norm(place.translation) for place in b.model.jointPlacements[2:]]) for b in (body, truth)
    )
    some = theirs > 1e-6
    return np.asarray(1e3 * (ours - theirs)[some])


def inside_covariance(run: Run, errors: np.ndarray) -> np.ndarray:
    """Whether each error (T, J) [deg] lies in the central 90 % band by the smoothed covariance."""
    smoothed = run.smoothed
    assert smoothed is not None
    assert smoothed.covariance is not None
    return np.abs(errors) <= _DEVIATIONS * deviations(np.array(smoothed.covariance))


def inside_fit(fit: Fit, truth: np.ndarray) -> np.ndarray:
    """The same for the fit's own frames (F, J), with uncertain lengths and places; truth (T, nq): poses of all
    frames."""
    errors = angle_errors(fit.poses, truth[[o.index for o in fit.observations]])
    return np.abs(errors) <= _DEVIATIONS * deviations(fit.pose_covariance)


def deviations(covariance: np.ndarray) -> np.ndarray:
    """Deviations of the joints (T, J) [deg], by covariances (T, nv, nv) [rad^2]."""
    return np.degrees(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, ROOT_V.stop :]))


def inside_interval(run: Run, truth: np.ndarray) -> np.ndarray:
    """Whether each joint (T, J) of the true poses (T, nq) lies in the interval that the run has for it."""
    ends = run.interval(BAND)[:, :, ROOT_Q.stop :]
    joints = truth[:, ROOT_Q.stop :]
    return (joints >= ends[:, 0]) & (joints <= ends[:, 1])


def expected(fit: Fit) -> float:
    """RMS standard deviation of the joints in the fit's frames [deg]."""
    return root_mean_square(deviations(fit.pose_covariance))


def _show(figures: dict[str, Any]) -> None:
    trials, faults = figures["trials"], figures["faults"]
    said = f"noise {1e3 * faults['noise']:.0f} mm, places {1e3 * faults['places']:.0f} mm"
    if faults["standing"] is not None:
        said += f", a static trial within {faults['standing']:g} degrees"
    made = report.table(f"captured motion by {SET}, {said}", *_COLUMNS)
    for name, of in (*trials.items(), ("all", _overall(list(trials.values())))):
        made.add_row(name, *(f"{of[key]:.2f}" for key in FIGURES))
    report.console().print(made)
    columns = ("joint", "RMSE", "offset", "90 %: smoothed", "run's")
    made = report.table("by joint, all trials", *columns)
    for name, (square, offset, *shares) in sorted(figures["joints"].items(), key=lambda item: -item[1][0]):
        made.add_row(name, f"{square**0.5:.2f}", f"{offset**0.5:.2f}", *(f"{share:.2f}" for share in shares))
    report.console().print(made)
    report.print_lines([LEGEND])


def _overall(of: Sequence[dict[str, float]]) -> dict[str, float]:
    """RMS of errors, the worst of the worst, means of shares."""
    shares = {key: float(np.mean([t[key] for t in of])) for key in SHARES}
    errors = {key: root_mean_square(np.array([t[key] for t in of])) for key in FIGURES if key not in shares}
    return {**errors, **shares, "worst_length": max(t["worst_length"] for t in of)}
