"""Lengths of a body and the places of points on it together, every pose being at its own minimum; and the static trial
of a laboratory, in which the angles of joints are about known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.observation import Observation
from estimator.energy.cost import QuadraticModel
from estimator.energy.descent.compiled_seek import CompiledSeeker
from estimator.energy.descent.seek import SeekSettings
from estimator.energy.descent.solution import free_directions, mode_covariance
from estimator.energy.priors import Transition
from estimator.fitting.body_energy import bounded_step
from estimator.fitting.fit import Fit
from estimator.fitting.fitted_points import FittedPlaces, FittedPoints
from estimator.numerics.newton import Problem, Step
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from humanoid.kinematics.body import ROOT_Q, ROOT_V, Body
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import Subject

ANKLES = "ankle_dorsiflexion"
ANKLE_STD = 0.1
"""[rad] Of ankles in upright standing, at least: the centre of mass is 5 cm ahead of them, so that people lean by 3
degrees (D. Winter, Human balance and posture control during standing and walking, Gait and Posture 3, 1995), and shoes
lift heels."""


class StaticTrial(NamedTuple):
    """Frames of a person standing upright.

    std (nv,) [m, rad]: standard deviation of each degree of freedom from `standing_pose`, infinite where nothing is
    known of it. bent: names of the joints that plainly are not as `standing_pose` has them.
    """

    observations: Sequence[Observation]
    std: np.ndarray
    bent: tuple[str, ...]


def standing_pose(body: Body, q: np.ndarray) -> np.ndarray:
    """Configuration (nq,) of a body that stands upright where q (nq,) has its root, all joints at zero, or at the limit
    that is nearest to zero.

    These are not the rest positions (`Body.neutral`), which are the middle of everyday poses: knees and elbows are bent
    there.
    """
    standing = body.clamp(pin.neutral(body.model))
    if body.has_free_root:
        standing[ROOT_Q] = q[ROOT_Q]
    return standing


def static_trial(
    body: Body, observations: Sequence[Observation], poses: Sequence[np.ndarray], std: float, bent_from: float
) -> StaticTrial:
    """The information of a static trial on a body's joints.

    poses (F) of (nq,): of the frames, found without assuming that the person stands. std [rad]: of every joint,
    ankles at least `ANKLE_STD`. bent_from [rad]: joints that are farther from zero, in the median of the frames, are
    not taken as known, such as those of arms that are held out.
    """
    away = np.array([body.difference(standing_pose(body, q), q) for q in poses])
    ankles = np.array([without_side(name) == ANKLES for name in body.v_names])
    joints = np.where(ankles, max(std, ANKLE_STD), std)
    bent = np.abs(np.median(away, axis=0)) > bent_from
    if body.has_free_root:
        joints[ROOT_V], bent[ROOT_V] = np.inf, False
    joints[bent] = np.inf
    return StaticTrial(observations, joints, tuple(body.v_names[v] for v in np.flatnonzero(bent)))


_SEARCH = SeekSettings(kkt_tolerance=1e-5)  # of every pose
_UNSEEN = 1e-9  # curvature of directions that nothing is known of
_FARTHEST = 4.0  # standard deviations: hard range of a point's place along each axis


class Measures(NamedTuple):
    """The fitted measures: scales (P,) of the proportions, and how far every point whose place is fitted lies from
    it, offsets (F, 3) [m] in the frames of their joints."""

    scales: np.ndarray
    offsets: np.ndarray


class MeasuresModel(NamedTuple):
    """Quadratic model of an energy by the measures: scales (P,), then offsets (3 F,), every pose at its own minimum.

    gradient (G,). hessian (G, G): the Schur complement of the poses. poses (F) of (nq,): the minima. covariances (F)
    of (nv, nv): of the poses at these measures. follows (F) of (nv, G): how each pose moves with the measures.
    """

    value: float
    measures: Measures
    gradient: np.ndarray
    hessian: np.ndarray
    poses: list[np.ndarray]
    covariances: list[np.ndarray]
    follows: list[np.ndarray]

    @property
    def measures_covariance(self) -> np.ndarray:
        """Covariance of the measures (G, G)."""
        return np.asarray(np.linalg.inv(self.hessian))

    def lasting_std(self, of_measures: np.ndarray) -> np.ndarray:
        """The common error of all poses from measures with this covariance (G, G): of each degree of freedom
        (nv,), over the frames in which no limit holds it; 0 where one always does."""
        variances = np.array([np.sum((along @ of_measures) * along, axis=1) for along in self.follows])
        free = np.maximum(np.count_nonzero(variances, axis=0), 1)
        return np.sqrt(variances.sum(axis=0) / free)

    def pose_covariance(self, k: int, of_measures: np.ndarray) -> np.ndarray:
        """Covariance (nv, nv) of the k-th pose with measures with covariance (G, G)."""
        covariance = self.covariances[k] + self.follows[k] @ of_measures @ self.follows[k].T
        return np.asarray(0.5 * (covariance + covariance.T))


class MeasuresEnergy(Problem[MeasuresModel]):
    """Energy of lengths and places of points, minimised over the poses of all frames (variable projection), in their
    hard ranges.

    points: whose places are fitted. share: of each frame; soft tissue, and detectors, err alike in frames that are near
    each other. static: frames of a standing person, which come after the others and count as one together: there is
    one pose that the person took.
    """

    def __init__(
        self,
        body: ProportionedBody,
        points: FittedPoints,
        observations: Sequence[Observation],
        settings: CostSettings,
        share: float,
        static: StaticTrial | None = None,
    ) -> None:
        self._body, self._points, self._settings = body, points, settings
        self._frames = [_WeighedFrame(o, share, None) for o in observations]
        if static is not None:
            stood = static.observations
            self._frames += [_WeighedFrame(o, 1.0 / len(stood), static.std) for o in stood]
        place_std = np.repeat(points.std, 3)
        self._mean, self._std = (
            np.concatenate(each) for each in ((body.mean, np.zeros(len(place_std))), (body.std, place_std))
        )
        self._low = np.concatenate([body.low, -_FARTHEST * place_std])
        self._high = np.concatenate([body.high, _FARTHEST * place_std])

    def at_measures(self, measures: Measures) -> Body:
        """The body of some measures; its points follow from these without uncertainty."""
        body = self._body.at(measures.scales)
        self._points.put(body, measures.offsets)
        return body

    @property
    def start(self) -> Measures:
        """The prior expectation."""
        proportions = self._body
        return Measures(
            np.clip(proportions.mean, proportions.low, proportions.high), np.zeros((len(self._points.free), 3))
        )

    def fit(self, subject: Subject, model: MeasuresModel) -> Fit:
        """The subject with the lengths and the places of points of a model, how unsure these are, and the poses of the
        frames except those of a standing person."""
        covariance, count = model.measures_covariance, len(self._body.names)
        scales, offsets = model.measures
        stds = np.sqrt(np.diag(covariance)[count:].reshape(-1, 3).mean(axis=1))
        zeros = dict(zip(self._body.base.v_names, model.lasting_std(covariance).tolist(), strict=True))
        seen = tuple(frame.observation for frame in self._frames if frame.std is None)
        return Fit(
            self._points.fitted(subject.scaled(self._body.scales(scales)), FittedPlaces(offsets, stds, zeros)),
            self._body.names, scales, covariance[:count, :count], seen, np.array(model.poses[: len(seen)]),
            np.array([model.pose_covariance(k, covariance) for k in range(len(seen))]),
            moved=self._points.moved(offsets),
        )  # fmt: skip

    def step(self, model: MeasuresModel, damping: float) -> Step | None:
        """A step (G,) of the measures, within their range."""
        x = _packed(model.measures)
        move = bounded_step(model.hessian, model.gradient, self._low - x, self._high - x, damping)
        return None if move is None else (move, None)

    def at(self, model: MeasuresModel, step: Step) -> MeasuresModel:
        """The model after a step, the poses searched from where they follow to."""
        x = np.clip(_packed(model.measures) + step[0], self._low, self._high)
        body = self._body.base
        poses = [body.integrate(q, along @ step[0]) for q, along in zip(model.poses, model.follows, strict=True)]
        return self.model(Measures(x[: len(self._body.names)], x[len(self._body.names) :].reshape(-1, 3)), poses)

    def model(self, measures: Measures, poses: Sequence[np.ndarray]) -> MeasuresModel:
        """The model at some measures; the poses (F) of (nq,) are searched from the given ones."""
        body = self.at_measures(measures)
        frames, seeker = CostModel(body, self._settings), CompiledSeeker(body)
        e = (_packed(measures) - self._mean) / self._std
        value, gradient, hessian = 0.5 * float(e @ e), e / self._std, np.diag(1.0 / self._std**2)
        minima: list[np.ndarray] = []
        covariances: list[np.ndarray] = []
        follows: list[np.ndarray] = []
        for (observation, share, std), q in zip(self._frames, poses, strict=True):
            cost = frames.cost(frames.observation_term(observation))
            if std is not None:
                cost = cost.plus([Transition(body, standing_pose(body, q), std)])
            minimum = seeker.seek(cost, q, _SEARCH).quadratic
            quadratic = cost.of(minimum.posed)
            of_frame = self._frame(frames, observation, quadratic)
            value += share * minimum.value
            gradient = gradient + share * of_frame.gradient
            hessian = hessian + share * of_frame.hessian
            minima.append(minimum.posed.q)
            covariances.append(mode_covariance(body, minimum.posed.q, quadratic.gradient, quadratic.hessian))
            follows.append(of_frame.follows)
        return MeasuresModel(value, measures, gradient, 0.5 * (hessian + hessian.T), minima, covariances, follows)

    def _frame(self, model: CostModel, observation: Observation, minimum: QuadraticModel) -> _FrameShare:
        """One frame's share of gradient and Hessian, its pose at the minimum."""
        body, posed = model.body, minimum.posed
        some, force, weight = self._points.loads(model, observation, posed)
        D = self._derivatives(minimum, some)
        J = body.point_jacobians(posed, self._points.joint[some], self._points.in_world(body, posed, some))
        WD = (weight @ D).reshape(-1, D.shape[2])
        D, J = D.reshape(WD.shape), J.reshape(len(WD), -1)
        cross = J.T @ WD
        free = free_directions(body, posed.q, minimum.gradient)
        follows = np.zeros_like(cross)
        follows[free] = -np.linalg.solve(minimum.hessian[np.ix_(free, free)] + _UNSEEN * np.eye(len(free)), cross[free])
        return _FrameShare(D.T @ force.ravel(), D.T @ WD + cross[free].T @ follows[free], follows)

    def _derivatives(self, minimum: QuadraticModel, some: np.ndarray) -> np.ndarray:
        """Derivatives of points in the world by the measures, (K, 3, G); some (K,): their numbers."""
        points, lengths = self._points, len(self._body.names)
        joints = points.joint[some]
        D = np.zeros((len(some), 3, len(self._mean)))
        D[:, :, :lengths] = self._body.point_derivatives(minimum.posed, joints, points.slope[:, some])
        for k, m in enumerate(points.free):
            for row in np.flatnonzero(some == m):
                D[row, :, lengths + 3 * k : lengths + 3 * k + 3] = minimum.posed.rotations[joints[row]]
        return D


class _WeighedFrame(NamedTuple):
    """A frame, its weight, and the deviations of its joints about zero, (nv,) [rad]; None where unknown."""

    observation: Observation
    share: float
    std: np.ndarray | None


class _FrameShare(NamedTuple):
    gradient: np.ndarray
    hessian: np.ndarray
    follows: np.ndarray


def _packed(measures: Measures) -> np.ndarray:
    return np.concatenate([measures.scales, measures.offsets.ravel()])
