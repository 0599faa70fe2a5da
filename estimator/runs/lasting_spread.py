"""Errors common to all frames, which no number of frames removes: the places where a detector marks a person, and where
markers sit on one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from estimator.runs.camera_spread import LEAST_PRECISION
from humanoid.kinematics.body import Body, PosedBody, points_in_world
from humanoid.subject.landmarks import landmark_name, relative_spread

_LEAST = 1e-4  # m: of a marker whose place is known


def lasting_by_landmarks(
    body: Body, posed: Sequence[PosedBody], priors: Sequence[np.ndarray], covariances: np.ndarray, std: float
) -> np.ndarray:
    """Covariances (K, nv, nv) of K modes by how far a detector marks this person from the landmarks.

    priors (K, nv, nv): precision of the rest positions. covariances (K, nv, nv): of all else, zero where a mode is not
    free; what is returned is not. std [m]: of a bias, averaged over the landmarks.
    """
    known = np.flatnonzero([landmark_name(name) is not None for name in body.landmark_names])
    if not len(known):
        return np.zeros_like(covariances)
    deviation = std * relative_spread([body.landmark_names[i] for i in known])
    jacobians = (body.landmark_jacobians(mode, known) for mode in posed)
    return _moved(jacobians, deviation, priors, covariances)


class LastingPoints(NamedTuple):
    """Points of a body, (N): their joints, places in the joints' frames [m], and standard deviations of these [m]."""

    joint: np.ndarray
    local: np.ndarray
    std: np.ndarray

    @staticmethod
    def markers(body: Body) -> LastingPoints:
        """The body's markers."""
        return LastingPoints(body.marker_joint, body.marker_local, body.marker_std)

    @staticmethod
    def keypoints(body: Body) -> LastingPoints:
        """Places where a detector marks the body, as far as known."""
        known = np.isfinite(body.keypoint_std)
        return LastingPoints(body.landmark_joint[known], body.keypoint_local[known], body.keypoint_std[known])


def points_on_body(body: Body, cameras: int) -> LastingPoints | None:
    """The points by which a run measures a body, where the uncertainty of their places is known: markers of a run
    without cameras, or keypoints of one with several cameras that have fitted them. None for others: a person fitted by
    markers may be filmed with an unknown detector."""
    if not cameras and body.marker_names:
        return LastingPoints.markers(body)
    fitted = bool(body.subject.zeros) and bool(np.isfinite(body.keypoint_std).any())
    return LastingPoints.keypoints(body) if cameras > 1 and fitted else None


def lasting_by_places(
    body: Body,
    points: LastingPoints,
    posed: Sequence[PosedBody],
    priors: Sequence[np.ndarray],
    covariances: np.ndarray,
) -> np.ndarray:
    """The same by the uncertainty of the places of points on the body after a fit.

    The uncertainty of each place gives the common error. Where the subject has standard deviations of its zeros, as
    after a fit, in which all points of a link may be off alike, the covariances have these deviations where they are
    larger.
    """
    joint, local, std = points
    jacobians = (body.point_jacobians(mode, joint, points_in_world(mode, joint, local)) for mode in posed)
    moved = _moved(jacobians, np.maximum(std, _LEAST), priors, covariances)
    own = np.sqrt(np.maximum(np.diagonal(moved, axis1=1, axis2=2), _LEAST**2))
    larger = np.fmax(1.0, body.zero_std / own)
    return larger[:, :, None] * moved * larger[:, None, :]


def _moved(
    jacobians: Iterator[np.ndarray], deviation: np.ndarray, priors: Sequence[np.ndarray], covariances: np.ndarray
) -> np.ndarray:
    """Effect on least squares of points that are off by deviations (N,) [m], regularised by the rest positions; zero
    for modes that are free nowhere. jacobians (K) of (N, 3, nv): of the points.

    Degrees of freedom that a limit holds count too: with other places of the points they may not be held there.
    """
    moved = np.zeros_like(covariances)
    for own, jacobian, prior, covariance in zip(moved, jacobians, priors, covariances, strict=True):
        if not np.any(np.diagonal(covariance) > 0.0):
            continue
        J = jacobian / deviation[:, None, None]
        seen = np.einsum("lia,lib->ab", J, J) + prior + LEAST_PRECISION * np.eye(len(prior))
        gain = np.linalg.solve(seen, J.reshape(-1, len(prior)).T)
        own[:] = gain @ gain.T
    return moved
