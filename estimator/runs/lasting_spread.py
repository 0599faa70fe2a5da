"""Errors common to all frames, which no number of frames removes: where a detector marks a person, where markers sit
on one, a single camera's distance, estimated cameras.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from humanoid.kinematics.body import ROOT_PLACE_V, ROOT_TURN_V, Body, PosedBody, points_in_world
from humanoid.subject.landmarks import landmark_name, relative_spread

LEAST_PRECISION = 1e-6
"""Precision of what neither landmarks nor rest positions constrain."""
_SEEN = 0.02  # m: standard deviation of observed landmarks, relative to the rest positions
_NEAR = 1e-6  # m^2: of a body in the camera itself


def camera_covariances(
    body: Body,
    posed: Sequence[PosedBody],
    priors: Sequence[np.ndarray],
    covariances: np.ndarray,
    cameras: Sequence[Camera],
    size_std: float,
) -> np.ndarray:
    """Covariances (K, nv, nv) of K modes due to what the cameras leave open, zero where that is not known.

    priors (K, nv, nv): precision of the rest positions. covariances (K, nv, nv): of all else, zero where a mode is not
    free. size_std: relative, of the body's size; it and the focal length count where there is one camera, which is not
    parallel (a parallel one measures the size).
    """
    if len(cameras) == 1 and body.has_free_root and not cameras[0].parallel:
        return np.array([_distance_covariance(body, mode, cameras[0], size_std) for mode in posed])
    if len(cameras) < 2 or all(camera.deviations is None for camera in cameras):
        return np.zeros_like(covariances)
    modes = zip(posed, priors, covariances, strict=True)
    return np.array([_rig_covariance(body, *mode, cameras) for mode in modes])


def _distance_covariance(body: Body, posed: PosedBody, camera: Camera, size_std: float) -> np.ndarray:
    """Covariance (nv, nv) of the root by what one camera cannot see.

    A body of another size, as much farther away, looks alike. So does one by a longer focal length, farther away along
    the optical axis and turned with the ray that it is seen along, as far as perspective within the body is small.
    """
    R_camera_root = camera.R_camera_world @ posed.rotations[1]
    place = camera.R_camera_world @ posed.translations[1] + camera.t_camera_world
    farther = np.array([0.0, 0.0, place[2]])  # by the focal length's own share of itself
    turn = np.cross(place, farther) / max(place @ place, _NEAR)  # of the ray to it
    modes = np.zeros((2, body.nv))
    modes[0, ROOT_PLACE_V] = size_std * (R_camera_root.T @ place)
    modes[1, ROOT_PLACE_V] = camera.focal_std * (R_camera_root.T @ farther)
    modes[1, ROOT_TURN_V] = camera.focal_std * (R_camera_root.T @ turn)
    return np.asarray(modes.T @ modes)


def _rig_covariance(
    body: Body, posed: PosedBody, prior: np.ndarray, covariance: np.ndarray, cameras: Sequence[Camera]
) -> np.ndarray:
    """Covariance (nv, nv) of a mode by the cameras' `deviations`: what least squares makes of landmarks that all
    cameras see where the deviations put them. First order; what hides landmarks is left out."""
    free = np.flatnonzero(np.diagonal(covariance) > 0.0)
    points, J = body.landmarks(posed), body.landmark_jacobians(posed)[:, :, free]
    weight = 1.0 / (_SEEN * relative_spread(body.landmark_names))
    count = max(0 if camera.deviations is None else camera.deviations.shape[1] for camera in cameras)
    precision, pull = prior[np.ix_(free, free)] + LEAST_PRECISION * np.eye(len(free)), np.zeros((len(free), count))
    for camera in cameras:
        place = points @ camera.R_camera_world.T + camera.t_camera_world
        seen = _across(camera, place) * weight[:, None, None]
        by_pose = seen @ camera.R_camera_world @ J
        precision += np.einsum("lia,lib->ab", by_pose, by_pose)
        if camera.deviations is not None:
            off = seen @ (_moves(place) @ camera.deviations)
            pull[:, : off.shape[2]] += np.einsum("lia,lik->ak", by_pose, off)
    modes = np.zeros((len(covariance), count))
    modes[free] = np.linalg.solve(precision, pull)
    return np.asarray(modes @ modes.T)


def _across(camera: Camera, place: np.ndarray) -> np.ndarray:
    """Parts (L, 3, 3) of moves of places (L, 3) in a camera that it sees: across its rays."""
    rays = np.tile([0.0, 0.0, 1.0], (len(place), 1)) if camera.parallel else place
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return np.asarray(np.eye(3) - rays[:, :, None] * rays[:, None])


def _moves(place: np.ndarray) -> np.ndarray:
    """Derivatives (L, 3, 7) of places (L, 3) in a camera by its deviations."""
    moves = np.zeros((len(place), 3, 7))
    moves[:, :, :3] = [-pin.skew(p) for p in place]
    moves[:, :, 3:6] = np.eye(3)
    moves[:, :2, 6] = place[:, :2]
    return moves


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
