"""Known answers: poses found again from their projections, and every way a limb can be seen in one picture.

In one picture a segment that leans towards the camera looks like one that leans away (Lee and Chen 1985; CSS
section 1). For an arm with the shoulder known there are up to four such solutions, which are worked out here in closed
form: the elbow is one of two points of its ray at the upper arm's length from the shoulder, the wrist one of two at
the forearm's length from that elbow.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from builders import BROWN, bent, body_of, camera_at, inside, observe, random_pose

from estimator.data.cameras.camera import Camera
from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.descent.seek import Seeker
from estimator.energy.descent.solution import Solution, mode_covariance
from estimator.inference.mixture import body_size
from estimator.search.cost_model import CostModel
from estimator.search.cost_terms import CostSettings
from estimator.search.first_pose import random_configuration
from estimator.search.frame_search import FrameProblem
from estimator.search.hypothesis import Hypothesis
from estimator.search.mode_search import ModeSearch
from estimator.search.proposals import CovarianceScaledProposal
from estimator.search.settings import ModeSearchSettings
from humanoid.kinematics.body import Body

LIMB = ("left_shoulder", "left_elbow", "left_wrist")
BARE = CostSettings(stabiliser_weight=0.0, interpenetration_weight=0.0)
WEAK = CostSettings(stabiliser_weight=0.02, interpenetration_weight=0.0)
SCALE = 6.0
AROUND = tuple(camera_at(a, distance=3.0, aim=(0.0, 0.2, 0.2)) for a in (0.0, 80.0, 200.0))


@pytest.mark.parametrize("seed", range(6))
def test_a_pose_is_found_again_from_two_cameras(seed: int) -> None:
    body, rng = body_of("human34"), np.random.default_rng(seed)
    truth = random_pose(body, rng, share=0.5, turn=np.pi)
    cameras = (camera_at(20.0, distortion=BROWN), camera_at(110.0))
    model = CostModel(body, BARE)
    cost = model.cost(model.observation_term(observe(body, truth, cameras)))
    start = body.integrate(truth, rng.normal(scale=0.25, size=body.nv))
    solution = Seeker(body).seek(cost, start)
    assert solution.status == "converged"
    assert solution.kkt_residual < 1e-6
    missed = np.linalg.norm(body.landmarks(body.at(solution.q)) - body.landmarks(body.at(truth)), axis=1)
    assert missed.max() < 1e-3


def other_depth(
    camera: Camera, centre: np.ndarray, point: np.ndarray, length: float, nearer: bool
) -> np.ndarray | None:
    """The point of `point`'s ray at `length` from `centre`, on the near or the far side; None if the ray misses."""
    ray = point - camera.centre_world
    ray /= np.linalg.norm(ray)
    along = ray @ (centre - camera.centre_world)
    reach = length**2 - np.sum(np.square(centre - camera.centre_world)) + along**2
    return None if reach <= 0.0 else camera.centre_world + (along + (-1.0 if nearer else 1.0) * np.sqrt(reach)) * ray


def limb_only(body: Body, points: np.ndarray, cameras: tuple[Camera, ...]) -> Observation:
    """Projections of the limb's three joints (3, 3) [m], nothing else seen."""
    pixels = np.full((len(cameras), len(body.landmark_names), 2), np.nan)
    pixels[:, limb_index(body)] = [camera.project(points) for camera in cameras]
    return Observation(0, 0.0, cameras, pixels, np.isfinite(pixels[..., 0]).astype(float))


def limb_index(body: Body) -> list[int]:
    return [body.landmark_names.index(name) for name in LIMB]


def limb_points(body: Body, q: np.ndarray) -> np.ndarray:
    return np.asarray(body.landmarks(body.at(q))[limb_index(body)])


def pose_at(body: Body, points: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
    """A pose within the limits whose limb is at `points`, by cameras all around; None if there is none."""
    model = CostModel(body, CostSettings(stabiliser_weight=1e-4, interpenetration_weight=0.0))
    cost = model.cost(model.observation_term(limb_only(body, points, AROUND)))
    for _ in range(12):
        q = Seeker(body).seek(cost, random_configuration(rng, body)).q
        if np.linalg.norm(limb_points(body, q) - points, axis=1).max() < 2e-3:
            return q
    return None


def known_solutions(body: Body, truth: np.ndarray, camera: Camera, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Poses of every forward or backward solution of the arm within the limits."""
    s, e, w = limb_points(body, truth)
    upper, fore = np.linalg.norm(e - s), np.linalg.norm(w - e)
    poses = {}
    for near_elbow, near_wrist in product((False, True), repeat=2):
        elbow = other_depth(camera, s, e, upper, near_elbow)
        wrist = None if elbow is None else other_depth(camera, elbow, w, fore, near_wrist)
        q = None if elbow is None or wrist is None else pose_at(body, np.array([s, elbow, wrist]), rng)
        if q is not None:
            poses[f"elbow {'near' if near_elbow else 'far'}, wrist {'near' if near_wrist else 'far'}"] = q
    return poses


class Arm:
    """One picture of an arm, and the known modes of its energy."""

    def __init__(self, camera: Camera, **angles: float) -> None:
        self.body, self.camera = body_of("arm8"), camera
        self.truth = bent(self.body, **angles)
        self.model = CostModel(self.body, WEAK)
        observation = limb_only(self.body, limb_points(self.body, self.truth), (camera,))
        self.search = ModeSearch(self.model, ModeSearchSettings(exchange=False))
        self.associations = self.search.associations(observation)
        self.cost: Cost = self.model.cost(self.associations[0].term)
        self.solutions = known_solutions(self.body, self.truth, camera, np.random.default_rng(61))

    def modes(self) -> dict[str, Solution]:
        """Each solution, descended to the minimum of the picture's energy."""
        return {name: Seeker(self.body).seek(self.cost, q) for name, q in self.solutions.items()}


def arm_seen_from_the_side() -> Arm:
    """All four solutions are possible."""
    return Arm(
        camera_at(80.0, distance=3.0, aim=(0.0, 0.2, 0.2)),
        left_shoulder_elevation=0.6, left_shoulder_flexion=0.5, left_shoulder_rotation=0.0, left_elbow_flexion=0.8,
    )  # fmt: skip


def arm_seen_from_the_front() -> Arm:
    """Three are possible: with the elbow in front, the wrist cannot lean back."""
    return Arm(
        camera_at(0.0, distance=3.0, aim=(0.0, 0.2, 0.2)),
        left_shoulder_elevation=0.4, left_shoulder_flexion=0.5, left_shoulder_rotation=0.3, left_elbow_flexion=0.9,
    )  # fmt: skip


ARMS = {"four": arm_seen_from_the_side, "three": arm_seen_from_the_front}


@pytest.fixture(params=ARMS, scope="module")
def arm(request: pytest.FixtureRequest) -> Arm:
    return ARMS[request.param]()


@pytest.mark.parametrize(("name", "count"), [("four", 4), ("three", 3)])
def test_the_known_set(name: str, count: int) -> None:
    arm = ARMS[name]()
    assert len(arm.solutions) == count
    nearest = [
        np.linalg.norm(limb_points(arm.body, q) - limb_points(arm.body, arm.truth), axis=1).max()
        for q in arm.solutions.values()
    ]
    assert min(nearest) < 2e-3  # the pose photographed is one of them


def test_solutions_look_alike_and_are_modes(arm: Arm) -> None:
    """Each is a minimum with nearly the same picture, at its computed place, and no two are equal."""
    pixels = arm.camera.project(limb_points(arm.body, arm.truth))
    shapes = []
    for name, solution in arm.modes().items():
        assert solution.status == "converged", name
        assert solution.kkt_residual < 1e-6
        assert inside(arm.body, solution.q)
        points = limb_points(arm.body, solution.q)
        assert np.abs(arm.camera.project(points) - pixels).max() < 0.05
        assert np.linalg.norm(points - limb_points(arm.body, arm.solutions[name]), axis=1).max() < 0.005
        shapes.append(points)
    apart = [np.linalg.norm(a - b, axis=1).max() for i, a in enumerate(shapes) for b in shapes[:i]]
    assert min(apart) > 0.07


def samples(arm: Arm, modes: list[np.ndarray], rng: np.random.Generator, count: int) -> list[Hypothesis]:
    """`count` wide covariance-scaled samples about every mode, and the modes themselves."""
    hypotheses = [Hypothesis(q, 0) for q in modes]
    for q in modes:
        model = arm.cost.at(q)
        covariance = mode_covariance(arm.body, q, model.gradient, model.hessian)
        proposal = CovarianceScaledProposal(arm.body, q, covariance, SCALE)
        hypotheses += [Hypothesis(proposal.sample(rng), 0) for _ in range(count)]
    return hypotheses


def test_sampling_finds_every_solution(arm: Arm) -> None:
    """From each solution alone, a few rounds of sampling about the modes found so far reach all of the known set."""
    body, known = arm.body, arm.modes()
    same = arm.search.settings.distinct * body_size(body)
    for first in known.values():
        rng, modes = np.random.default_rng(62), [first.q]
        for _ in range(6):
            mixture = arm.search.best_modes(samples(arm, modes, rng, 60), FrameProblem(arm.associations), 8)
            modes = [m.q for m in mixture.modes]
        points = [limb_points(body, q) for q in modes]
        for name, mode in known.items():
            nearest = min(np.linalg.norm(f - limb_points(body, mode.q), axis=1).max() for f in points)
            assert nearest < 0.1 * same, name
        assert all(m.status == "converged" and m.kkt_residual < 1e-6 for m in mixture.modes)
        assert inside(body, np.array(modes))
