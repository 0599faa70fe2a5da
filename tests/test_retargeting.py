"""Retargeted motions: they respect limits, velocities, stances, parts and floor, and resemble the source."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.retargeting.independence import deviation_between, independence_of
from benchmarks.retargeting.pace import pace_of
from estimator.retargeting.correspondence import common_correspondence
from estimator.retargeting.following import searched
from estimator.retargeting.motion import RetargetedMotion, problem_of, retarget_motion
from estimator.retargeting.problem import MotionProblem, RetargetSettings, parts_of
from estimator.retargeting.source import SourceMotion
from estimator.retargeting.stances import stretches
from estimator.retargeting.streaming import LiveFrame, MotionStream
from estimator.synthesis.motion import authored_motion
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import ROOT_PLACE_Q, Body, points_in_world
from humanoid.subject.example_robots import installed
from tests.builders import body_of, inside, random_pose

RATE = 30.0
HUMAN, G1, PANDA = "human34", "example-robot-data:g1", "example-robot-data:panda"
UP = np.array([0.0, 0.0, 1.0])
MM = 1e-3
SLOW = RetargetSettings(velocity=0.2)
"""So slow that the velocities bind."""


def robot(name: str) -> Body:
    if name.rpartition(":")[2] not in (HUMAN, *installed()):
        pytest.skip("example-robot-data is not installed")
    return body_of(name)


def landmarks_of(body: Body, q: np.ndarray, times: np.ndarray) -> SourceMotion:
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    return SourceMotion(body.landmark_names, points, times, "own")


@cache
def steps() -> SourceMotion:
    """human34 taking two steps."""
    times = np.arange(75) / RATE
    return landmarks_of(body_of(HUMAN), authored_motion(body_of(HUMAN), times), times)


def part_of(source: SourceMotion, first: int, after: int) -> SourceMotion:
    return replace(source, points=source.points[first:after], times=source.times[first:after])


@cache
def problem() -> MotionProblem:
    return problem_of(body_of(HUMAN), part_of(steps(), 0, 40), None, RetargetSettings())


@cache
def walked(velocity: float = 1.0, rounds: int = 2) -> RetargetedMotion:
    return retarget_motion(body_of(HUMAN), steps(), settings=RetargetSettings(velocity=velocity, rounds=rounds))


def check_laws(body: Body, q: np.ndarray, times: np.ndarray, velocity: float) -> None:
    """Joints within limits and velocities; parts clear of each other and of the floor at z = 0."""
    assert inside(body, q)
    limit = body.model.velocityLimit[body.first_joint_dof :]
    steps = np.array([body.difference(a, b)[body.first_joint_dof :] for a, b in pairwise(q)])
    assert (np.abs(steps) <= velocity * limit * np.diff(times)[:, None]).all()
    lowest = FloorDistances(body, UP, 0.0).lowest(body.placed(q))
    assert lowest.min() >= -MM
    parts = parts_of(body, 0.0)
    assert max(parts.penetration(body.at(pose)) for pose in q) <= MM


def check_stances(body: Body, motion: RetargetedMotion) -> None:
    """Each heel and toe has one place on the floor while it stands."""
    stances = 0
    for number, foot in enumerate(motion.targets.feet):
        joint = np.full(3, foot.joint)
        points = np.array([points_in_world(body.at(pose), joint, foot.local) for pose in motion.q])
        for point in range(2):
            for first, after in stretches(motion.stands[:, number, point]):
                where = points[first:after, point]
                assert np.abs(where[:, 2]).max() < MM
                middle = 0.5 * (where.min(axis=0) + where.max(axis=0))
                assert np.linalg.norm(where - middle, axis=1).max() < MM
                stances += 1
    assert stances > 3


def angles_between(a: SourceMotion, b: SourceMotion) -> np.ndarray:
    """Angles (T, limbs) [deg] between the limbs of two motions with the same landmarks."""
    angles = []
    for limb in common_correspondence(a.names, b.names).limbs:
        ways = [
            np.mean([m.landmark(n) for n in limb.source_to], axis=0)
            - np.mean([m.landmark(n) for n in limb.source_from], axis=0)
            for m in (a, b)
        ]
        u, v = (way / np.linalg.norm(way, axis=1, keepdims=True) for way in ways)
        angles.append(np.degrees(np.arccos(np.clip((u * v).sum(axis=1), -1.0, 1.0))))
    return np.array(angles).T


def hips(motion: SourceMotion) -> np.ndarray:
    return np.asarray(0.5 * (motion.landmark("left_hip") + motion.landmark("right_hip")))


# --- the energy of a frame ---


def test_the_gradient_is_that_of_the_value() -> None:
    body, rng, h = body_of(HUMAN), np.random.default_rng(0), 1e-5
    for t in (0, 20):
        q = random_pose(body, rng, share=0.8)
        model = problem().model(t, q)
        numeric = np.empty(body.nv)
        for i, step in enumerate(h * np.eye(body.nv)):
            ahead, back = (problem().model(t, pin.integrate(body.model, q, s * step)).value for s in (1.0, -1.0))
            numeric[i] = (ahead - back) / (2.0 * h)
        assert model.gradient == pytest.approx(numeric, rel=1e-5, abs=1e-5 * np.abs(numeric).max())
        assert model.hessian == pytest.approx(model.hessian.T, rel=1e-12)
        assert np.linalg.eigvalsh(model.hessian).min() > -1e-9 * np.abs(model.hessian).max()


def test_the_value_sums_directions_places_and_rest() -> None:
    """At rest the joints contribute nothing: half the squared errors over their deviations."""
    body, targets = body_of(HUMAN), problem().targets
    posed = body.at(body.neutral)
    off = targets.combination @ points_in_world(posed, targets.joint, targets.local) - targets.target[0]
    count = 3 * len(targets.feet)
    off[-count:] += targets.target[0, -count:] - problem().stances.place[0].reshape(-1, 3)
    value = 0.5 * float((targets.weight[0] * np.square(off).sum(axis=1)).sum())
    assert problem().model(0, body.neutral).value == pytest.approx(value)


# --- whole motions ---


def test_a_bodys_own_motion_comes_back() -> None:
    """A weak pull to rest leaves the pose of the landmarks; the retargeted motion stands on level feet."""
    body = body_of(HUMAN)
    own = landmarks_of(body, walked().q, steps().times)
    again = retarget_motion(body, own, settings=RetargetSettings(rest=10.0))
    back = landmarks_of(body, again.q, own.times)
    angles = angles_between(own, back)
    assert angles.mean() < 1.0
    assert angles.max() < 6.0
    assert np.linalg.norm(hips(own) - hips(back), axis=1).max() < 0.01
    assert again.targets.scale == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("rounds", "velocity"), [(2, 1.0), (2, 0.2), (0, 1.0), (0, 0.3)])
def test_the_laws_of_a_person(rounds: int, velocity: float) -> None:
    body, motion = body_of(HUMAN), walked(velocity, rounds)
    check_laws(body, motion.q, motion.times, velocity)
    check_stances(body, motion)
    assert motion.keeps.all()
    if velocity < 1.0:
        limit = body.model.velocityLimit[body.first_joint_dof :]
        moved = np.diff(motion.q[:, body.first_joint_dof + 1 :], axis=0)
        assert (np.abs(moved) * RATE / (velocity * limit)).max() > 0.98


@pytest.mark.parametrize("rounds", [2, 0], ids=["windows", "frames"])
def test_the_laws_of_a_robot(rounds: int) -> None:
    body, source = robot(G1), part_of(steps(), 10, 40)
    motion = retarget_motion(body, source, settings=RetargetSettings(velocity=0.3, rounds=rounds))
    check_laws(body, motion.q, motion.times, 0.3)
    check_stances(body, motion)
    assert motion.keeps.all()
    assert angles_between(source, landmarks_of(body, motion.q, source.times)).mean() < 12.0


def test_flight_stays_possible() -> None:
    """A jump of 30 cm lasts as long as the source's, and lands on the floor."""
    body = body_of(HUMAN)
    q = np.tile(authored_motion(body, np.zeros(1)), (40, 1))
    height = np.maximum(0.0, 0.3 * (1.0 - np.square((np.arange(40) - 20) / 8.0)))
    q[:, ROOT_PLACE_Q] += height[:, None] * UP
    times = np.arange(40) / RATE
    motion = retarget_motion(body, landmarks_of(body, q, times))
    lowest = FloorDistances(body, UP, 0.0).lowest(body.placed(motion.q))
    assert lowest[15:26] == pytest.approx(motion.targets.scale * height[15:26], abs=0.03)
    assert not motion.stands[15:26].any()
    assert np.abs(lowest[[0, -1]]).max() < MM
    check_stances(body, motion)
    check_laws(body, motion.q, times, 1.0)


def test_a_source_beyond_the_limits_is_followed_to_them() -> None:
    """A forearm that bends backwards by as much as the elbow bends forwards: elbow or shoulder is at its limit."""
    body, source = body_of(HUMAN), part_of(steps(), 0, 15)
    shoulder, elbow, wrist = (source.names.index(f"left_{part}") for part in ("shoulder", "elbow", "wrist"))
    points = source.points.copy()
    along = points[:, elbow] - points[:, shoulder]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    way = points[:, wrist] - points[:, elbow]
    points[:, wrist] = points[:, elbow] + 2.0 * (way * along).sum(axis=1, keepdims=True) * along - way
    motion = retarget_motion(body, replace(source, points=points), settings=RetargetSettings(rest=10.0))
    check_laws(body, motion.q, motion.times, 1.0)
    at = [body.q_names.index(f"left_shoulder_{part}") for part in ("elevation", "flexion", "rotation")]
    at.append(body.q_names.index("left_elbow_flexion"))
    room = np.minimum(motion.q[:, at] - body.lower[at], body.upper[at] - motion.q[:, at])
    assert (room.min(axis=1) < 1e-5).mean() > 0.5


def test_parts_keep_clear_of_each_other() -> None:
    """A hand passing through the trunk stays outside, unless overlaps are allowed."""
    body, source = body_of(HUMAN), part_of(steps(), 0, 15)
    points = source.points.copy()
    middle = np.mean(
        [source.landmark(f"{s}_{part}") for s in ("left", "right") for part in ("hip", "shoulder")], axis=0
    )
    points[:, source.names.index("left_elbow")] = middle + 0.3 * (source.landmark("left_hip") - middle) + 0.1 * UP
    points[:, source.names.index("left_wrist")] = middle
    crossing, parts = replace(source, points=points), parts_of(body, 0.0)
    loose = retarget_motion(body, crossing, settings=RetargetSettings(collisions=False))
    assert max(parts.penetration(body.at(pose)) for pose in loose.q) > 10.0 * MM
    motion = retarget_motion(body, crossing)
    check_laws(body, motion.q, motion.times, 1.0)
    assert motion.overlap.max() <= MM


def test_a_start_outside_the_limits_recovers() -> None:
    body = body_of(HUMAN)
    outside = body.neutral.copy()
    outside[body.bounded_q] = body.upper[body.bounded_q] + 1.0
    assert inside(body, searched(problem(), outside, steps=1)[0])
    motion = retarget_motion(body, part_of(steps(), 0, 20), start=outside)
    check_laws(body, motion.q, motion.times, 1.0)


def test_any_start_leads_to_the_same_motion() -> None:
    body, source, rng = body_of(HUMAN), part_of(steps(), 0, 20), np.random.default_rng(4)
    made = [retarget_motion(body, source, start=random_pose(body, rng, share=0.8)).q for _ in range(4)]
    for q in made[1:]:
        moved = np.array([body.difference(a, b) for a, b in zip(made[0], q, strict=True)])
        assert np.degrees(np.abs(moved[:, 3:]).max()) < 2.0
        assert np.abs(moved[:, :3]).max() < 0.01


def test_equal_seeds_give_equal_motions() -> None:
    """Up to the last digits, which depend on ProxQP's memory alignment."""
    made = [retarget_motion(body_of(HUMAN), part_of(steps(), 0, 12), seed=7) for _ in range(2)]
    assert np.abs(made[0].q - made[1].q).max() < 1e-6


# --- a live motion ---


def streamed(stream: MotionStream, source: SourceMotion) -> list[LiveFrame]:
    out = [stream.step(float(time), points) for time, points in zip(source.times, source.points, strict=True)]
    return [frame for frame in out if frame is not None] + stream.rest()


def stream_of(source: SourceMotion, velocity: float = 1.0) -> MotionStream:
    body = body_of(HUMAN)
    match = common_correspondence(body.landmark_names, source.names)
    return MotionStream(body, source.names, match, RetargetSettings(velocity=velocity), look_ahead=0.2)


def test_a_stream_gives_out_what_comes_in() -> None:
    body, source = body_of(HUMAN), part_of(steps(), 0, 60)
    stream = stream_of(source, 0.3)
    assert [stream.step(float(t), p) for t, p in zip(source.times[:6], source.points[:6], strict=True)] == [None] * 6
    frames = streamed(stream, part_of(source, 6, 60))
    assert [frame.time for frame in frames] == source.times.tolist()
    q = np.array([frame.q for frame in frames])
    check_laws(body, q, source.times, 0.3)
    assert np.mean([frame.keeps for frame in frames]) > 0.95
    angles = angles_between(source, landmarks_of(body, q, source.times))
    assert angles[5:].mean() < 4.0


def test_a_stream_with_gaps_and_late_frames() -> None:
    """At first nothing is observed, then a leg is missing, then everything, and a second passes without a frame."""
    body, source = body_of(HUMAN), part_of(steps(), 0, 40)
    points, times = source.points.copy(), source.times + 100.0
    points[:10] = points[24:26] = np.nan
    points[14:20, [source.names.index(f"left_{part}") for part in ("knee", "ankle", "heel", "big_toe")]] = np.nan
    times[30:] += 1.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        frames = streamed(stream_of(source), replace(source, points=points, times=times))
    assert [frame.time for frame in frames] == times.tolist()
    q = np.array([frame.q for frame in frames])
    assert np.isfinite(q).all()
    check_laws(body, q[12:], times[12:], 1.0)
    assert all(frame.keeps for frame in frames[:12])  # the motion begins where something is seen
    assert angles_between(source, landmarks_of(body, q, times))[26:].mean() < 6.0


# --- what the benchmark measures of it ---


def test_the_deviation_of_motions_is_that_of_their_joints() -> None:
    """By degrees; the root's position does not count."""
    body = body_of(HUMAN)
    q = np.tile(body.neutral, (4, 1))
    other = q.copy()
    other[:, 0] += 1.0
    other[2, body.q_names.index("left_elbow_flexion")] += np.radians(3.0)
    joints = body.nv - body.first_joint_dof
    expected = (3.0 / np.sqrt(4 * joints), 3.0 / np.sqrt(joints), 3.0)
    assert deviation_between(body, q, other) == pytest.approx(expected)


def test_another_beginning_leads_to_the_same_motion() -> None:
    """From a random pose the result is the same; from a later frame nearly so, as floor and contacts are estimated
    again."""
    deviations = independence_of(body_of(HUMAN), part_of(steps(), 0, 45))
    assert list(deviations) == ["frame 10", "frame 20", "random pose 1", "random pose 2"]
    assert deviations["frame 10"].rms < 2.0
    assert deviations["frame 20"].rms < 3.0
    assert max(deviations[f"random pose {number}"].largest for number in (1, 2)) < 2.0


def test_the_pace_has_every_part() -> None:
    pace = pace_of(body_of(HUMAN), part_of(steps(), 0, 12))
    assert set(pace) == {"in windows", "in frames", "stream", "targets", "start", "follow", "windows", "mend"}
    assert all(value > 0.0 for value in pace.values())
    parts = sum(pace[part] for part in ("targets", "start", "follow", "windows", "mend"))
    assert pace["in windows"] == pytest.approx(1e3 / parts)
