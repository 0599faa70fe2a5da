"""First poses from keypoints, with a free root seen from every side, or from an index of examples: no manual
initialisation.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.inference.mixture import Mixture
from estimator.numerics.alignment import similarity_onto
from estimator.search.frame_search import FrameProblem
from estimator.search.from_examples import example_modes
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.search.proposals import CovarianceScaledProposal
from estimator.search.settings import BY_INDEX
from humanoid.kinematics.body import ROOT_JOINT, ROOT_PLACE_Q, ROOT_TURN_Q, Body, points_in_world

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


RANDOM_STARTS = 24
SCALE = 8.0**0.5
"""Factor on the standard deviations of the samples of the first frame: about eight on the covariance (CSS section
4.2)."""
STARTS_OF_MARKERS = 8
_FEWEST = 3  # markers that place a root


def start_modes(search: ModeSearch, rng: np.random.Generator, observation: Observation, count: int) -> Mixture:
    """The `count` best modes of one frame; from an index if `ModeSearchSettings.start` is "index" (`example_modes`).

    A free root is placed for every heading and pitch (`view_sphere`); a fixed one is tried at rest and at
    random configurations within the limits. Where only one camera sees the body, the limbs of these first modes are
    also tried at their other depths, which headings alone do not reach. Then samples are drawn about the modes found,
    see `ModeSearchSettings.start_samples`. Where there are pictures, the covariance includes their terms. The frame
    counts as the first that is seen.
    """
    observation = observation.alone
    if search.settings.start == BY_INDEX:
        return example_modes(search, rng, observation, count)
    associations = search.associations(observation)
    case = FrameProblem(associations)
    starts = [Hypothesis(q, k) for q in _starts(search.body, rng, observation) for k in range(len(associations))]
    modes = search.best_modes(starts, case, count)
    likelihood = search.likelihood(observation, modes.modes[0].q)
    case = case._replace(likelihood=likelihood)
    names = [association.name for association in associations]
    camera = observation.only_camera
    if likelihood.cameras or (camera is not None and (search.jumps.limbs or search.jumps.parts)):
        again = [
            Hypothesis(q, names.index(mode.association))
            for mode in modes.modes
            for q in (mode.q, *(search.jumps.of(mode.q, camera) if camera is not None else ()))
        ]
        modes = search.best_modes(again, case, count, rng)
    if search.settings.start_samples == 0:
        return modes
    reached = [Hypothesis(mode.q, names.index(mode.association)) for mode in modes.modes]
    samples = _samples(search, rng, observation, modes, case)
    # all are searched to convergence: before it, samples on their way to one mode would seem better than other modes
    return search.best_modes([*reached, *samples], case, count, rng, every=True)


def _starts(body: Body, rng: np.random.Generator, observation: Observation) -> list[np.ndarray]:
    if observation.markers is not None and len(observation.known_markers):
        return marker_starts(rng, body, observation.markers)
    if body.has_free_root:
        return view_sphere(body, body.neutral, observation)
    return [body.neutral, *(random_configuration(rng, body) for _ in range(RANDOM_STARTS))]


def _samples(
    search: ModeSearch, rng: np.random.Generator, observation: Observation, modes: Mixture, case: FrameProblem
) -> list[Hypothesis]:
    """Drawn by the covariance of the fit's pose, in the association that it explains better; without a fit by those of
    the modes, chosen by their weights."""
    count, estimate = search.settings.start_samples, observation.estimate
    if estimate is not None:
        readings = [Hypothesis(estimate.q, k) for k in range(len(case.associations))]
        (best,) = search.screened(readings, case, 1, pictures=False)
        proposal = CovarianceScaledProposal(search.body, estimate.q, estimate.covariance, SCALE)
        return [best._replace(q=proposal.sample(rng)) for _ in range(count)]
    names = [association.name for association in case.associations]
    samples = []
    for i, drawn in enumerate(rng.multinomial(count, modes.weights)):
        mode = modes.modes[i]
        proposal = CovarianceScaledProposal(search.body, mode.q, mode.covariance, SCALE)
        samples += [Hypothesis(proposal.sample(rng), names.index(mode.association)) for _ in range(drawn)]
    return samples


def marker_starts(rng: np.random.Generator, body: Body, markers: np.ndarray) -> list[np.ndarray]:
    """Configurations (nq,) with the root placed by markers (M, 3) [m], NaN where missing: the joints at rest, and drawn
    evenly within their limits.

    A free root is placed by all markers, and by those of the root's own link and of the next ones, which joints turn
    little against it.
    """
    some = np.isfinite(markers).all(axis=1)
    joints = [body.neutral, *(random_configuration(rng, body) for _ in range(STARTS_OF_MARKERS))]
    if not body.has_free_root:
        return joints
    near = some & (_distance_to_root(body)[body.marker_joint] <= _trunk(body, some))
    return [_placed(body, q, markers, used) for q in joints for used in (some, near) if used.sum() >= _FEWEST]


def _trunk(body: Body, some: np.ndarray) -> int:
    """Number of joints from the root within which there are enough markers."""
    away = np.sort(_distance_to_root(body)[body.marker_joint[some]])
    return int(away[min(_FEWEST, len(away)) - 1]) if len(away) else 0


def _distance_to_root(body: Body) -> np.ndarray:
    """(njoints,): how many joints lie between each and the root."""
    away = np.zeros(body.njoints, dtype=np.int64)
    for j in range(ROOT_JOINT + 1, body.njoints):
        away[j] = away[body.tree.joint_parent[j]] + 1
    return away


def _placed(body: Body, q: np.ndarray, markers: np.ndarray, used: np.ndarray) -> np.ndarray:
    """q (nq,) with its root moved so that the markers used (M,) are nearest to where they were measured."""
    posed = body.at(q)
    places = points_in_world(posed, body.marker_joint, body.marker_local)[used]
    moved = similarity_onto(places, markers[used])
    return with_root(q, moved.R @ posed.rotations[ROOT_JOINT], moved.of(posed.translations[ROOT_JOINT]))
