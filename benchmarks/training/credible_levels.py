"""Where the truth lies in the posterior: credible levels, coverage, expected calibration error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.support.common import in_processes
from benchmarks.training.calibration_clips import Tracked
from estimator.runs.posterior import PosteriorCalibration
from kinemode.testing.calibration import LEVELS, coverage

KINDS = ("dof", "landmark", "pose")
TRIED = {
    "covariance_scale": (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.7, 2.0),
    "scale_spread": (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8),
    "weight_temperature": (1.0, 2.0, 4.0, 8.0, 16.0, 32.0),
    "prior_weight": (1.0, 1.5, 2.0, 3.0, 4.0, 6.0),
    "size_std": (0.0, 0.01, 0.02, 0.03, 0.04, 0.06),
    "landmark_std": (0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.035, 0.04),
}


@dataclass(frozen=True)
class Levels:
    """Probabilities of the smallest regions that contain the truth, in N frames; evenly spread where all is right.

    dof (N, nv): of every degree of freedom. landmark (N, L): of every landmark's place. pose (N,): of the whole pose.
    """

    dof: np.ndarray
    landmark: np.ndarray
    pose: np.ndarray


def credible_levels_of(case: Tracked, calibration: PosteriorCalibration, seed: int = 0) -> Levels:
    """Levels of the truth in the frames of a clip; seed: of the samples that regions are found with."""
    rng = np.random.default_rng(seed)
    body = case.tracked_body()
    dof, landmark, pose = [], [], []
    for i, (truth, places) in enumerate(zip(case.truth, case.truth_landmarks, strict=True)):
        posterior = case.posterior(body, i, calibration)
        best = posterior.best
        dof.append(posterior.marginals(best).credible_level(body.difference(best, truth)))
        landmark.append(posterior.landmark_credible_levels(rng, places[None])[0])
        pose.append(posterior.credible_levels(rng, truth[None])[0])
    return Levels(np.array(dof), np.array(landmark), np.array(pose))


def together(parts: Iterable[Levels]) -> Levels:
    """The frames of several clips."""
    parts = list(parts)
    dof, landmark, pose = ([getattr(p, name) for p in parts if len(p.pose)] for name in ("dof", "landmark", "pose"))
    return Levels(np.concatenate(dof), np.concatenate(landmark), np.concatenate(pose))


def fitted_calibration(cases: Sequence[Tracked], jobs: int, tell: Callable[[str], None]) -> PosteriorCalibration:
    """The calibration of least mean squared distance between coverage and level on tracked clips.

    All three kinds of regions have equal weight. From round to round the one change of one number to a neighbour in
    `TRIED` is made that gains most, until none does; the distance from limits is the mean of the true ones.
    """
    smoothed = all(case.smoothed is not None for case in cases)
    start = (1.0, 0.4, 1.0, 1.0) if smoothed else (1.0, 0.4, 4.0, 2.0)
    best = PosteriorCalibration(*start, _mean_lean(cases), 0.03, 0.02)
    known = {best: miscoverage(best, cases)}
    while True:
        tried = [c for c in _neighbours(best) if c not in known]
        known.update(zip(tried, in_processes(partial(miscoverage, cases=cases), tried, jobs), strict=True))
        nearest = min(known, key=lambda c: known[c])
        tell(f"{nearest}: {known[nearest]:.5f}")
        if nearest == best:
            return best
        best = nearest


def _neighbours(calibration: PosteriorCalibration) -> list[PosteriorCalibration]:
    neighbours = []
    for name, values in TRIED.items():
        at = values.index(getattr(calibration, name))
        neighbours += [
            replace(calibration, **{name: v}) for v in (*values[max(0, at - 1) : at], *values[at + 1 : at + 2])
        ]
    return neighbours


def miscoverage(calibration: PosteriorCalibration, cases: Sequence[Tracked]) -> float:
    """Mean square of coverage less level on `LEVELS`, summed over the kinds of regions."""
    pooled = together(credible_levels_of(case, calibration) for case in cases)
    return sum(float(np.mean(np.square(coverage(getattr(pooled, k), LEVELS) - LEVELS))) for k in KINDS)


def _mean_lean(cases: Sequence[Tracked]) -> float:
    """Mean distance of the truth from limits that the best mode leans on; the default where none does."""
    gaps = []
    for case in cases:
        body = case.tracked_body()
        v, i = body.bounded_v, body.bounded_q
        for result, truth in zip(case.results, case.truth, strict=True):
            held = np.diagonal(result.covariance[0])[v] <= 0.0
            gaps.append(np.abs(truth[i] - result.q[0][i])[held])
    every = np.concatenate(gaps)
    return max(0.01, float(round(every.mean(), 2))) if every.size else PosteriorCalibration().limit_lean
