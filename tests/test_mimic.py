"""Joints that follow others: they move with their master everywhere, and the master moves what they carry."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from builders import MULTIPLIER, OFFSET, camera_at, gripper

import kinemode as km
from estimator.data.formats.opensim import read_mot
from estimator.energy.point_targets import PointTargets
from estimator.energy.points import LoadedPoints, accumulate_points
from estimator.fitting.body_energy import PointLoads, _gathered
from humanoid import Body, InputError, load_subject
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.placements import JointKinematics
from humanoid.kinematics.proportions import ProportionedBody
from humanoid.subject.example_robots import PREFIX, installed
from humanoid.subject.subject import Subject, subject_from_text
from kinemode.testing import check_term, slope


def load(tmp_path: Path, text: str, **options: object) -> Subject:
    (tmp_path / "gripper.urdf").write_text(text)
    return load_subject(tmp_path / "gripper.urdf", **options)  # type: ignore[arg-type]


def without_mimic(text: str) -> str:
    start = text.index("<mimic")
    return text[:start] + text[text.index("/>", start) + 2 :]


def pose(body: Body, seed: int = 0) -> np.ndarray:
    return body.integrate(body.neutral, 0.4 * np.random.default_rng(seed).normal(size=body.nv))


def loosened(subject: Subject, text: str, q: np.ndarray) -> tuple[Body, np.ndarray]:
    """The same body with an independent follower, and the pose in which it follows."""
    free, own = Body(subject_from_text(without_mimic(text), source="loose")), Body(subject)
    by_name = dict(zip(own.q_names, q, strict=True))
    for mimic in subject.mimics:
        value = mimic.multiplier * by_name[mimic.master] + mimic.offset
        by_name |= {mimic.joint: value, mimic.joint + "_cos": np.cos(value), mimic.joint + "_sin": np.sin(value)}
    return free, np.array([by_name[name] for name in free.q_names])


CASES = {
    "master first": ("drive", "inner", "revolute"),
    "follower first": ("knuckle", "inner", "revolute"),
    "sliding": ("knuckle", "inner", "prismatic"),
    "continuous follower": ("drive", "inner", "continuous"),
}


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Subject, str]:
    master, follower, kind = CASES[request.param]
    text = gripper(master=master, follower=follower, kind=kind)
    return load(tmp_path, text), text


def test_a_follower_is_where_its_master_puts_it(case: tuple[Subject, str]) -> None:
    subject, text = case
    body = Body(subject)
    q = pose(body)
    free, q_free = loosened(subject, text, q)
    assert (body.nv, body.njoints) == (free.nv - 1, free.njoints)
    assert "inner" not in body.q_names + body.v_names
    assert np.abs(body.landmarks(body.at(q)) - free.landmarks(free.at(q_free))).max() < 1e-14
    assert np.array_equal(body.placed(q[None]).placements[0], body.at(q).placements)


def test_the_master_moves_what_its_follower_carries(case: tuple[Subject, str]) -> None:
    body = Body(case[0])
    q = pose(body)
    jacobians = body.landmark_jacobians(body.at(q))
    for v in range(body.nv):
        unit = np.eye(body.nv)[v]
        expected = slope(lambda x: body.landmarks(body.at(x)), body, q, unit, 1e-4)
        assert np.abs(jacobians[..., v] - expected).max() < 1e-10
        moved = np.abs(expected).max(axis=1) > 1e-9
        assert v < 6 or np.array_equal(moved, body.landmark_support[:, v])
    slow = JointKinematics(body.model).at(q)
    assert np.abs(slow[0] - body.at(q).placements).max() < 1e-14
    assert np.abs(slow[1] - body.at(q).spatial_jacobian).max() < 1e-14


def test_energies_and_distances_know_what_the_master_moves(case: tuple[Subject, str]) -> None:
    body = Body(case[0])
    q, rng = pose(body), np.random.default_rng(1)
    drawn = [np.eye(3) + 0.1 * (m + m.T) for m in rng.normal(size=(4, 3, 3))]
    term = PointTargets(body, body.landmark_joint, body.landmark_local, rng.normal(size=(4, 3)), np.array(drawn))
    check_term(term, body, q)
    collision = SelfCollision(body, margin=10.0)
    contacts = collision.near(body.at(q))
    assert len(contacts.distance) >= 4
    for v in range(body.nv):
        unit = np.eye(body.nv)[v]
        expected = slope(lambda x: collision.near(body.at(x)).distance, body, q, unit, 1e-4)
        assert np.abs(contacts.gradient[:, v] - expected).max() < 1e-7
    curvature, factor = np.zeros((body.nv, body.nv)), rng.uniform(0.5, 2.0, len(contacts.distance))
    collision.add_curvature(body.at(q), contacts, factor, curvature)
    for v in range(6, body.nv):
        along = slope(lambda x: factor @ collision.near(body.at(x)).gradient, body, q, np.eye(body.nv)[v], 1e-4)
        assert np.abs(curvature[6:, v] - along[6:]).max() < 1e-6


def test_shapes_are_fitted_to_what_followers_carry(case: tuple[Subject, str]) -> None:
    """The rows of a fit to points give the gradient and Hessian of the terms on the same points."""
    body, rng = Body(case[0]), np.random.default_rng(5)
    posed, joint = body.at(pose(body)), np.arange(1, body.njoints)
    m = rng.normal(size=(len(joint), 3, 3))
    points, force, load = *rng.normal(size=(2, len(joint), 3)), m @ m.transpose(0, 2, 1)
    rows = _gathered(body, posed, joint, PointLoads(0.0, points, force, load), np.zeros((len(joint), 3, 0)))
    gradient, hessian = np.zeros(body.nv), np.zeros((body.nv, body.nv))
    accumulate_points(body, posed, LoadedPoints(joint, points, force, load), gradient, hessian, exact=False)
    np.testing.assert_allclose(rows.gradient, gradient, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(rows.hessian, hessian, rtol=1e-9, atol=1e-12)


def test_lengths_and_other_processes_keep_the_followers(case: tuple[Subject, str]) -> None:
    lengths = ProportionedBody(case[0])
    body = lengths.at(np.array([1.1]))
    again, subject = pickle.loads(pickle.dumps(body)), pickle.loads(pickle.dumps(case[0]))
    q = pose(body)
    assert np.array_equal(again.at(q).placements, body.at(q).placements)
    assert not np.array_equal(Body(subject).at(q).placements, body.at(q).placements)
    assert subject.urdf == case[0].urdf
    scaled = Body(case[0].scaled({"outer": 1.1}))
    assert np.abs(scaled.landmarks(scaled.at(q)) - again.landmarks(body.at(q))).max() < 1e-12


def test_the_text_of_a_subject_is_complete(case: tuple[Subject, str]) -> None:
    again = subject_from_text(case[0].urdf, source="again", base=case[0].base)
    assert again.urdf == case[0].urdf
    assert again.mimics == case[0].mimics


def test_a_masters_limits_let_its_follower_keep_its_own(tmp_path: Path) -> None:
    """The follower's -1 to 0.9 let the master be -1.4 to 2.4; its own -1 to 0.9 are narrower until they are not."""
    wide = gripper().replace('<axis xyz="0 0.6 0.8"/><limit lower="-1"', '<axis xyz="0 0.6 0.8"/><limit lower="-3"')
    subject = load(tmp_path, wide)
    body = Body(subject)
    low, high = (limit[body.q_names.index("drive")] for limit in (body.lower, body.upper))
    assert (low, high) == pytest.approx((-1.4, 0.9), abs=1e-15)
    assert MULTIPLIER * low + OFFSET == pytest.approx(0.9)
    assert "limits of drive are narrowed" in subject.notes[0]
    same = Body(load(tmp_path, gripper()))
    assert (same.lower[-2], same.upper[-2]) == (-1.0, 0.9)
    (tmp_path / "other.toml").write_text("[limits]\ninner = [0.0, 0.3]\n")
    (tmp_path / "bare.urdf").write_text(gripper())
    given = Body(load_subject(tmp_path / "bare.urdf", landmarks=tmp_path / "other.toml"))
    assert given.lower[given.q_names.index("drive")] == pytest.approx(-0.2)


def test_what_cannot_move_is_fixed_where_its_master_leaves_it(tmp_path: Path) -> None:
    text = gripper()
    free = load(tmp_path, text)
    locked = Body(load(tmp_path, text, lock=["drive"]))
    assert locked.nv == Body(free).nv - 1
    body = Body(free)
    q, q_locked = body.neutral, locked.neutral
    assert np.abs(locked.landmarks(locked.at(q_locked)) - body.landmarks(body.at(q))).max() < 1e-12
    constant = load(tmp_path, text.replace(f'multiplier="{MULTIPLIER}"', 'multiplier="0"'))
    assert constant.mimics == ()
    assert "inner" not in Body(constant).q_names
    with pytest.raises(InputError, match=r"follows 'drive'.*lock 'drive'"):
        load(tmp_path, text, lock=["inner"])


FAULTS = {
    "of itself": (('<mimic joint="drive"', '<mimic joint="inner"'), "follows itself"),
    "of nothing": (('<mimic joint="drive"', '<mimic joint="drives"'), "no joint 'drives' to follow.*mean drive"),
    "of what it carries": (('<mimic joint="drive"', '<mimic joint="outer"'), "'inner' carries the joint 'outer'"),
    "no number": (('multiplier="-0.5"', 'multiplier="x"'), "'x' is not a number"),
    "no value left": (('offset="0.2"', 'offset="9"'), "leave its master 'drive' no value"),
    "of endless turns": (
        ('<joint name="drive" type="revolute">', '<joint name="drive" type="continuous">'),
        "'drive' is continuous.*limits",
    ),
    "with a stabiliser": (("<subject", '<stabiliser joint="inner" rest="0" std="1"/><subject'), "follows 'drive'"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_be_followed_is_refused(name: str, tmp_path: Path) -> None:
    (old, new), message = FAULTS[name]
    text = gripper()
    assert old in text
    with pytest.raises(InputError, match=message):
        load(tmp_path, text.replace(old, new))


def test_the_fingers_of_a_gripper_close_on_the_middle() -> None:
    """Panda's second finger mimics the first, on the other side of the hand."""
    if "panda" not in installed():
        pytest.skip("example-robot-data is not installed")
    body = Body(load_subject(PREFIX + "panda"))
    assert (body.nq, body.nv) == (8, 8)
    q = body.neutral.copy()
    q[-1] = 0.03
    points = dict(zip(body.landmark_names, body.landmarks(body.at(q)), strict=True))
    between = points["panda_leftfinger"] - points["panda_rightfinger"]
    assert np.linalg.norm(between) == pytest.approx(0.06, abs=1e-12)
    middle = 0.5 * (points["panda_leftfinger"] + points["panda_rightfinger"]) - points["panda_hand"]
    assert abs(middle @ between) < 1e-15


@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
def test_a_motion_with_followers_is_found_again(tmp_path: Path) -> None:
    """From clean keypoints of two cameras, from files to files; smoothing slightly damps so quick a motion."""
    subject = load(tmp_path, gripper())
    body, times = Body(subject), np.arange(12) / 12.0
    start, step = pose(body, 3), 0.5 * np.random.default_rng(4).normal(size=body.nv)
    truth = np.array([body.integrate(start, np.sin(2.0 * t) * step) for t in times])
    cameras = {f"cam{a:g}": camera_at(a, height=h) for a, h in ((20.0, 0.3), (110.0, 1.0))}
    keypoints = {}
    for name, camera in cameras.items():
        pixels = np.array([camera.project(body.landmarks(body.at(q))) for q in truth])
        keypoints[name] = tmp_path / f"{name}.json"
        track = km.KeypointTrack(
            "landmarks", body.landmark_names, pixels, np.ones(pixels.shape[:2]), camera.image_size, 12.0
        )
        km.write_keypoints(keypoints[name], track)
    run = km.track(subject, None, keypoints=keypoints, cameras=cameras, out=tmp_path / "a.run", fit="off")
    landmarks = np.array([body.landmarks(body.at(q)) for q in truth])
    assert np.median(np.linalg.norm(run.landmarks - landmarks, axis=2)) < 3e-3
    assert run.q.shape == (12, body.nq)
    names, values = read_mot(km.export(run, tmp_path / "a.mot"))[0][:2]
    drive, inner = (values[:, names.index(name)] for name in ("drive", "inner"))
    assert np.abs(inner - (MULTIPLIER * drive + np.rad2deg(OFFSET))).max() < 1e-6


def fan_of(masters: dict[str, tuple[str, float, float]], order: list[str]) -> str:
    """Joints a, b, c, ... of one link, in any order in the file; masters: the joint that each follows, with multiplier
    and offset."""
    names = sorted(order)
    joints = {}
    for i, name in enumerate(names):
        follows = '<mimic joint="{}" multiplier="{}" offset="{}"/>'.format(*masters[name]) if name in masters else ""
        axis = "0 1 0" if i % 2 else "0.6 0 0.8"
        joints[name] = (
            f'<joint name="{name}" type="revolute"><parent link="l0"/><child link="l{i + 1}"/>'
            f'<origin xyz="0.01 0.02 {0.1 * i:.1f}"/><axis xyz="{axis}"/>'
            f'<limit lower="-2" upper="2" effort="1" velocity="1"/>{follows}</joint>'
        )
    links = "".join(f'<link name="l{i}"/>' for i in range(len(names) + 1))
    return f'<robot name="chain">{links}{"".join(joints[name] for name in order)}</robot>'


def value_of(joint: str, masters: dict[str, tuple[str, float, float]], q: dict[str, float]) -> float:
    if joint not in masters:
        return q[joint]
    master, multiplier, offset = masters[joint]
    return multiplier * value_of(master, masters, q) + offset


@pytest.mark.parametrize("seed", range(4))
def test_what_follows_a_follower_follows_its_master(seed: int, tmp_path: Path) -> None:
    """Any tree of followers over seven joints, in any order of the file."""
    rng = np.random.default_rng(seed)
    names, ranks = list("abcdefg"), rng.permutation(7)
    masters = {}
    for k in np.flatnonzero(ranks > 1):
        master = names[int(rng.choice(np.flatnonzero(ranks < ranks[k])))]
        masters[names[k]] = (master, *rng.uniform(-0.9, 0.9, 2).round(3).tolist())
    text = fan_of(masters, [names[k] for k in rng.permutation(7)])
    body = Body(load(tmp_path, text, base="fixed"))
    assert body.nv == 2
    q = 0.5 * (body.lower + body.upper) + 0.3 * rng.uniform(-1.0, 1.0, 2) * (body.upper - body.lower)
    by_name = dict(zip(body.q_names, q.tolist(), strict=True))
    free = Body(subject_from_text(fan_of({}, names), source="free", base="fixed"))
    q_free = np.array([value_of(name, masters, by_name) for name in free.q_names])
    assert np.abs(q_free).max() <= 2.0 + 1e-12  # all limits hold
    placed, alone = body.at(q).placements, free.at(q_free).placements
    for name in names:
        ours, theirs = placed[body.model.getJointId(name)], alone[free.model.getJointId(name)]
        assert np.abs(ours - theirs).max() < 1e-14
    again = subject_from_text(body.subject.urdf, source="again", base="fixed")
    assert again.mimics == body.subject.mimics


def test_joints_that_follow_each_other_are_refused(tmp_path: Path) -> None:
    masters = {"a": ("b", 1.0, 0.0), "b": ("c", 0.5, 0.0), "c": ("a", 2.0, 0.0)}
    with pytest.raises(InputError, match=r"line \d+.*joints follow each other in a circle: [abc], [abc], [abc]"):
        load(tmp_path, fan_of(masters, ["a", "b", "c", "d"]))
