"""The first stage of a fit: a person's proportions from keypoints (CSS section 5), whose noise is measured or given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.data.observation import Observation
from estimator.fitting.fit import OTHER_SIZE, Fit, bounded_lengths, chosen_pieces, fit_resized, unfitted
from estimator.fitting.fitted_points import FittedKeypoints
from estimator.fitting.measures import MeasuresEnergy
from estimator.fitting.settings import FitSettings
from estimator.numerics.newton import NewtonSettings, minimise
from estimator.numerics.robust import measured_deviation
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.trackers.base import energy_of
from estimator.trackers.frame_result import backtrack_results
from estimator.tracking.registry import DEFAULT, Settings, make_tracker
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.subject import Subject

_FACTORS = (0.3, 3.0)


def measured_noise(
    model: CostModel, observations: Sequence[Observation], poses: Sequence[np.ndarray], share: float, fitted: int
) -> tuple[float, ...]:
    """The factor on the expected noise of a detector (`CostSettings.keypoint_noise`), for
    every camera.

    model: of the fitted body, whose keypoints' places are taken as known. poses (F) of (nq,): of the frames. share:
    what a frame counts, as detectors err alike in frames that are near each other. fitted: how many numbers the fit has
    found besides the poses.

    What a fit leaves is less than the noise by what it has found from the same numbers (degrees of freedom), and
    contains the less of it the fewer are left: one camera's keypoints are hardly more than a pose, four cameras' are.
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
    measured (C,): empty where it was not, which means 1.
    """
    if not len(pixels):
        return tuple(measured)
    extents = np.array([np.where(o.confidence.any(axis=1), o.extents, np.nan) for o in observations])
    given = np.array(pixels) / (expected * np.array([_median(of_camera) for of_camera in extents.T]))
    return tuple(np.where(np.isfinite(given), given, measured or 1.0).tolist())


def _factor(data: float, left: float, distances: np.ndarray) -> float:
    """The noise factor of a camera with so many numbers, of which a share is left for the noise; distances (F, L): of
    its keypoints, in standard deviations."""
    if data * left <= 0.0:
        return 1.0
    return float(np.clip(measured_deviation(distances / math.sqrt(left), data * left), *_FACTORS))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


ENOUGH = 1e-4  # energy: a step that brings less is the last
_ROUNDS = 4  # of resizing


def fit_lengths(
    subject: Subject,
    observations: Sequence[Observation],
    seed: int,
    settings: FitSettings,
    track_settings: Settings | None = None,
) -> Fit:
    """Fit the proportions with left and right tied, the anthropometric prior and the hard range of each.

    Several cameras see how large a person is: where most lengths indicate another size, the subject as a whole is
    resized first, within `SIZES`, and its proportions are fitted around that. The scales are relative to the resized
    subject.
    """

    def fit_of(sized: Subject) -> tuple[Fit, float]:
        fit = _fitted(sized, observations, seed, settings, track_settings)
        asks = sized is not subject or _of_another_size(fit)
        return fit, fit.mean_size if asks else 1.0

    return fit_resized(subject, fit_of, _ROUNDS)


def _of_another_size(fit: Fit) -> bool:
    """Whether several cameras indicate another size of the subject as a whole."""
    if not fit.names or not fit.observations or len(fit.observations[0].cameras) < 2:
        return False
    off = abs(np.log(fit.mean_size)) > OTHER_SIZE
    return bool(off or 2 * len(bounded_lengths(fit.subject)) > len(fit.names))


def _fitted(
    subject: Subject,
    observations: Sequence[Observation],
    seed: int,
    settings: FitSettings,
    track_settings: Settings | None,
) -> Fit:
    """The same for a subject at its size."""
    body = ProportionedBody(subject)
    pieces = chosen_pieces(observations, settings)
    if not pieces:
        return unfitted(subject, body)
    if not body.names:
        poses, covariances, seen = _poses(subject, pieces, seed, track_settings)
        return Fit(subject, (), np.zeros(0), np.zeros((0, 0)), tuple(seen), np.array(poses), np.array(covariances))
    cost = track_settings.cost if track_settings else CostSettings()
    person, measures = subject, None
    for _ in range(settings.rounds):
        poses, _, seen = _poses(person, pieces, seed, track_settings)
        share = min(1.0, settings.effective_frames / len(seen))
        energy = MeasuresEnergy(body, FittedKeypoints(body, cameras=len(seen[0].cameras)), seen, cost, share)
        newton = NewtonSettings(settings.iterations, enough=ENOUGH)
        best = minimise(energy, energy.model(measures or energy.start, poses), newton).model
        fit, measures = energy.fit(subject, best), best.measures
        person = fit.subject
    model = CostModel(energy.at_measures(best.measures), cost)
    return replace(fit, noise=measured_noise(model, seen, best.poses, share, len(best.gradient)))


def _poses(
    subject: Subject, pieces: Sequence[Sequence[Observation]], seed: int, settings: Settings | None
) -> tuple[list[np.ndarray], list[np.ndarray], list[Observation]]:
    """Pose of every frame along the best path of a track of its piece, its covariance with the lengths as they are, and
    the frames in the reading that the path chose."""
    body, poses, covariances, seen = Body(subject), [], [], []
    for observations in pieces:
        tracker = make_tracker(DEFAULT, body, settings)
        results = [result for result, _ in run(tracker, observations, seed)]
        search = energy_of(tracker, "css")
        for observation, result, k in zip(observations, results, backtrack_results(results), strict=True):
            poses.append(result.q[k])
            covariances.append(result.covariance[k])
            seen.append(search.associated(observation, result.association[k]))
    return poses, covariances, seen
