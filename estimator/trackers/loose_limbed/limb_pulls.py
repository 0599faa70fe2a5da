"""Terms that pull the limbs of a body: to the places of a choice, and to their places in pictures near a pose."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from estimator.energy.limb_targets import LimbPull
from estimator.inference.beliefs.space import PLACEMENTS, placements_of, points_of
from estimator.numerics.alignment import similarity_onto
from estimator.search.first_pose import with_root
from estimator.trackers.loose_limbed.limb_choices import Choice
from humanoid.kinematics.body import Body
from humanoid.limbs.limb import LimbGraph, limb_placements, limbs_on_joints

NARROWEST = 0.1  # of the samples' spread: its least share, where the likelihood leaves only one sample


class LimbScores(Protocol):
    """The likelihood of single limbs by the measurements:
    `estimator.trackers.loose_limbed.limbs.likelihood.LimbLikelihood`."""

    def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Log ratio of places t (N, 3), R (N, 3, 3) of a limb: (N,) [nats], minus infinity where that is impossible."""
        ...


class Stiffness(NamedTuple):
    """Stiffness of the pull of beliefs. place [m], turn [rad]: added to their standard deviations, as variances.
    potential, nu: see `LimbPull`."""

    place: float
    turn: float
    potential: str
    nu: float

    @property
    def variance(self) -> np.ndarray:
        """The covariance (6, 6) that is added to others."""
        return np.diag(np.repeat(np.square([self.place, self.turn]), 3))


class Near(NamedTuple):
    """Sampling about each limb of a pose: `samples` places, normal deviates of `place` [m] and `turn` [rad], and the
    share of the log likelihood ratios in their weights."""

    samples: int
    place: float
    turn: float
    share: float


class LimbPulls:
    """Makes what draws the limbs of one body; see `LimbTargets`, also for the InputError."""

    def __init__(self, graph: LimbGraph, body: Body) -> None:
        self._graph, self._body = graph, body
        self._joint, self._local = limbs_on_joints(graph, body)
        self._length = np.array([[limb.length] for limb in graph.limbs])

    def of_choice(self, choice: Choice, weight: np.ndarray, how: Stiffness) -> LimbPull:
        """To the places of a choice. weight (L,): of each limb's belief."""
        target, precision = np.tile(np.eye(7)[6], (len(weight), 1)), np.zeros((len(weight), 6, 6))
        for i, place in enumerate(choice.places):
            if place is not None:
                target[i], precision[i] = place.point, _inverse(place.covariance + how.variance)
        weight = weight * np.array([place is not None for place in choice.places])
        return LimbPull(self._joint, self._local, target, precision, weight, how.potential, how.nu)

    def with_seen(
        self, rng: np.random.Generator, q: np.ndarray, believed: LimbPull, likelihood: LimbScores, near: Near
    ) -> LimbPull:
        """A pull, combined with one to the likelihood's place of each limb near the pose q (nq,).

        Samples of a kernel of precision P about a limb, weighted by a likelihood of precision L, have the precision P +
        L, and their mean is where a step of Newton's method damped by P leads. So a pull to it has the likelihood's
        slope at the pose and a curvature that keeps the step where samples are.
        """
        about = points_of(*limb_placements(self._graph, self._body, q))
        std = np.repeat([near.place, near.turn], 3)
        spread = std * _standard(rng, near.samples)
        target, precision, weight = about.copy(), np.zeros((len(about), 6, 6)), np.zeros(len(about))
        for i, point in enumerate(about):
            points = PLACEMENTS.moved(point, spread)
            ratio = likelihood.log_ratio(i, *placements_of(points))
            if np.isfinite(ratio).any():
                share = np.exp(near.share * (np.nan_to_num(ratio, nan=-np.inf) - np.nanmax(ratio)))
                share /= share.sum()
                mean = share @ spread  # in the tangent at the pose, as the samples are near
                covariance = (share[:, None] * spread).T @ spread - np.outer(mean, mean)
                target[i] = PLACEMENTS.integrate(point, mean)
                precision[i], weight[i] = _inverse(covariance + np.diag(np.square(NARROWEST * std))), 1.0
        return LimbPull(
            np.concatenate([believed.joint, self._joint]),
            np.concatenate([believed.local, self._local]),
            np.concatenate([believed.target, target]),
            np.concatenate([believed.precision, precision]),
            np.concatenate([believed.weight, weight]),
            believed.potential,
            believed.nu,
        )

    def from_rest(self, pull: LimbPull) -> list[np.ndarray]:
        """The body at rest, (nq,), a free root placed for the limbs: where the limb nearest to it is drawn, and so that
        all limbs' ends lie best."""
        body, rest = self._body, self._body.neutral
        drawn = np.flatnonzero(pull.weight > 0.0)
        if not body.has_free_root or len(drawn) == 0:
            return [rest]
        t, R = limb_placements(self._graph, body, rest)
        goal, turn = placements_of(pull.target)
        nearest = drawn[np.argmin([body.support(int(joint)).sum() for joint in self._joint[drawn]])]
        rotation = turn[nearest] @ R[nearest].T
        ends = np.concatenate([t[drawn], (t + self._length * R[:, :, 2])[drawn]])
        fitted = similarity_onto(ends, np.concatenate([goal[drawn], (goal + self._length * turn[:, :, 2])[drawn]]))
        placed = (rotation, goal[nearest] - rotation @ t[nearest]), (fitted.R, fitted.t)
        posed = body.at(rest)
        return [with_root(rest, R @ posed.rotations[1], R @ posed.translations[1] + t) for R, t in placed]


def _inverse(covariance: np.ndarray) -> np.ndarray:
    """A precision (6, 6), symmetric to the last bit."""
    precision = np.linalg.inv(covariance)
    return np.asarray(0.5 * (precision + precision.T))


def _standard(rng: np.random.Generator, count: int) -> np.ndarray:
    """Normal deviates (count, 6) with mean 0 and covariance 1 exactly: a flat likelihood moves nothing."""
    z = rng.standard_normal((count, 6))
    z -= z.mean(axis=0)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(z.T @ z / count), z.T).T)
