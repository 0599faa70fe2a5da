"""The measure of retargeting is right: targets of a robot's own motion equal that motion."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.retargeting import methods, pink_following
from benchmarks.retargeting.rebuilt import rebuilt_targets
from benchmarks.retargeting.retarget import figures_of, show, together
from benchmarks.retargeting.trials import (
    ASAP,
    ASAP_JOINTS,
    CAPTURED,
    G1,
    RetargetTrial,
    beginning,
    peer_motion,
    trials_of,
)
from estimator.retargeting.contacts import SourceContacts
from estimator.retargeting.metrics import RetargetMeter, RetargetMetrics
from estimator.retargeting.problem import parts_of
from estimator.retargeting.source import SourceMotion
from humanoid.kinematics.body import Body
from humanoid.subject.example_robots import installed
from humanoid.support.errors import InputError
from tests.builders import body_of

SOLES = ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
T = 8


@pytest.fixture(scope="module")
def body() -> Body:
    if "g1" not in installed():
        pytest.skip("example-robot-data is not installed")
    return body_of(G1)


@pytest.fixture(scope="module")
def trial(body: Body) -> RetargetTrial:
    """G1's own arms and trunk moving while its feet stand, twice as large."""
    q = np.tile(body.neutral, (T, 1))
    for name, most in (("left_shoulder_pitch_joint", 0.5), ("right_elbow_joint", -0.4)):
        q[:, body.q_names.index(name)] += np.linspace(0.0, most, T)
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    points[..., 2] -= points[0, body.landmark_names.index("left_heel"), 2]
    source = SourceMotion(body.landmark_names, 2.0 * points, np.arange(T) / 30.0, "a.npz")
    contacts = SourceContacts(SOLES, SOLES, np.ones((T, 4), dtype=bool), 0.0, np.zeros(4))
    return RetargetTrial("own", Path("a.npz"), source, contacts, own=False)


def test_targets_of_its_own_motion_are_that_motion(body: Body, trial: RetargetTrial) -> None:
    targets = rebuilt_targets(body, trial.source, trial.contacts)
    assert set(targets.names) == set(body.landmark_names)
    truth = 0.5 * trial.source.points[:, [trial.source.names.index(name) for name in targets.names]]
    assert targets.points == pytest.approx(truth, abs=1e-3)  # a foot's heading is that of ankle and toe


def test_pink_follows_them(body: Body, trial: RetargetTrial) -> None:
    pytest.importorskip("pink", reason="pip install -e .[benchmark]")
    targets = rebuilt_targets(body, trial.source, trial.contacts)
    motion = pink_following.pink_motion(body, targets, trial.source.times)
    if motion.failed:
        pytest.skip("only ProxQP is installed, which gives up")
    followed = np.array([body.landmarks(body.at(pose)) for pose in motion.q])
    chosen = [body.landmark_names.index(name) for name in targets.names]
    assert followed[:, chosen] == pytest.approx(targets.points, abs=5e-3)
    row = figures_of(RetargetMeter(body), trial, methods.FollowedMotion(motion.q, motion.seconds))
    assert row["limb_angle"] < 2.0
    assert row["over_limits"] == row["too_fast"] == 0.0
    assert row["seconds"] > 0.0


def test_a_missing_pink_is_reported(body: Body, trial: RetargetTrial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pink", None)
    with pytest.raises(InputError, match="pink: pink is not installed"):
        methods.by_pink(body, G1, trial)


def test_the_peers_motion_by_its_joints(body: Body, tmp_path: Path, trial: RetargetTrial) -> None:
    assert len(ASAP_JOINTS) == 23
    assert set(ASAP_JOINTS) < set(body.q_names)
    dof = np.arange(23.0) / 100.0
    turn = 2.0 * np.array([0.0, 0.0, np.sin(0.2), np.cos(0.2)])
    arrays = {"root_position": np.ones((T, 3)), "root_quaternion": np.tile(turn, (T, 1)), "dof": np.tile(dof, (T, 1))}
    np.savez(tmp_path / "a.npz", **arrays)
    q = peer_motion(body, trial._replace(path=tmp_path / "a.npz"))[0]
    assert q[:3].tolist() == [1.0, 1.0, 1.0]
    assert q[3:7] == pytest.approx(0.5 * turn)
    assert q[body.q_names.index("right_elbow_joint")] == pytest.approx(0.22)
    assert q[body.q_names.index("left_wrist_yaw_joint")] == 0.0


def test_a_floor_that_suits(body: Body, trial: RetargetTrial) -> None:
    q = np.tile(body.neutral, (T, 1))
    q[:, 2] += np.arange(T)
    heel = body.landmarks(body.at(body.neutral))[body.landmark_names.index("left_heel"), 2]
    assert methods.standing_floor(body, q, trial.contacts) == pytest.approx(heel + 0.1)  # the lowest but 3.1 of 32
    nowhere = SourceContacts((), (), np.zeros((T, 0), dtype=bool), None, np.zeros(0))
    assert methods.standing_floor(body, q, nowhere) == 0.0


def test_clips_together_and_tables(capsys: pytest.CaptureFixture[str]) -> None:
    one_clip = {**dict.fromkeys(RetargetMetrics._fields, 1.0), "seconds": 0.001}
    other = {**dict.fromkeys(RetargetMetrics._fields, 3.0), "seconds": np.nan}
    of_both = together([one_clip, other])
    assert (of_both["slip"], of_both["median_slip"], of_both["seconds"]) == (3.0, 2.0, 0.001)
    show(G1, {"ours": {ASAP[0]: one_clip}, "pink": {ASAP[0]: one_clip, next(iter(CAPTURED)): other}})
    out = capsys.readouterr().out
    assert "pink, 2" in out
    assert "pink, 1" in out


def test_the_clips_exist(shared_data: Path) -> None:
    if not (shared_data / "asap").is_dir():
        pytest.skip("no asap in the data")
    walk, run = trials_of(shared_data, ("walk_level1", "run_02_03"), 1.0)
    assert (walk.own, run.own) == (True, False)
    assert len(walk.source.times) == 30
    assert walk.contacts.names == SOLES
    assert len(beginning(run.source, 0.5).times) == 30


def test_parts_that_are_drawn_in_each_other_are_left_out() -> None:
    if "talos" not in installed():
        pytest.skip("example-robot-data is not installed")
    talos = body_of("example-robot-data:talos")
    parted = parts_of(talos, 0.0)
    assert parted.penetration(talos.at(talos.neutral)) < 0.001
