"""Standing feet are held in one place while smoothing, others are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import body_of, camera_at, observe

from estimator.data.observation import Observation
from estimator.energy.cost import Cost
from estimator.energy.priors import Transition
from estimator.inference.motion import MotionPrior
from estimator.runs.contact import contact_of_points
from estimator.tracking.smoothing import smooth
from estimator.tracking.smoothing.stances import Stances, held_places
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import foot_landmarks

STD = 0.01  # m
FPS = 30.0


def held(body: Body, costs: list[Cost], q: np.ndarray, seen: list[Observation]) -> list[Cost]:
    """Costs with what holds the feet."""
    stances = Stances.of(body, q, seen)
    return costs if stances is None else list(stances.held(body, costs, STD))


def watched(body: Body, q: np.ndarray, times: np.ndarray) -> list[Observation]:
    """Projections of the poses into a camera."""
    camera = camera_at(20.0)
    return [observe(body, x, [camera], index=i, time=float(times[i])) for i, x in enumerate(q)]


@pytest.fixture(scope="module")
def wandering() -> tuple[Body, np.ndarray, np.ndarray]:
    """A standing person whose observations drift and turn a little in every frame."""
    body, times = body_of("human34"), np.arange(60) / FPS
    rng = np.random.default_rng(0)
    steps = np.zeros((len(times), body.nv))
    steps[:, :2] = 0.03 * times[:, None] + 0.004 * rng.normal(size=(len(times), 2))
    steps[:, 6:] = 0.01 * rng.normal(size=(len(times), body.nv - 6))
    return body, np.array([body.clamp(body.integrate(body.neutral, v)) for v in steps]), times


def test_a_stance_has_one_place_and_short_ones_none() -> None:
    times, rng = np.arange(30) / FPS, np.random.default_rng(1)
    points = rng.normal(size=(30, 2, 3))
    standing = np.full((30, 2), 0.01)
    standing[5:20, 0], standing[10:12, 1] = 0.9, 0.8
    seen = np.ones((30, 2), dtype=bool)
    places, weight = held_places(points, standing, seen, times)
    np.testing.assert_allclose(places[5:20, 0], np.tile(np.median(points[5:20, 0], axis=0), (15, 1)))
    np.testing.assert_array_equal(np.flatnonzero(weight[:, 0]), np.arange(5, 20))
    np.testing.assert_array_equal(weight[5:20, 0], 0.9)
    assert not weight[:, 1].any()
    seen[5:8] = False
    np.testing.assert_allclose(held_places(points, standing, seen, times)[1][5:20, 0], 0.9 * 12 / 15)


def test_standing_feet_slide_less(wandering: tuple[Body, np.ndarray, np.ndarray]) -> None:
    body, q, times = wandering
    names = foot_landmarks(body.landmark_names)
    index = [body.landmark_names.index(name) for name in names]
    motion = MotionPrior(np.full(body.nv, 3.0), np.full(body.nv, 30.0))
    seen = [Cost(body, [Transition(body, x, np.full(body.nv, 0.05))]) for x in q]

    def slide(poses: np.ndarray) -> float:
        points = np.array([body.landmarks(body.at(x))[index] for x in poses])
        return max(s.slide for s in contact_of_points(times, names, points).stances)

    free = smooth(body, seen, times, q, motion)
    after = smooth(body, held(body, seen, free, watched(body, q, times)), times, free, motion)
    assert slide(free) > 0.02
    assert slide(after) < 0.3 * slide(free)


def test_a_pull_vanishes_where_feet_are_in_place_and_on_the_floor() -> None:
    body, times = body_of("human34"), np.arange(30) / FPS
    level = pin.neutral(body.model)
    still = np.tile(level, (len(times), 1))
    for cost in held(body, [Cost(body, [])] * len(times), still, watched(body, still, times)):
        gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
        (pull,) = cost.terms
        assert pull.name == "stances"
        assert pull.accumulate(body.at(level), gradient, hessian) == pytest.approx(0.0, abs=1e-9)
        raised = body.integrate(level, np.r_[0.0, 0.0, 0.02, np.zeros(body.nv - 3)])
        assert pull.value(body.at(raised)) > 1.0


def test_a_body_without_feet_is_left_alone() -> None:
    body = body_of("arm8")
    costs, q = [Cost(body, []) for _ in range(4)], np.tile(body.neutral, (4, 1))
    assert held(body, costs, q, watched(body, q, np.arange(4) / FPS)) == costs


def test_an_unseen_foot_is_left_alone(wandering: tuple[Body, np.ndarray, np.ndarray]) -> None:
    body, q, times = wandering
    feet = [body.landmark_names.index(name) for name in foot_landmarks(body.landmark_names)]
    unseen = []
    for observation in watched(body, q, times):
        confidence = observation.confidence.copy()
        confidence[:, feet] = 0.0
        unseen.append(replace(observation, confidence=confidence))
    costs = [Cost(body, []) for _ in times]
    assert held(body, costs, q, unseen) == costs
