"""What is off by as much in every frame, and no number of frames takes away: where a detector marks a person, and where
markers sit on one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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


def lasting_by_markers(
    body: Body, posed: Sequence[PosedBody], priors: Sequence[np.ndarray], covariances: np.ndarray
) -> np.ndarray:
    """The same by how unsure the places of the body's markers are, each by itself."""
    jacobians = (
        body.point_jacobians(mode, body.marker_joint, points_in_world(mode, body.marker_joint, body.marker_local))
        for mode in posed
    )
    return _moved(jacobians, np.maximum(body.marker_std, _LEAST), priors, covariances)


def _moved(
    jacobians: Iterator[np.ndarray], deviation: np.ndarray, priors: Sequence[np.ndarray], covariances: np.ndarray
) -> np.ndarray:
    """What least squares makes of points that are off by deviations (N,) [m], drawn towards the rest positions; zero
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
