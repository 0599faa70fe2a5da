"""Motions of a user's subject: from joint tables, and random ones."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from estimator.data.formats.angle_files import read_motion_table
from estimator.runs.export import export
from estimator.runs.run_reader import Run
from estimator.synthesis.motion import random_motion
from estimator.synthesis.motion_file import motion_of
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from kinemode import render
from tests.builders import body_of, inside
from tests.made_runs import made_run
from tests.test_evaluation import robot
from tests.test_exports_of_bodies import run as run  # the fixture

TIMES = np.arange(60) / 30.0


@pytest.mark.parametrize("name", ["human34", "arm8", "upper13"])
def test_a_random_motion_is_smooth_and_possible(name: str) -> None:
    body, collision = body_of(name), SelfCollision(body_of(name))
    q = random_motion(body, TIMES, np.random.default_rng(5))
    np.testing.assert_array_equal(q[0], body.neutral)
    assert all(inside(body, pose) for pose in q)
    assert max(collision.penetration(body.at(pose)) for pose in q) == 0.0
    v = np.array([body.velocity(a, b, 1.0 / 30.0) for a, b in pairwise(q)])
    assert np.abs(v).max() < 3.0
    assert np.abs(np.diff(v, axis=0)).max() < 1.0  # no jumps between frames
    assert (np.ptp(q, axis=0) > 0.05).mean() > 0.8  # nearly all joints move
    np.testing.assert_array_equal(q, random_motion(body, TIMES, np.random.default_rng(5)))
    assert np.abs(q - random_motion(body, TIMES, np.random.default_rng(6))).max() > 0.1


def test_overlaps_are_avoided_and_not_only_by_luck(monkeypatch: pytest.MonkeyPatch) -> None:
    body, collision = body_of("human34"), SelfCollision(body_of("human34"))
    monkeypatch.setattr("estimator.synthesis.motion._TRIES", 1)
    still = sum(np.array_equal(*random_motion(body, np.array([0.0, 0.79]), np.random.default_rng(s))) for s in range(6))
    monkeypatch.setattr(SelfCollision, "penetration", lambda self, posed: 0.0)
    blind = [random_motion(body, np.array([0.79]), np.random.default_rng(s))[0] for s in range(6)]
    monkeypatch.undo()
    assert still > 0  # some paths were rejected and drawn again
    assert any(collision.penetration(body.at(q)) > 0.0 for q in blind)


@pytest.mark.parametrize(("ending", "degrees"), [("csv", False), ("csv", True), ("npz", False)])
def test_what_is_exported_is_rendered_again(run: Run, tmp_path: Path, ending: str, degrees: bool) -> None:
    motion = export(run, tmp_path / f"a.{ending}", degrees=degrees)
    clip = render(tmp_path / "clip", motion, subject="human34", fps=30.0, videos=False)
    with np.load(clip.truth) as truth:
        assert truth["q"].shape == run.q.shape
        np.testing.assert_allclose(truth["q"], run.q, atol=1e-7)


@pytest.mark.parametrize("degrees", [False, True])
@pytest.mark.parametrize("body", [robot(), body_of("gripper")], ids=["endless", "follower"])
def test_joints_of_robots_come_back(body: Body, degrees: bool, tmp_path: Path) -> None:
    steps = 0.3 * np.arange(4.0)[:, None] * np.linspace(0.2, 1.0, body.nv)
    q = np.array([body.integrate(body.neutral, step) for step in steps])
    run = made_run(tmp_path / "a.run", body.subject, q[:, None])
    file = export(run, tmp_path / "a.csv", degrees=degrees)
    np.testing.assert_allclose(motion_of(body, read_motion_table(file), run.time), q, atol=1e-8)


def table(folder: Path, head: str, *rows: str) -> Path:
    path = folder / "a.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def test_a_table_in_degrees_between_its_rows(tmp_path: Path) -> None:
    body = body_of("arm8")
    path = table(tmp_path, "time,left_elbow_flexion_deg,left_shoulder_flexion", "10,20,0.1", "11,40,0.3", "12,40,0.3")
    q = motion_of(body, read_motion_table(path), np.array([0.0, 0.25, 1.0, 1.9]))
    elbow, shoulder = (body.q_names.index(f"left_{name}_flexion") for name in ("elbow", "shoulder"))
    np.testing.assert_allclose(np.rad2deg(q[:, elbow]), [20.0, 25.0, 40.0, 40.0])
    np.testing.assert_allclose(q[:, shoulder], [0.1, 0.15, 0.3, 0.3])
    others = [i for i in range(body.nq) if i not in (elbow, shoulder)]
    np.testing.assert_array_equal(q[:, others], np.tile(body.neutral[others], (4, 1)))


@pytest.mark.parametrize(
    ("subject", "head", "rows", "message"),
    [
        ("arm8", "time,left_elbow_flex_deg", ["0,1"], r"no joint 'left_elbow_flex' \(did you mean left_elbow_flexion"),
        ("arm8", "time,colour", ["0,1"], r"no joint 'colour' \(valid joints: left_clavicle_elevation"),
        ("arm8", "left_elbow_flexion", ["0"], "line 1: has 0 columns of time.*called one of time_s, time"),
        ("arm8", "t,left_elbow_flexion", ["0,0.1", "0,0.2"], "row 1: the times are not all numbers that rise"),
        ("arm8", "t,left_elbow_flexion", ["0,0.1", "1"], "line 3: has 1 cells, 2 are expected"),
        ("arm8", "t,left_elbow_flexion", [], "has no rows"),
        ("arm8", "t,left_elbow_flexion", ["0,"], "no row with a pose"),
        ("arm8", "t,left_elbow_flexion", ["0,45"], r"at 0 s: left_elbow_flexion is 45 rad.*\(degrees\? call"),
        ("arm8", "t,left_elbow_flexion", ["0,1", "1,3"], r"at 1 s: left_elbow_flexion is 3 rad, outside its limits"),
        ("arm8", "t,left_elbow_flexion,left_elbow_flexion_deg", ["0,1,1"], "'left_elbow_flexion' appears twice"),
        ("human34", "t,root_x_m", ["0,1"], r"has no column root_y \(all of root, or none\)"),
    ],
)  # fmt: skip
def test_faults_of_tables(tmp_path: Path, subject: str, head: str, rows: list[str], message: str) -> None:
    path = table(tmp_path, head, *rows)
    with pytest.raises(InputError, match=message) as caught:
        motion_of(body_of(subject), read_motion_table(path), np.zeros(1))
    assert caught.value.source == str(path)


def test_a_clip_of_a_random_motion_stands_on_the_floor(tmp_path: Path) -> None:
    clips = [
        render(tmp_path / name, "random", subject="human34", fps=10.0, seconds=1.0, seed=2, videos=False)
        for name in ("a", "b")
    ]
    with np.load(clips[0].truth) as a, np.load(clips[1].truth) as b:
        np.testing.assert_array_equal(a["q"], b["q"])
        lowest = a["landmarks"][..., 2].min()
    assert abs(lowest) < 0.1  # of the landmarks, near the soles
    with pytest.raises(InputError, match=r"no 'rondom' \(one of reach, .*, random, or a .bvh, .csv or .npz file\)"):
        render(tmp_path / "c", "rondom")
