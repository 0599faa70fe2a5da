"""How far a clip's keypoints are from a person: the noise of each camera, measured or given."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator.data.observation import Observation
from estimator.numerics.typical import measured_deviation
from estimator.search.cost_model import CostModel

_FACTORS = (0.3, 3.0)


def measured_noise(
    model: CostModel, observations: Sequence[Observation], poses: Sequence[np.ndarray], share: float, fitted: int
) -> tuple[float, ...]:
    """By how much the noise that is expected of a detector (`CostSettings.keypoint_noise`) is to be multiplied, for
    every camera.

    model: of the fitted body, whose keypoints' places are taken as known. poses (F) of (nq,): of the frames. share:
    what a frame counts, as detectors err alike in frames that are near each other. fitted: how many numbers the fit has
    found besides the poses.

    What a fit leaves is less than the noise by what it has found from the same numbers (degrees of freedom), and says
    the less of it the fewer are left: one camera's keypoints are hardly more than a pose, four cameras' are.
    """
    pairs = zip(observations, poses, strict=True)
    whitened = np.array([model.observation_term(o).distances(model.body.at(q)) for o, q in pairs])
    data = 2.0 * share * np.isfinite(whitened).sum(axis=(0, 2))
    left = max(0.0, 1.0 - (fitted + share * len(poses) * model.body.nv) / max(float(data.sum()), 1.0))
    return tuple(_factor(float(own), left, whitened[:, c]) for c, own in enumerate(data))


def given_noise(
    pixels: Sequence[float], observations: Sequence[Observation], expected: float, measured: Sequence[float] = ()
) -> tuple[float, ...]:
    """The factors that `measured_noise` returns, of the cameras for which a user gives the noise; others as measured.

    pixels (C,): standard deviations of keypoints where the person is as large as in the middle of the clip, NaN where
    none is given; empty for none. expected: as a share of the person's extent (`CostSettings.keypoint_noise`).
    measured (C,): empty where nobody has, which is 1.
    """
    if not len(pixels):
        return tuple(measured)
    extents = np.array([np.where(o.confidence.any(axis=1), o.extents, np.nan) for o in observations])
    given = np.array(pixels) / (expected * np.array([_median(of_camera) for of_camera in extents.T]))
    return tuple(np.where(np.isfinite(given), given, measured or 1.0).tolist())


def _factor(data: float, left: float, distances: np.ndarray) -> float:
    """Of a camera with so many numbers, of which a share is left to say something of noise; distances (F, L): of its
    keypoints, in standard deviations."""
    if data * left <= 0.0:
        return 1.0
    return float(np.clip(measured_deviation(distances / math.sqrt(left), data * left), *_FACTORS))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan
