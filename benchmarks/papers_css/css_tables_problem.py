"""The likelihood of CSS section 7: joints of the 34-degree body against joints in one image, in the paper's regime."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.descent.seek import Seeker, SeekSettings
from estimator.energy.descent.solution import Solution, free_directions, mode_covariance
from estimator.energy.priors import GravityPrior, Stabilisers
from estimator.energy.reprojection import Reprojection
from estimator.energy.term import Term
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import without_side
from humanoid.subject.subject import load_subject

NU = 8.0  # of robust potentials, as the tracker has it
BEND = 0.25  # rad: standard deviation about rest of the joints of a random pose
_EYES_EARS = ("left_eye", "right_eye", "left_ear", "right_ear")
_FEET = tuple(f"{side}_{p}" for side in ("left", "right") for p in ("heel", "big_toe", "small_toe"))
UNSEEN = {"body": _EYES_EARS, "joints": (*_EYES_EARS, *_FEET, "nose", "mid_hip")}
"""Landmarks without a counterpart in the image: "body" has 22 left, feet among them, "joints" 14."""
SEARCH = SeekSettings(max_iterations=200)
UP = np.array([0.0, 0.0, 1.0])
_RESTS = {
    "knee_flexion": 0.5, "elbow_flexion": 0.62, "shoulder_elevation": 0.23, "shoulder_flexion": -0.1,
    "shoulder_rotation": -0.4, "clavicle_elevation": 0.0, "clavicle_protraction": 0.03, "neck_flexion": 0.1,
}  # fmt: skip
"""[rad] Where the joints of this problem rest, in the middle of what they do: the paper has Gaussian stabilisers, which
reach as far to either side, and its minima lie within the limits."""


class Regime(NamedTuple):
    """Settings of the observation noise and the pull to rest; by default as in Table 1.

    noise [px]: standard deviation of the image's joints. stabilisers [rad]: of every joint about its rest, Gaussian;
    0 takes the subject's own rests and deviations, long-tailed, as the tracker has them. potential: of the image's
    errors, a key of `estimator.numerics.robust.POTENTIALS`.
    """

    noise: float = 1.0
    stabilisers: float = 1.4
    potential: str = "gaussian"


PAPERS = Regime()


@dataclass(frozen=True)
class Problem:
    """An energy with a known mode.

    mode: the minimum nearest to the true pose. covariance (nv, nv): of the mode, zero where limits hold it.
    std (n,), axes (nv, n): standard deviations [rad, m] and eigenvectors of the covariance's free part, falling.
    camera: the only one.
    """

    body: Body
    cost: Cost
    mode: Solution
    covariance: np.ndarray
    std: np.ndarray
    axes: np.ndarray
    camera: Camera

    def steps(self, q: np.ndarray) -> np.ndarray:
        """Tangent vectors (N, nv) at the mode that lead to configurations q (N, nq)."""
        return np.array([self.body.difference(self.mode.q, x) for x in q]).reshape(-1, self.body.nv)

    def deviations(self, steps: np.ndarray) -> np.ndarray:
        """Mahalanobis lengths (N,) of steps (N, nv), over the directions that no limit holds."""
        lengths: np.ndarray = np.linalg.norm(steps @ self.axes / self.std, axis=1)
        return lengths


def joint_image_problem(
    pose: int, seen: str = "body", subject_name: str = "human34", regime: Regime = PAPERS
) -> Problem:
    """The problem of a random pose (the seed `pose`): a person 4 m away, joints bent about rest.

    `seen`: a key of UNSEEN.
    Table 1 has squared errors, not robust ones: its costs grow with the square of the scale.
    """
    subject = load_subject(subject_name)
    own = regime.stabilisers == 0.0
    if not own:
        std = regime.stabilisers
        weak = tuple(
            replace(s, rest=_RESTS.get(without_side(s.joint), s.rest), std=std, std_above=std)
            for s in subject.stabilisers
        )
        subject = replace(subject, stabilisers=weak)
    body, camera, rng = Body(subject), _camera(), np.random.default_rng(pose)
    q = _bent(body, rng)
    points = body.landmarks(body.at(q))
    pixels = camera.project(points)[None] + regime.noise * rng.normal(size=(1, len(points), 2))
    confidence = np.array([[float(name not in UNSEEN[seen]) for name in body.landmark_names]])
    observation = Observation(0, 0.0, (camera,), pixels, confidence)
    sigma = np.full(confidence.shape, regime.noise)
    terms: list[Term] = [Reprojection(body, observation, sigma, regime.potential, NU)]
    terms.append(Stabilisers(body, potential="lorentzian" if own else "gaussian"))
    if body.subject.upright is not None:
        terms.append(GravityPrior(body, UP))
    cost = Cost(body, terms)
    return _solved(body, cost, q, camera)


def _solved(body: Body, cost: Cost, q: np.ndarray, camera: Camera) -> Problem:
    mode = Seeker(body, SEARCH).seek(cost, q)
    quadratic = cost.of(mode.quadratic.posed, exact=True)  # positive at a minimum: the paper's inverse Hessian
    covariance = mode_covariance(body, mode.q, quadratic.gradient, quadratic.hessian, max_std=np.inf)
    free = free_directions(body, mode.q, quadratic.gradient)
    values, vectors = np.linalg.eigh(covariance[np.ix_(free, free)])
    axes = np.zeros((body.nv, len(free)))
    axes[free] = vectors[:, ::-1]
    return Problem(body, cost, mode, covariance, np.sqrt(values[::-1]), axes, camera)


def _bent(body: Body, rng: np.random.Generator) -> np.ndarray:
    """Joints at random about rest, less where the range is less than a radian; the root at the origin."""
    q, i = body.neutral.copy(), body.bounded_q
    q[i] += BEND * np.minimum(1.0, body.upper[i] - body.lower[i]) * rng.normal(size=len(i))
    return body.clamp(q)


def _camera() -> Camera:
    """4 m from the world's z axis, 0.3 m above the root, 20 degrees to the left of what the body faces."""
    R_world_camera = pin.utils.rotate("z", np.radians(20.0)) @ np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
    centre = R_world_camera @ np.array([0.0, -0.3, -4.0])
    R_camera_world = R_world_camera.T
    K = np.array([[900.0, 0.0, 480.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
    return Camera("camera", (960, 960), K, np.zeros(5), R_camera_world, -R_camera_world @ centre)
