"""Poses to start from when nothing is known: a free root seen from every side."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from humanoid.kinematics.body import ROOT_PLACE_Q, ROOT_TURN_Q, Body, points_in_world

HEADINGS = 12
PITCHES = (-0.5, 0.0, 0.5)  # rad, of the camera's view relative to the horizontal plane of the body


def view_sphere(body: Body, q_rest: np.ndarray, observation: Observation) -> list[np.ndarray]:
    """Configurations with the joints of `q_rest` (nq,) and the root placed for the camera that sees most.

    For each heading and pitch, the landmarks' weak-perspective image is matched to the keypoints by the least-squares
    similarity of the plane: its turn gives the roll about the optical axis, its size the depth. A parallel camera
    measures no depth, so the root keeps the depth of `q_rest`.
    """
    c = int(np.argmax(observation.confidence.sum(axis=1)))
    camera = observation.cameras[c]
    seen = observation.confidence[c] > 0.0
    rays = _normalised(camera, observation.pixels[c, seen])
    weight = observation.confidence[c, seen]
    points = _root_points(body, q_rest)[seen]
    depth = float(camera.depths(q_rest[ROOT_PLACE_Q])) if camera.parallel else None
    starts = []
    for pitch in PITCHES:
        for heading in np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS:
            R_camera_root = _view(heading, pitch)
            placed = _weak_perspective(points @ R_camera_root.T, rays, weight, depth)
            if placed is not None:
                roll, t_camera = placed
                R_world_root = camera.R_camera_world.T @ roll @ R_camera_root
                p_world = camera.R_camera_world.T @ (t_camera - camera.t_camera_world)
                starts.append(with_root(q_rest, R_world_root, p_world))
    return starts


def _normalised(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) -> x/z, y/z in the camera's frame, for a first guess: Brown's distortion is small enough to leave
    out. Others are not, least of all a fisheye's, outside whose circle all is far aside. Of a parallel camera x, y [m].
    """
    if camera.lens.ndim == 2:
        return np.nan_to_num(camera.directions(pixels)[:, :2], nan=10.0)
    y = (pixels[:, 1] - camera.K[1, 2]) / camera.K[1, 1]
    x = (pixels[:, 0] - camera.K[0, 2] - camera.K[0, 1] * y) / camera.K[0, 0]
    return np.stack([x, y], axis=1)


def _root_points(body: Body, q: np.ndarray) -> np.ndarray:
    """Landmarks (L, 3) [m] in the root's frame."""
    posed = body.at(q)
    T_root_world = pin.SE3(posed.rotations[1], posed.translations[1]).inverse()
    points = points_in_world(posed, body.landmark_joint, body.landmark_local)
    return points @ T_root_world.rotation.T + T_root_world.translation


def _view(heading: float, pitch: float) -> np.ndarray:
    """R_camera_root of a camera facing a body with x forward, y left, z up."""
    turned = pin.utils.rotate("z", heading)
    facing = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # camera x right, y down, z forward
    return pin.utils.rotate("x", pitch) @ facing @ turned


def _weak_perspective(
    points: np.ndarray, rays: np.ndarray, weight: np.ndarray, deep: float | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Roll (3, 3) about the optical axis and position of the root [m, camera frame] that fit points (N, 3) to rays;
    deep [m]: the root's depth where rays are parallel, None where it follows from the image's size."""
    w = weight / weight.sum()
    centre, image_centre = w @ points, w @ rays
    a = (points - centre)[:, 0] + 1j * (points - centre)[:, 1]
    b = (rays - image_centre)[:, 0] + 1j * (rays - image_centre)[:, 1]
    spread = float(w @ np.abs(a) ** 2)
    if spread <= 1e-9:
        return None
    similarity = (w @ (np.conj(a) * b)) / spread
    # the size of the similarity shrinks where shapes differ; the ratio of extents does not
    scale = float(np.sqrt((w @ np.abs(b) ** 2) / spread))
    if abs(similarity) < 1e-9 or scale < 1e-9:
        return None
    c, s = similarity.real / abs(similarity), similarity.imag / abs(similarity)
    roll = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    if deep is not None:
        return roll, np.array([*(image_centre - (roll @ centre)[:2]), deep])
    depth = 1.0 / scale
    middle = np.array([image_centre[0] * depth, image_centre[1] * depth, depth])
    return roll, middle - roll @ centre


def with_root(q: np.ndarray, R_world_root: np.ndarray, p_world: np.ndarray) -> np.ndarray:
    """The configuration q (nq,) with its free root turned by R_world_root (3, 3) and at p_world (3,) [m]."""
    q = q.copy()
    q[ROOT_PLACE_Q] = p_world
    q[ROOT_TURN_Q] = pin.Quaternion(R_world_root).normalized().coeffs()
    return q


def random_configuration(rng: np.random.Generator, body: Body) -> np.ndarray:
    """Neutral configuration (nq,) with every limited joint drawn evenly between its limits."""
    q = body.neutral.copy()
    i = body.bounded_q
    q[i] = rng.uniform(body.lower[i], body.upper[i])
    return q
