"""A person's proportions from the first seconds of a clip (CSS section 5, first stage)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.cost.model import CostModel, CostSettings
from estimator.imaging.observation import Observation
from estimator.optimise.box_step import solve_box
from estimator.optimise.covariance import free_directions
from estimator.optimise.seek import Seeker, SeekSettings
from estimator.terms.term import Cost
from estimator.trackers.base import startable
from estimator.trackers.paths import backtrack_results
from estimator.tracking.registry import DEFAULT, make_tracker
from estimator.tracking.runner import run
from estimator.tracking.settings import Settings
from humanoid.kinematics.body import Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.subject import Subject


@dataclass(frozen=True)
class FitSettings:
    """How the fit is made.

    seconds, frames: it looks at this many frames, evenly spread over the first seconds with keypoints. rounds: times
    the poses are found anew with the lengths of the round before. iterations: Newton steps a round. effective_frames:
    detectors repeat their errors from frame to frame, so that all frames together count as this many.
    """

    seconds: float = 4.0
    frames: int = 30
    rounds: int = 2
    iterations: int = 15
    effective_frames: float = 4.0


@dataclass(frozen=True)
class ShapeFit:
    """The flesh that was fitted, part by part (CSS section 5, second and third stage).

    parts (G): names of the parts, one for both where sides mirror each other. factors (G, 2): of the half-axes a and b
    of the sections, relative to the given subject. tapers (G, 2): changes of the tapers along a and b. std (G, 4):
    standard deviations of girth (the log of both factors), flatness (half the log of their ratio) and the tapers, zero
    where a part has no such parameter. frames: indices of the frames whose pictures were looked at. poses (F, nq),
    covariance (F, nv, nv): the body in these frames, and how uncertain it is with proportions and shape as uncertain
    as they are. agreement: shares of the body's outline that lie on the silhouettes' before and after, NaN without any.
    """

    parts: tuple[str, ...]
    factors: np.ndarray
    tapers: np.ndarray
    std: np.ndarray
    frames: tuple[int, ...]
    poses: np.ndarray
    covariance: np.ndarray
    agreement: tuple[float, float]


@dataclass(frozen=True)
class Fit:
    """Outcome of a fit.

    subject: the subject with the fitted lengths, and the fitted flesh if there is a `shape`. names (P): proportions by
    joint. scales (P,): estimate relative to the given subject. covariance (P, P): of the scales. observations (F): the
    frames used, in the readings that were chosen of them; none if none were usable, and the subject is then the given
    one. poses (F, nq): of the subject with the fitted lengths, in these frames. shape: of the flesh, None where it was
    not fitted.
    """

    subject: Subject
    names: tuple[str, ...]
    scales: np.ndarray
    covariance: np.ndarray
    observations: tuple[Observation, ...]
    poses: np.ndarray
    shape: ShapeFit | None = None

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the scales (P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def frames(self) -> tuple[int, ...]:
        """Indices of the frames used."""
        return tuple(o.index for o in self.observations)


def fit_proportions(
    subject: Subject,
    observations: Sequence[Observation],
    seed: int = 0,
    settings: FitSettings | None = None,
    track_settings: Settings | None = None,
) -> Fit:
    """Fit the proportions with left and right tied, the anthropometric prior and the hard range of each."""
    settings = settings or FitSettings()
    body = ProportionedBody(subject)
    used = chosen_frames(observations, settings)
    scales = np.clip(body.mean, body.low, body.high)
    if not used:
        return Fit(subject, body.names, np.ones(len(body.names)), np.diag(body.std**2), (), np.zeros((0, body.base.nq)))
    if not body.names:
        poses, seen = _poses(subject, used, seed, track_settings)
        return Fit(subject, (), np.zeros(0), np.zeros((0, 0)), tuple(seen), np.array(poses))
    for _ in range(settings.rounds):
        poses, seen = _poses(subject.scaled(body.scales(scales)), used, seed, track_settings)
        scales, covariance, poses = _refine(body, poses, seen, scales, settings, track_settings)
    return Fit(subject.scaled(body.scales(scales)), body.names, scales, covariance, tuple(seen), np.array(poses))


def chosen_frames(observations: Sequence[Observation], settings: FitSettings) -> list[Observation]:
    """Usable frames, evenly spread over the first seconds."""
    usable = [o for o in observations if startable(o)]
    usable = [o for o in usable if o.time <= usable[0].time + settings.seconds]
    if len(usable) <= settings.frames:
        return usable
    picks = np.unique(np.linspace(0, len(usable) - 1, settings.frames).round().astype(int))
    return [usable[k] for k in picks]


def _poses(
    subject: Subject, observations: Sequence[Observation], seed: int, settings: Settings | None
) -> tuple[list[np.ndarray], list[Observation]]:
    """Pose of every frame along the best path of a track, and the frames in the reading that the path chose."""
    tracker = make_tracker(DEFAULT, Body(subject), settings)
    results = [result for result, _ in run(tracker, observations, seed)]
    poses, seen = [], []
    for observation, result, k in zip(observations, results, backtrack_results(results), strict=True):
        poses.append(result.q[k])
        seen.append(tracker.search.read(observation, result.association[k]))
    return poses, seen


def _refine(
    body: ProportionedBody,
    poses: list[np.ndarray],
    observations: list[Observation],
    scales: np.ndarray,
    settings: FitSettings,
    track_settings: Settings | None,
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Damped Newton on the energy minimised over the poses (variable projection), bounded by the hard range.

    Returns the scales, their covariance and the poses at their minima.
    """
    problem = _Profile(body, observations, track_settings.cost if track_settings else CostSettings(), settings)
    here = problem.at(scales, poses)
    damping = 1e-3
    for _ in range(settings.iterations):
        value, gradient, hessian, at_poses = here
        step = np.zeros(len(scales))
        damped = hessian + damping * np.diag(np.diag(hessian))
        active = np.zeros(len(scales), dtype=np.int8)
        if solve_box(damped, gradient, body.low - scales, body.high - scales, active, 20, step) <= 0:
            damping *= 10.0
            continue
        moved = np.clip(scales + step, body.low, body.high)
        trial = problem.at(moved, at_poses)
        if trial[0] < value:
            scales, here, damping = moved, trial, max(1e-9, damping * 0.1)
            if value - trial[0] < 1e-4:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return scales, np.linalg.inv(here[2]), here[3]


class _Profile:
    """Energy of the scales with every pose at its own minimum."""

    def __init__(
        self, body: ProportionedBody, observations: list[Observation], settings: CostSettings, fit: FitSettings
    ) -> None:
        self._body, self._observations, self._settings = body, observations, settings
        self._share = min(1.0, fit.effective_frames / max(1, len(observations)))

    def at(self, scales: np.ndarray, poses: list[np.ndarray]) -> tuple[float, np.ndarray, np.ndarray, list[np.ndarray]]:
        """Value, gradient (P,) and Schur-complement Hessian (P, P) at scales (P,), and the poses at their minima."""
        proportions = self._body
        body = proportions.at(scales)
        model, seeker = CostModel(body, self._settings), Seeker(body)
        e = (scales - proportions.mean) / proportions.std
        value, gradient = 0.5 * float(e @ e), e / proportions.std
        hessian = np.diag(1.0 / proportions.std**2)
        found_poses = []
        for observation, q in zip(self._observations, poses, strict=True):
            term = model.observation_term(observation)
            cost: Cost = model.cost(term)
            found = seeker.seek(cost, q, SeekSettings(kkt_tolerance=1e-5))
            posed = found.quadratic.posed
            force, weight = term.point_loads(posed)
            D = proportions.landmark_derivatives(posed)
            J = body.landmark_jacobians(posed)
            WD = np.einsum("lab,lbp->lap", weight, D)
            cross = np.einsum("lav,lap->vp", J, WD)
            free = free_directions(body, posed.q, found.quadratic.gradient)
            H = cost.of(posed).hessian[np.ix_(free, free)] + 1e-9 * np.eye(len(free))
            value += self._share * found.quadratic.value
            gradient = gradient + self._share * np.einsum("la,lap->p", force, D)
            schur = np.einsum("lap,laq->pq", D, WD) - cross[free].T @ np.linalg.solve(H, cross[free])
            hessian = hessian + self._share * schur
            found_poses.append(posed.q)
        return value, gradient, 0.5 * (hessian + hessian.T), found_poses
