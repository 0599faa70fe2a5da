"""Laws of assembly: beliefs of single limbs become poses within limits and without overlaps; mistakes are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from builders import body_of, camera_at, random_pose

from estimator.cost.model import CostModel
from estimator.imaging.observation import Observation
from estimator.inference.beliefs.graph import Belief
from estimator.inference.beliefs.space import PLACEMENTS, points_of
from estimator.modes.mixture import Mixture
from estimator.modes.origin import Family
from estimator.search.assembly import AssemblySettings, assembled
from estimator.search.limb_choices import Mistakes
from estimator.search.mode_search import ModeSearch
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from humanoid.subject.example_robots import installed
from humanoid.subject.subject import load_subject

CAMERAS = tuple(camera_at(azimuth) for azimuth in (20.0, 110.0))
MISTAKES = Mistakes(3.0, 0.1, 0.12)


@cache
def search_of(name: str) -> ModeSearch:
    body = body_of(name)
    return ModeSearch(CostModel(body, self_collision=SelfCollision(body)))


@cache
def graph_of(name: str) -> LimbGraph:
    return limb_graph(body_of(name))


def unseen(body: Body) -> Observation:
    """Cameras without keypoints."""
    shape = len(CAMERAS), len(body.landmark_names)
    return Observation(0, 0.0, CAMERAS, np.full((*shape, 2), np.nan), np.zeros(shape))


def about(rng: np.random.Generator, points: np.ndarray, metres: float, radians: float, count: int = 60) -> list[Belief]:
    """Beliefs of normal deviates about points (L, 7)."""
    std = np.repeat([metres, radians], 3)
    spread = std * rng.normal(size=(len(points), count, 6))
    weights = np.full(count, 1.0 / count)
    return [Belief(PLACEMENTS, PLACEMENTS.moved(p[None], e), weights) for p, e in zip(points, spread, strict=True)]


def points_at(name: str, q: np.ndarray) -> np.ndarray:
    return points_of(*limb_placements(graph_of(name), body_of(name), q))


def put_together(name: str, beliefs: Sequence[Belief], **more: object) -> Mixture:
    return assembled(search_of(name), graph_of(name), beliefs, unseen(body_of(name)), **more)  # type: ignore[arg-type]


def away(name: str, a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance [m] of limbs' ends."""
    graph, body = graph_of(name), body_of(name)
    length = np.array([[limb.length] for limb in graph.limbs])
    (t0, R0), (t1, R1) = (limb_placements(graph, body, q) for q in (a, b))
    ends = np.concatenate([t0 - t1, t0 + length * R0[:, :, 2] - t1 - length * R1[:, :, 2]])
    return float(np.linalg.norm(ends, axis=1).max())


class NearTruth:
    """A likelihood that knows where the limbs of a pose are, and nothing else; limb i is like its picture alone."""

    def __init__(self, name: str, q: np.ndarray) -> None:
        self.t, self.R = limb_placements(graph_of(name), body_of(name), q)

    def log_ratio(self, limb: int, t: np.ndarray, R: np.ndarray) -> np.ndarray:
        far = np.sum(np.square(t - self.t[limb]), axis=1) / 0.05**2
        return np.where(far > 400.0, -np.inf, 20.0 - far)


def quiet_pose(name: str, rng: np.random.Generator) -> np.ndarray:
    """A random pose without overlaps."""
    body, collision = body_of(name), search_of(name).self_collision
    while True:
        q = random_pose(body, rng, share=0.6)
        if collision is None or collision.penetration(body.at(q)) == 0.0:
            return q


def within_limits(body: Body, mixture: Mixture) -> bool:
    q = np.array([m.q for m in mixture.modes])
    return bool(np.all(body.lower <= q) and np.all(q <= body.upper))


@pytest.mark.parametrize("name", ["human34", "arm8", "upper13"])
def test_exact_beliefs_are_put_together_from_nothing(name: str) -> None:
    """Floors far below the priors' pull: what is believed decides."""
    rng, sharp = np.random.default_rng(3), AssemblySettings(place_floor=1e-4, turn_floor=1e-3)
    for _ in range(6 if name == "human34" else 3):
        q = quiet_pose(name, rng)
        mixture = put_together(name, about(rng, points_at(name, q), 1e-5, 1e-5), settings=sharp)
        assert away(name, mixture.modes[0].q, q) < 0.003
        assert mixture.modes[0].status == "converged"
        assert mixture.modes[0].origin is not None
        assert mixture.modes[0].origin.family is Family.LIMBS


def test_g1_is_put_together() -> None:
    if "g1" not in installed():
        pytest.skip("robot descriptions are not installed")
    body = Body(load_subject("example-robot-data:g1"))
    graph, search = limb_graph(body), ModeSearch(CostModel(body))
    rng = np.random.default_rng(1)
    q = random_pose(body, rng, share=0.4)
    beliefs = about(rng, points_of(*limb_placements(graph, body, q)), 1e-4, 1e-4)
    best = assembled(search, graph, beliefs, unseen(body), settings=AssemblySettings(1e-3, 1e-2)).modes[0]
    ends = limb_placements(graph, body, best.q)[0] - limb_placements(graph, body, q)[0]
    assert np.linalg.norm(ends, axis=1).max() < 0.01
