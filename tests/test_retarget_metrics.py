"""Figures of a robot's motion: known faults are measured as their size."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from estimator.retargeting.contacts import SourceContacts
from estimator.retargeting.likeness import LIMBS, leg_ratio, likeness_of
from estimator.retargeting.metrics import RetargetMeter, RetargetMetrics, slips_of
from estimator.retargeting.source import SourceMotion
from humanoid.collision.floor import FloorDistances
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_PLACE_Q, Body
from humanoid.subject.example_robots import installed
from tests.builders import body_of

FRAMES, RATE = 31, 30.0
TIMES = np.arange(FRAMES) / RATE
SOLES = ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
ELBOW = "left_elbow_joint"


@pytest.fixture(scope="module")
def body() -> Body:
    if "g1" not in installed():
        pytest.skip("example-robot-data is not installed")
    return body_of("example-robot-data:g1")


@cache
def meter_of(body: Body) -> RetargetMeter:
    return RetargetMeter(body)


def still(body: Body) -> np.ndarray:
    """Standing on the floor at z = 0 (T, nq)."""
    q = np.tile(body.neutral, (FRAMES, 1))
    up = np.array([0.0, 0.0, 1.0])
    q[:, 2] -= FloorDistances(body, up, 0.0).lowest(body.placed(q[:1]))[0]
    return q


def source_of(body: Body, q: np.ndarray) -> SourceMotion:
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    return SourceMotion(body.landmark_names, points, TIMES[: len(q)], "a.npz")


def standing(frames: int = FRAMES) -> SourceContacts:
    return SourceContacts(SOLES, SOLES, np.ones((frames, 4), dtype=bool), 0.0, np.zeros(4))


def measured(body: Body, q: np.ndarray) -> RetargetMetrics:
    return meter_of(body).metrics(q, TIMES[: len(q)], source=source_of(body, q), contacts=standing(len(q)))


def test_standing_still_has_no_faults(body: Body) -> None:
    m = measured(body, still(body))
    assert m.frames == FRAMES
    assert m.near == 1.0
    zero = {name: value for name, value in m._asdict().items() if name not in ("frames", "near")}
    assert zero == pytest.approx(dict.fromkeys(zero, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("by", "below", "deepest", "near"), [(0.03, 0, 0, 0), (-0.03, 1, 0.03, 0), (-0.004, 0, 0.004, 1)]
)
def test_a_body_that_floats_or_sinks(body: Body, by: float, below: float, deepest: float, near: float) -> None:
    q = still(body)
    q[:, 2] += by
    m = measured(body, q)
    assert (m.below_floor, m.near, m.penetrating) == (below, near, float(by < 0.0))
    assert m.deepest == pytest.approx(deepest, abs=1e-6)
    without = meter_of(body).metrics(q, TIMES, contacts=standing(), floor=None)
    assert np.isnan([without.deepest, without.below_floor, without.penetrating]).all()
    assert np.isnan(without.near)


@pytest.mark.parametrize(("speed", "skating"), [(0.2, 0.0), (0.6, 1.0)])
def test_feet_that_slide(body: Body, speed: float, skating: float) -> None:
    """1 cm in 1/30 s is 0.3 m/s."""
    q = still(body)
    q[:, ROOT_PLACE_Q] += speed * TIMES[:, None] * [0.6, 0.8, 0.0]
    m = measured(body, q)
    assert m.slip == pytest.approx(speed, rel=1e-3)
    assert m.median_slip == pytest.approx(speed, rel=1e-3)
    assert m.skating == skating
    contacts = replace(standing(), standing=np.repeat(TIMES[:, None] < 0.45, 4, axis=1))
    assert meter_of(body).metrics(q, TIMES, contacts=contacts).slip == pytest.approx(speed * 13 / 30, rel=1e-3)


def test_slips_are_counted_per_stance() -> None:
    points, stands = np.zeros((10, 2, 3)), np.ones((10, 2), dtype=bool)
    points[:, 0, 0] = [0, 0.01, 0.03, 0, 5, 5, 5, 5, 5.02, 9]
    stands[[4, 9], 0] = False
    points[:, 1, 2] = np.arange(10)  # upward motion is not along the floor
    assert slips_of(points, stands) == pytest.approx([0.03, 0.02, 0.0], abs=1e-5)
    assert len(slips_of(points[:1], stands[:1])) == 0


@pytest.mark.parametrize("share", [0.5, 1.5])
def test_a_joint_at_a_known_rate(body: Body, share: float) -> None:
    q, i = still(body)[:4], body.q_names.index(ELBOW)
    limit = body.model.velocityLimit[body.v_names.index(ELBOW)]
    q[:, i] = share * limit * np.array([0.0, 1.0, 0.0, 0.0]) / RATE
    m = meter_of(body).metrics(q, TIMES[:4])
    assert m.speed_ratio == pytest.approx(share)
    assert m.too_fast == pytest.approx(2.0 / 3.0 if share > 1.0 else 0.0)


def test_the_root_has_no_limit(body: Body) -> None:
    q = still(body)
    q[:, 0] += 100.0 * TIMES
    assert meter_of(body).metrics(q, TIMES).speed_ratio == 0.0


def test_a_joint_beyond_its_limit(body: Body) -> None:
    q, i = still(body), body.q_names.index(ELBOW)
    q[:, i] = body.upper[i]
    q[5:9, i] += 0.1
    m = meter_of(body).metrics(q, TIMES)
    assert m.over_limits == pytest.approx(4 / FRAMES)
    assert m.furthest_over == pytest.approx(0.1)


def test_a_constant_acceleration(body: Body) -> None:
    q = still(body)
    q[:, body.q_names.index(ELBOW)] = 0.5 * np.square(TIMES)
    m = meter_of(body).metrics(q, TIMES)
    assert m.acceleration == pytest.approx(1.0 / np.sqrt(body.nv - 6))
    assert m.jerk == pytest.approx(0.0, abs=1e-6)


def test_parts_that_overlap(body: Body) -> None:
    q, i = still(body), body.q_names.index("left_hip_roll_joint")
    q[:10, i] = body.lower[i]
    m = meter_of(body).metrics(q, TIMES)
    deepest = SelfCollision(body).penetration(body.at(q[0]))
    assert deepest > 0.001
    assert m.overlap == pytest.approx(deepest)
    assert m.colliding == pytest.approx(10 / FRAMES)


def test_a_limb_turned_by_a_known_angle(body: Body) -> None:
    q = still(body)
    source = source_of(body, q)
    elbow, wrist = (source.names.index(f"left_{part}") for part in ("elbow", "wrist"))
    way = source.points[:, wrist] - source.points[:, elbow]
    across = np.cross(way, [0.0, 1.0, 0.3])
    across *= np.linalg.norm(way, axis=1, keepdims=True) / np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.radians(25.0)
    source.points[:, wrist] = source.points[:, elbow] + np.cos(angle) * way + np.sin(angle) * across
    m = meter_of(body).metrics(q, TIMES, source=source)
    assert m.worst_limb_angle == pytest.approx(25.0)
    assert m.limb_angle == pytest.approx(25.0 / len(LIMBS))
    source.points[3:, wrist] = np.nan
    alike = meter_of(body).metrics(q, TIMES, source=source)
    assert alike.worst_limb_angle == pytest.approx(25.0)
    assert alike.limb_angle == pytest.approx(25.0 * 3 / (len(LIMBS) * FRAMES - (FRAMES - 3)))


def test_the_path_of_the_root_is_scaled(body: Body) -> None:
    q = still(body)
    q[:, 0] += TIMES
    landmarks = source_of(body, q).points
    source = replace(source_of(body, q), points=2.0 * landmarks + 0.7)
    near = likeness_of(body, landmarks, source)
    assert leg_ratio(body, source) == pytest.approx(0.5)
    assert (near.mean, near.root_rms, near.root_worst) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    off = landmarks.copy()
    off[1:, :, 1] += 0.05
    near = likeness_of(body, off, source)
    assert near.root_worst == pytest.approx(0.05)
    assert near.root_rms == pytest.approx(0.05 * np.sqrt(30 / 31))
    assert likeness_of(body, landmarks, source, scale=1.0).root_worst == pytest.approx(1.0)


def test_what_cannot_be_judged_is_nan(body: Body) -> None:
    m = meter_of(body).metrics(still(body)[:1], TIMES[:1])
    for name in ("too_fast", "speed_ratio", "slip", "skating", "near", "limb_angle", "root_rms", "jerk"):
        assert np.isnan(getattr(m, name)), name
    source = SourceMotion(("left_wrist",), np.zeros((1, 1, 3)), TIMES[:1], "a.npz")
    assert np.isnan(meter_of(body).metrics(still(body)[:1], TIMES[:1], source=source).root_rms)
