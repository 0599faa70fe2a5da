"""The other hypotheses of a source on a body, frame by frame, so that its motion has a spread."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.retargeting.correspondence import Correspondence
from estimator.retargeting.problem import MotionProblem
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.start import searched
from estimator.retargeting.targets import Targets, targets_of

_STEPS = 8


@dataclass(frozen=True)
class SourceHypotheses:
    """Of a source's frames: points (T, K, L, 3) [m] of its landmarks, NaN where there are fewer; weight (T, 1 + K),
    that of the motion itself first."""

    points: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class CarriedHypotheses:
    """q (T, K, nq), NaN where the source has fewer; energy (T, K), of directions and places; weight (T, 1 + K), that of
    the motion itself first."""

    q: np.ndarray
    energy: np.ndarray
    weight: np.ndarray


def carried_hypotheses(
    problem: MotionProblem,
    q: np.ndarray,
    source: SourceMotion,
    match: Correspondence,
    floor: float | None,
    others: SourceHypotheses,
) -> CarriedHypotheses:
    """Each hypothesis of each frame on the body, searched from the motion q (T, nq) within limits and clear of parts
    and floor; feet that stand stay where they stand in the motion."""
    count = others.points.shape[1]
    carried, energy = np.full((len(q), count, problem.body.nq), np.nan), np.full((len(q), count), np.nan)
    scaled = replace(match, scale=problem.targets.scale)
    for k in range(count):
        own = replace(source, points=others.points[:, k])
        targets = targets_of(problem.body, own, scaled, floor)
        case = problem.with_targets(targets, _feet(problem, targets))
        for t in np.flatnonzero((targets.weight > 0.0).any(axis=1)):
            carried[t, k], _ = searched(case, q[t], frame=int(t), steps=_STEPS)
            energy[t, k] = case.model(int(t), carried[t, k]).value
    return CarriedHypotheses(carried, energy, others.weight)


def _feet(problem: MotionProblem, targets: Targets) -> np.ndarray:
    """Places of the feet (T, F, 3, 3): where they stand in the motion, or where the hypothesis has them."""
    stands = np.asarray(problem.stances.stands.any(axis=2))[:, :, None, None]
    return np.where(stands, problem.stances.place, targets.place)
