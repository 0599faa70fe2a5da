"""A maker of every term of the energy: body, term, and a configuration at which it is not zero."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from builders import BROWN, body_of, camera_at, observe, random_pose

from estimator.data.cameras.camera import Camera, parallel_camera
from estimator.data.observation import LiftedPose, Observation
from estimator.energy.balance import Balance, MassSpread
from estimator.energy.interpenetration import AboveFloor, Interpenetration
from estimator.energy.lifted import lifted_directions
from estimator.energy.limb_targets import LimbPull, LimbTargets
from estimator.energy.point_targets import PointTargets
from estimator.energy.pose_prior import PosePrior, load_mixture
from estimator.energy.priors import GravityPrior, Stabilisers, Transition, world_up
from estimator.energy.reprojection import Reprojection
from estimator.energy.standing import LevelFeet, Soles
from estimator.energy.term import Term
from estimator.inference.beliefs.space import PLACEMENTS, points_of
from estimator.numerics.robust import POTENTIALS
from estimator.tracking.smoothing.filtered_mode import FilteredMode
from estimator.tracking.smoothing.readings import TrunkSide
from estimator.vision.cues.assigned import AssignedPoints, Assignments
from humanoid.collision.floor import FloorDistances
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import limb_placements, limbs_on_joints
from humanoid.shape.segment_masses import mass_points

CAMERAS = (camera_at(20.0, distortion=BROWN), camera_at(110.0, focal=500.0))
MIXED = (CAMERAS[0], parallel_camera("flat", (640, 480), 180.0, np.array([0.0, 0.0, 0.1]), azimuth=1.9))
Made = tuple[Body, Term, np.ndarray]


def evaluated(term: Term, body: Body, q: np.ndarray, exact: bool = False) -> tuple[float, np.ndarray, np.ndarray]:
    gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
    return term.accumulate(body.at(q), gradient, hessian, exact), gradient, hessian


def observed(
    body: Body, rng: np.random.Generator, noise: float = 8.0, cameras: tuple[Camera, ...] = CAMERAS
) -> Observation:
    """Noisy keypoints of a random pose, some of them missing."""
    seen = observe(body, random_pose(body, rng, share=0.6, turn=0.4), cameras, noise=noise, rng=rng)
    seen.pixels[0, 3] = np.nan
    seen.confidence[0, 3] = 0.0
    seen.confidence[1] = rng.uniform(0.2, 1.0, size=len(body.landmark_names))
    return seen


def reprojection(
    name: str, potential: str, cameras: tuple[Camera, ...] = CAMERAS
) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        seen = observed(body, rng, cameras=cameras)
        sigma = rng.uniform(5.0, 15.0, size=seen.confidence.shape)
        return body, Reprojection(body, seen, sigma, potential, 6.0), random_pose(body, rng, share=0.6, turn=0.4)

    return make


def stabilisers(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        return body, Stabilisers(body, 1.7, potential), random_pose(body, rng)

    return make


def transition(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        std = rng.uniform(0.1, 1.0, size=body.nv)
        return (
            body,
            Transition(body, random_pose(body, rng, turn=1.0), std, potential),
            random_pose(body, rng, turn=1.0),
        )

    return make


def interpenetration(rng: np.random.Generator) -> Made:
    body = body_of("human34")
    term = Interpenetration(SelfCollision(body), scale=0.01)
    while True:
        q = random_pose(body, rng)
        if evaluated(term, body, q)[0] > 0.5:
            return body, term, q


def upright(potential: str) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of("human34")
        return body, GravityPrior(body, world_up(CAMERAS), 1.3, potential), random_pose(body, rng)

    return make


def pose_prior(weight: float) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of("human34")
        mixture = load_mixture()
        q = body.neutral.copy()  # between captured poses, where several components pull
        place = [body.model.idx_qs[body.model.getJointId(name)] for name in mixture.joints]
        q[place] = rng.dirichlet(np.ones(2 * len(mixture.weight))) @ mixture.both_sides()[1]
        return body, PosePrior(body, mixture, weight), body.clamp(q)

    return make


def assigned(potential: str) -> Callable[[np.random.Generator], Made]:
    """Several features a point, points out of order, some without any, in a camera with distortion."""

    def make(rng: np.random.Generator) -> Made:
        body, camera, count = body_of("human34"), CAMERAS[0], 60
        joint, local = rng.integers(1, body.njoints, 20), rng.normal(0.0, 0.1, (20, 3))
        q = random_pose(body, rng, share=0.6, turn=0.4)
        posed = body.at(q)
        world = np.einsum("nij,nj->ni", posed.rotations[joint], local) + posed.translations[joint]
        point, root = rng.integers(1, 20, count), rng.normal(size=(count, 2, 2))
        W = root @ root.transpose(0, 2, 1) / 400.0
        features = Assignments(
            point, camera.project(world[point]) + rng.normal(0.0, 10.0, (count, 2)),
            np.stack([W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]], axis=1), rng.uniform(0.5, 1.5, count),
            np.full(count, POTENTIALS[potential]), np.full(count, 3.0),
        )  # fmt: skip
        halves = [Assignments(*(a[s] for a in features)) for s in (slice(0, 25), slice(25, None))]
        return body, AssignedPoints(body, camera, joint, local, halves, constant=2.5), q

    return make


def point_targets(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    """Three landmarks, one of which is known in two directions only and another counts half."""

    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        chosen = [0, 2, len(body.landmark_names) - 1]
        factors = rng.normal(size=(3, 3, 3)) * 5.0
        factors[1, :, 2] = 0.0
        target = body.landmarks(body.at(random_pose(body, rng)))[chosen]
        term = PointTargets(
            body, body.landmark_joint[chosen], body.landmark_local[chosen], target,
            factors @ factors.transpose(0, 2, 1), weight=np.array([1.0, 1.0, 0.5]), potential=potential, nu=3.0,
        )  # fmt: skip
        return body, term, random_pose(body, rng)

    return make


def limb_targets(name: str, potential: str) -> Callable[[np.random.Generator], Made]:
    """Every limb, its target known in all directions at once, one of them without weight and another turned by almost
    nothing."""

    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        graph, q = limb_graph(body), random_pose(body, rng)
        target = points_of(*limb_placements(graph, body, random_pose(body, rng)))
        target[0] = PLACEMENTS.moved(points_of(*limb_placements(graph, body, q))[:1], np.full(6, 1e-3))[0]
        factors = rng.normal(size=(len(target), 6, 6)) * 3.0
        weight = rng.uniform(0.3, 1.0, len(target))
        weight[-1] = 0.0
        joint, local = limbs_on_joints(graph, body)
        pull = LimbPull(joint, local, target, factors @ factors.transpose(0, 2, 1), weight, potential, 40.0)
        return body, LimbTargets(body, pull), q

    return make


def level_feet(rng: np.random.Generator) -> Made:
    """A foot that stands, and one that nearly does."""
    body = body_of("human34")
    return body, LevelFeet(body, Soles.of(body), np.array([1.2, 0.3]), world_up(CAMERAS), 0.2), random_pose(body, rng)


def balance(feet: int, held: float) -> Callable[[np.random.Generator], Made]:
    """Over heel and toes of one foot or of both, up not along an axis."""

    def make(rng: np.random.Generator) -> Made:
        body = body_of("human34")
        ends = [f"{side}_{part}" for side in ("left", "right")[:feet] for part in ("heel", "big_toe")]
        support = np.array([body.landmark_names.index(name) for name in ends])
        masses, up = mass_points(body), np.array([0.1, -0.05, 1.0])
        assert masses is not None
        stance = MassSpread(0.6, 0.05, 8.0, held, feet)
        return (
            body,
            Balance(body, support, masses[:3], up / np.linalg.norm(up), stance, 1.3),
            random_pose(body, rng, share=0.4, turn=0.3),
        )

    return make


def trunk_side(rng: np.random.Generator) -> Made:
    """Shoulders that do not lead far enough beyond the hips."""
    body = body_of("human34")
    ends, about = ([body.landmark_names.index(f"{s}_{j}") for s in ("left", "right")] for j in ("shoulder", "hip"))
    ray = rng.normal(size=3)
    return body, TrunkSide(body, ends, about, ray / np.linalg.norm(ray), 0.9, 0.05), random_pose(body, rng)


def lifted(name: str, camera: Camera) -> Callable[[np.random.Generator], Made]:
    """The lifted pose differs from the configuration, and a missing keypoint has no lifted position."""

    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        seen = observed(body, rng, cameras=(camera, CAMERAS[1]))
        points = body.landmarks(body.at(random_pose(body, rng, share=0.6, turn=0.4))) @ camera.R_camera_world.T
        seen = replace(
            seen, cameras=(camera,), pixels=seen.pixels[:1], confidence=seen.confidence[1:], lifted=LiftedPose(points)
        )
        (term,) = lifted_directions(body, seen, 0.7)
        return body, term, random_pose(body, rng, share=0.6, turn=0.4)

    return make


def above_floor(nu: float | None) -> Callable[[np.random.Generator], Made]:
    def make(rng: np.random.Generator) -> Made:
        body = body_of("human34")
        q, normal = random_pose(body, rng, share=0.6, turn=0.4), np.array([0.1, -0.05, 1.0])
        normal /= np.linalg.norm(normal)
        lowest = FloorDistances(body, normal, 0.0).near(body.at(q), np.inf).distance.min()
        return body, AboveFloor(FloorDistances(body, normal, float(lowest) + 0.15), 0.05, nu), q

    return make


def filtered_mode(name: str) -> Callable[[np.random.Generator], Made]:
    """Deviations on either side of the bend, and a limit at which the mode has no variance."""

    def make(rng: np.random.Generator) -> Made:
        body = body_of(name)
        q, spread = random_pose(body, rng), rng.normal(scale=0.1, size=(body.nv, body.nv))
        covariance = spread @ spread.T
        covariance[-1] = covariance[:, -1] = 0.0
        moved = body.integrate(q, spread @ rng.normal(size=body.nv))
        return body, FilteredMode(body, q, covariance, 0.8, 0.7), moved

    return make


FAMILY = {
    **{f"upright-{p}": upright(p) for p in POTENTIALS},
    **{f"reprojection-{p}": reprojection("human34", p) for p in POTENTIALS},
    **{f"reprojection-{n}": reprojection(n, "lorentzian") for n in ("arm8", "upper13")},
    "reprojection-parallel": reprojection("upper13", "lorentzian", MIXED),
    **{f"stabilisers-{p}": stabilisers("human34", p) for p in POTENTIALS},
    **{f"transition-{p}": transition("human34", p) for p in POTENTIALS},
    "transition-arm8": transition("arm8", "leclerc"),
    "interpenetration": interpenetration,
    "level-feet": level_feet,
    "balance": balance(2, 0.1),
    "trunk-side": trunk_side,
    **{f"filtered-mode-{name}": filtered_mode(name) for name in ("human34", "arm8", "gripper")},
    "balance-one-foot": balance(1, 0.6),
    "above-known-floor": above_floor(None),
    "above-floor": above_floor(64.0),
    "pose-prior": pose_prior(0.7),
    **{f"assigned-{p}": assigned(p) for p in ("lorentzian", "leclerc")},
    **{f"point-targets-{p}": point_targets("human34", p) for p in POTENTIALS},
    **{f"lifted-{name}": lifted(name, CAMERAS[0]) for name in ("human34", "upper13")},
    "lifted-parallel": lifted("human34", MIXED[1]),
    "point-targets-arm8": point_targets("arm8", "lorentzian"),
    **{f"limb-targets-{p}": limb_targets("human34", p) for p in POTENTIALS},
    "limb-targets-arm8": limb_targets("arm8", "lorentzian"),
    "limb-targets-gripper": limb_targets("gripper", "gaussian"),
}

CURVATURE: dict[str, float | None] = {
    "interpenetration": 1e-3,  # the solids' witness points have few reliable digits
    "above-known-floor": None,  # left out: the curvature of the distance
    "above-floor": None,
    "balance": None,  # left out: the curvature of the kinematics, and of the feet's spread
    "balance-one-foot": None,
    "trunk-side": None,  # left out: the curvature of the kinematics
    **{f"filtered-mode-{name}": 0.3 for name in ("human34", "gripper")},  # the same
    **{f"transition-{p}": 0.3 for p in POTENTIALS},  # left out: the curvature of the difference of two orientations
}
"""Accuracy of the exact Hessian where it is below the default; see `kinemode.testing.check_term`."""
