"""Feet on a chair are not on the floor, for any weight; feet on the ground are, in any pose."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.retargeting.contacts import lies_below, source_contacts
from estimator.retargeting.motion import mend, problem_of, retarget_motion
from estimator.retargeting.problem import RetargetSettings
from estimator.retargeting.source import SourceMotion
from tests.builders import body_of

FRAMES, RATE = 20, 30.0
QUICK = RetargetSettings(starts=1).frame_by_frame


def posed(
    pitch: float, hips: float, knees: float, *, noise: float = 0.0, size: float = 1.0, arms: float = 0.0
) -> SourceMotion:
    """human34 [deg], its trunk pitched backwards, moving its elbows; the lowest point is at z = 0."""
    body, rng = body_of("human34"), np.random.default_rng(0)
    q = np.tile(body.neutral, (FRAMES, 1))
    q[:, 3:7] = Rotation.from_euler("y", -pitch, degrees=True).as_quat()
    for side in ("left", "right"):
        for name, angle in (("hip_flexion", hips), ("knee_flexion", knees), ("shoulder_flexion", arms)):
            q[:, body.q_names.index(f"{side}_{name}")] = np.radians(angle)
        q[:, body.q_names.index(f"{side}_elbow_flexion")] = 0.6 + 0.3 * np.sin(np.arange(FRAMES) / 5.0)
    points = size * body.landmarks_of(body.placed(q))
    points[..., 2] -= points[..., 2].min()
    points += noise * rng.normal(size=points.shape)
    return SourceMotion(body.landmark_names, points, np.arange(FRAMES) / RATE, "rest.trc")


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(
    ("pitch", "hips", "knees", "size"),
    [
        (90.0, 90.0, 90.0, 1.0),  # on the back, calves on a chair
        (90.0, 60.0, 70.0, 0.6),  # a child, feet on a stool
        (90.0, 85.0, 5.0, 1.0),  # legs against a wall
        (10.0, 85.0, 5.0, 1.0),  # seated, feet on another chair, the hands hang
        (180.0, 0.0, 5.0, 1.1),  # on the hands
    ],
)
def test_feet_above_the_body_are_on_no_floor(
    pitch: float, hips: float, knees: float, size: float, noise: float
) -> None:
    contacts = source_contacts(posed(pitch, hips, knees, noise=noise, size=size))
    assert contacts.floor is None
    assert not contacts.standing.any()
    assert "the body lies lower: they are on no floor" in contacts.note


@pytest.mark.parametrize("size", [0.6, 1.1])
@pytest.mark.parametrize(
    ("pitch", "hips", "knees", "arms"),
    [
        (0.0, 0.0, 5.0, 0.0),  # standing
        (0.0, 90.0, 5.0, 60.0),  # sitting on the ground, hands in front
        (-80.0, 95.0, 10.0, 90.0),  # bent down, hands at the feet
        (20.0, 110.0, 130.0, 60.0),  # squatting
    ],
)
def test_feet_on_the_ground_are(pitch: float, hips: float, knees: float, arms: float, size: float) -> None:
    contacts = source_contacts(posed(pitch, hips, knees, size=size, arms=arms))
    assert contacts.floor == pytest.approx(0.0, abs=0.08)
    assert contacts.standing.any()


def test_standing_then_lying_keeps_the_first_floor() -> None:
    up, down = posed(0.0, 0.0, 5.0), posed(90.0, 90.0, 90.0)
    on_its_back = down.points + np.array([0.0, 0.0, 0.1])
    points = np.concatenate([up.points, *[on_its_back] * 12])
    source = SourceMotion(up.names, points, np.arange(len(points)) / RATE, "falls.trc")
    contacts = source_contacts(source)
    assert contacts.floor == pytest.approx(0.0, abs=0.03)
    assert contacts.standing[2 : FRAMES - 2].any()
    assert not contacts.standing[FRAMES + 2 :].any()


def test_one_hand_below_is_not_much() -> None:
    source = posed(0.0, 0.0, 5.0)
    source.points[:, source.names.index("left_wrist"), 2] = -0.5
    assert not lies_below(source, 0.0)


def test_a_body_without_a_floor_is_followed_in_the_air() -> None:
    source = posed(90.0, 90.0, 90.0)
    made = retarget_motion(body_of("human34"), source, settings=QUICK)
    assert made.targets.scale == pytest.approx(1.0, abs=0.02)
    assert made.targets.feet == ()
    knees = body_of("human34").landmarks_of(body_of("human34").placed(made.q))[:, source.names.index("left_knee")]
    assert np.linalg.norm(knees - source.landmark("left_knee"), axis=1).max() < 0.05


@pytest.mark.parametrize("frames", [1, 2])
@pytest.mark.parametrize("settings", [QUICK, RetargetSettings(starts=1)])
def test_sources_of_a_frame_or_two(frames: int, settings: RetargetSettings) -> None:
    """Even where the first configuration violates its constraints."""
    source = posed(0.0, 90.0, 5.0)
    short = SourceMotion(source.names, source.points[:frames], source.times[:frames], "short.npz")
    made = retarget_motion(body_of("human34"), short, settings=settings, start=body_of("human34").neutral)
    assert made.q.shape == (frames, body_of("human34").nq)
    assert np.isfinite(made.q).all()


@pytest.mark.parametrize("sunk", [0.05, 0.2])
def test_a_frame_alone_is_mended(sunk: float) -> None:
    body, source = body_of("human34"), posed(0.0, 0.0, 5.0)
    alone = SourceMotion(source.names, source.points[:1], source.times[:1], "alone.npz")
    problem = problem_of(body, alone, None, QUICK)
    q = retarget_motion(body, alone, settings=QUICK).q
    q[:, 2] -= sunk
    assert not problem.keeps(0, q[0])
    mended, keeps = mend(problem, q)
    assert keeps.all()
    assert problem.keeps(0, mended[0])


@pytest.mark.parametrize(("noise", "origin"), [(0.04, 0.0), (0.05, -0.9)])
def test_feet_that_never_stand_are_above_a_floor(noise: float, origin: float) -> None:
    """For any origin of the file: with noise no foot is ever still."""
    source = posed(0.0, 20.0, 30.0, noise=noise)
    source.points[..., 2] += origin
    contacts = source_contacts(source)
    assert not contacts.standing.any()
    assert contacts.floor == pytest.approx(origin, abs=0.12)
    assert "as none stands" in contacts.note
