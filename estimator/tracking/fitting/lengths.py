"""The first stage of a fit: a person's proportions from keypoints (CSS section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimator.data.lifted import with_shares
from estimator.data.observation import Observation
from estimator.energy.descent.covariance import free_directions, mode_covariance
from estimator.energy.descent.newton import NewtonSettings, Problem, Step, minimise
from estimator.energy.descent.seek import Seeker, SeekSettings
from estimator.energy.reprojection import Reprojection
from estimator.energy.term import Cost
from estimator.search.cost_model import CostModel
from estimator.search.cost_settings import CostSettings
from estimator.trackers.capabilities import energy_of
from estimator.trackers.initialisation import enough_keypoints
from estimator.trackers.paths import backtrack_results
from estimator.tracking.fitting.descent import bounded_step
from estimator.tracking.fitting.fit import Fit, bounded_lengths
from estimator.tracking.fitting.settings import FitSettings
from estimator.tracking.registry import DEFAULT, make_tracker
from estimator.tracking.runner import run
from estimator.tracking.settings import Settings
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.subject import Subject

ENOUGH = 1e-4  # energy: a step that brings less is the last
_SEARCH = SeekSettings(kkt_tolerance=1e-5)  # of every pose
SIZES = (0.5, 1.25)
"""Least and largest size of a person, relative to the subject: of an adult of 1.70 m, 0.85 to 2.13 m."""
_OTHER, _SAME = 0.03, 0.02  # logarithms of sizes: from which a person is of another, up to which of the same
_ROUNDS = 4  # of resizing
_UNSEEN = 1e-9  # curvature of directions that nothing is known of


def fit_lengths(
    subject: Subject,
    observations: Sequence[Observation],
    seed: int,
    settings: FitSettings,
    track_settings: Settings | None = None,
) -> Fit:
    """Fit the proportions with left and right tied, the anthropometric prior and the hard range of each.

    Several cameras see how large a person is: where most lengths ask for another size, the subject as a whole is
    resized first, within `SIZES`, and its proportions are fitted around that. The scales are relative to the resized
    subject.
    """
    fit, size = _fitted(subject, observations, seed, settings, track_settings), 1.0
    if not fit.names or not fit.observations or len(fit.observations[0].cameras) < 2:
        return fit
    recentred = bool(abs(np.log(fit.scales).mean()) > _OTHER or 2 * len(bounded_lengths(fit.subject)) > len(fit.names))
    for _ in range(_ROUNDS if recentred else 0):
        step = float(np.clip(size * np.exp(np.log(fit.scales).mean()), *SIZES)) / size
        if abs(np.log(step)) < _SAME:
            break
        size *= step
        fit = _fitted(subject.resized(size), observations, seed, settings, track_settings)
    return replace(fit, size=size)


def _fitted(
    subject: Subject,
    observations: Sequence[Observation],
    seed: int,
    settings: FitSettings,
    track_settings: Settings | None,
) -> Fit:
    """The same of a subject as large as it is."""
    body = ProportionedBody(subject)
    used = chosen_frames(observations, settings)
    if not used:
        none = np.zeros((0, body.base.nq)), np.zeros((0, body.base.nv, body.base.nv))
        return Fit(subject, body.names, np.ones(len(body.names)), np.diag(body.std**2), (), *none)
    if not body.names:
        poses, covariances, seen = _poses(subject, used, seed, track_settings)
        return Fit(subject, (), np.zeros(0), np.zeros((0, 0)), tuple(seen), np.array(poses), np.array(covariances))
    cost = track_settings.cost if track_settings else CostSettings()
    scales = np.clip(body.mean, body.low, body.high)
    for _ in range(settings.rounds):
        poses, _, seen = _poses(subject.scaled(body.scales(scales)), used, seed, track_settings)
        energy = LengthsEnergy(body, seen, cost, settings.effective_frames)
        newton = NewtonSettings(settings.iterations, enough=ENOUGH)
        best = minimise(energy, energy.model(scales, poses), newton).model
        scales = best.scales
    covariance = np.linalg.inv(best.hessian)
    of_poses = np.array([frame.pose_covariance(covariance) for frame in best.frames])
    fitted = subject.scaled(body.scales(scales))
    return Fit(fitted, body.names, scales, covariance, tuple(seen), np.array(best.poses), of_poses)


def chosen_frames(observations: Sequence[Observation], settings: FitSettings) -> list[Observation]:
    """Usable frames, evenly spread over the first seconds."""
    usable = [o for o in observations if enough_keypoints(o)]
    usable = [o for o in usable if o.time <= usable[0].time + settings.seconds]
    if len(usable) > settings.frames:
        picks = np.unique(np.linspace(0, len(usable) - 1, settings.frames).round().astype(int))
        usable = [usable[k] for k in picks]
    return with_shares(usable)


def _poses(
    subject: Subject, observations: Sequence[Observation], seed: int, settings: Settings | None
) -> tuple[list[np.ndarray], list[np.ndarray], list[Observation]]:
    """Pose of every frame along the best path of a track, its covariance with the lengths as they are, and the frames
    in the reading that the path chose."""
    tracker = make_tracker(DEFAULT, Body(subject), settings)
    results = [result for result, _ in run(tracker, observations, seed)]
    search, poses, covariances, seen = energy_of(tracker, "css"), [], [], []
    for observation, result, k in zip(observations, results, backtrack_results(results), strict=True):
        poses.append(result.q[k])
        covariances.append(result.covariance[k])
        seen.append(search.associated(observation, result.association[k]))
    return poses, covariances, seen


class LengthsModel(NamedTuple):
    """Quadratic model of an energy by the scales (P,) of the proportions, every pose being at its own minimum.

    gradient (P,). hessian (P, P): the Schur complement of the poses. frames (F): each at its minimum.
    """

    value: float
    scales: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    frames: list[_FrameModel]

    @property
    def poses(self) -> list[np.ndarray]:
        """The minima, (F) of (nq,)."""
        return [frame.q for frame in self.frames]


class LengthsEnergy(Problem[LengthsModel]):
    """Energy of the scales, minimised over the poses of all frames (variable projection), in their hard range.

    effective_frames: all frames together count as this many, or as they are if they are fewer.
    """

    def __init__(
        self,
        body: ProportionedBody,
        observations: Sequence[Observation],
        settings: CostSettings,
        effective_frames: float,
    ) -> None:
        self._body, self._observations, self._settings = body, observations, settings
        self._share = min(1.0, effective_frames / max(1, len(observations)))

    def step(self, model: LengthsModel, damping: float) -> Step | None:
        """A step (P,) of the scales, within their range."""
        low, high = self._body.low - model.scales, self._body.high - model.scales
        move = bounded_step(model.hessian, model.gradient, low, high, damping)
        return None if move is None else (move, None)

    def at(self, model: LengthsModel, step: Step) -> LengthsModel:
        """The model after a step, the poses searched from where they were."""
        return self.model(np.clip(model.scales + step[0], self._body.low, self._body.high), model.poses)

    def model(self, scales: np.ndarray, poses: Sequence[np.ndarray]) -> LengthsModel:
        """The model at scales (P,); the poses (F) of (nq,) are searched from the given ones."""
        proportions = self._body
        body = proportions.at(scales)
        frames, seeker = CostModel(body, self._settings), Seeker(body)
        e = (scales - proportions.mean) / proportions.std
        value, gradient = 0.5 * float(e @ e), e / proportions.std
        hessian = np.diag(1.0 / proportions.std**2)
        minima: list[_FrameModel] = []
        for observation, q in zip(self._observations, poses, strict=True):
            term = frames.observation_term(observation)
            frame = _frame_model(proportions, seeker, frames.cost(term), term, q)
            value += self._share * frame.value
            gradient = gradient + self._share * frame.gradient
            hessian = hessian + self._share * frame.hessian
            minima.append(frame)
        return LengthsModel(value, scales, gradient, 0.5 * (hessian + hessian.T), minima)


class _FrameModel(NamedTuple):
    """One frame's share of a `LengthsModel`, and its pose (nq,); covariance (nv, nv): of the pose at these scales.
    follows (nv, P): how the pose moves with the scales."""

    value: float
    gradient: np.ndarray
    hessian: np.ndarray
    q: np.ndarray
    covariance: np.ndarray
    follows: np.ndarray

    def pose_covariance(self, of_scales: np.ndarray) -> np.ndarray:
        """Covariance (nv, nv) of the pose with scales as uncertain as their covariance (P, P) says."""
        covariance = self.covariance + self.follows @ of_scales @ self.follows.T
        return np.asarray(0.5 * (covariance + covariance.T))


def _frame_model(
    proportions: ProportionedBody, seeker: Seeker, cost: Cost, term: Reprojection, q: np.ndarray
) -> _FrameModel:
    """One frame at the scales of the seeker's body, its pose searched from q (nq,)."""
    body = seeker.body
    minimum = seeker.seek(cost, q, _SEARCH).quadratic
    posed = minimum.posed
    force, weight = term.point_loads(posed)
    D = proportions.landmark_derivatives(posed)
    J = body.landmark_jacobians(posed)
    WD = np.einsum("lab,lbp->lap", weight, D)
    cross = np.einsum("lav,lap->vp", J, WD)
    free = free_directions(body, posed.q, minimum.gradient)
    hessian = cost.of(posed).hessian
    H = hessian[np.ix_(free, free)] + _UNSEEN * np.eye(len(free))
    follows = np.zeros_like(cross)
    follows[free] = -np.linalg.solve(H, cross[free])
    schur = np.einsum("lap,laq->pq", D, WD) + cross[free].T @ follows[free]
    covariance = mode_covariance(body, posed.q, minimum.gradient, hessian)
    return _FrameModel(minimum.value, np.einsum("la,lap->p", force, D), schur, posed.q, covariance, follows)
