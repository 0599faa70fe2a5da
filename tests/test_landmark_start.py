"""The landmark template of a robot loads unchanged, and its landmarks are at the joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from humanoid import Body, load_subject
from humanoid.shape.landmark_start import body_part, landmark_start
from humanoid.subject.example_robots import PREFIX, find, installed
from humanoid.subject.subject import Subject, subject_from_text
from humanoid.support.files import read_toml
from kinemode.__main__ import main

ARM = """<robot name="arm"><link name="world"/>
  <link name="a"/><link name="b.1"><collision><origin xyz="0 0 0.2"/><geometry><box size="0.1 0.1 0.4"/></geometry>
  </collision></link><link name="tool"/><link name="wheel"><visual><origin xyz="0 0.1 0"/><geometry>
  <sphere radius="0.1"/></geometry></visual></link>
  <joint name="j1" type="revolute"><parent link="world"/><child link="a"/><limit lower="0.5" upper="1.5"/></joint>
  <joint name="j2" type="prismatic"><parent link="a"/><child link="b.1"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="j3" type="continuous"><parent link="a"/><child link="wheel"/><origin xyz="0 0 0.5"/></joint>
  <joint name="f" type="fixed"><parent link="b.1"/><child link="tool"/></joint></robot>"""


def raw(name: str, tmp_path: Path) -> Subject:
    """A robot of example-robot-data from its URDF alone."""
    if name not in installed():
        pytest.skip("example-robot-data is not installed")
    (tmp_path / "none.toml").write_text("")
    return load_subject(PREFIX + name, landmarks=tmp_path / "none.toml")


@pytest.mark.parametrize(("name", "count"), [("g1", 16), ("talos", 37), ("panda", 11)])
def test_a_started_file_loads_and_marks_the_joints(name: str, count: int, tmp_path: Path) -> None:
    subject = raw(name, tmp_path)
    text = km.landmark_start(subject, out=tmp_path / "start.toml")
    assert (tmp_path / "start.toml").read_text(encoding="utf-8") == text
    path, share, by_hand = find(PREFIX + name)
    loaded = load_subject(path, landmarks=tmp_path / "start.toml", package_dirs=[share])
    body = Body(loaded)
    assert loaded.base == subject.base
    assert len(loaded.landmarks) == count
    tips = np.array([landmark.name.endswith(("_tip", "_heel", "_big_toe")) for landmark in loaded.landmarks])
    posed = body.at(body.neutral)
    places = body.landmarks(posed)
    assert np.array_equal(places[~tips], posed.translations[body.landmark_joint[~tips]])
    away = np.linalg.norm(places[tips] - posed.translations[body.landmark_joint[tips]], axis=1)
    assert ((away > 0.02) & (away < 0.5)).all()
    assert Body(subject).nv == body.nv
    if name == "g1":  # the file that comes with kinemode was written by hand, link by link
        known = load_subject(path, landmarks=by_hand, package_dirs=[share]).landmarks
        assert {m.name: m.link for m in loaded.landmarks} == {m.name: m.link for m in known}
        where = {m.name: np.array(m.xyz) for m in known}
        assert all(np.linalg.norm(where[m.name] - m.xyz) < 0.02 for m in loaded.landmarks)
        assert all(m.xyz[2] == pytest.approx(-0.035) for m in loaded.landmarks if m.name.endswith(("heel", "toe")))


def test_every_line_is_worth_uncommenting(tmp_path: Path) -> None:
    """The commented lines load too; the box ends 0.4 m up, the sphere 0.2 m to the left."""
    (tmp_path / "arm.urdf").write_text(ARM)
    assert (
        main(["subjects", "--landmarks", str(tmp_path / "arm.urdf"), "--out", str(tmp_path / "arm.landmarks.toml")])
        == 0
    )
    subject = load_subject(tmp_path / "arm.urdf")
    places = {landmark.name: landmark.xyz for landmark in subject.landmarks}
    assert places == {
        "a": (0, 0, 0),
        "b.1": (0, 0, 0),
        "wheel": (0, 0, 0),
        "b.1_tip": (0, 0, 0.4),
        "wheel_tip": (0, 0.2, 0),
    }
    lines = (tmp_path / "arm.landmarks.toml").read_text().splitlines()
    full = [line.removeprefix("# ") if " = " in line else line for line in lines]
    (tmp_path / "full.toml").write_text("\n".join(full))
    whole = load_subject(tmp_path / "arm.urdf", landmarks=tmp_path / "full.toml")
    assert {landmark.name for landmark in whole.landmarks} == {*places, "tool"}
    assert {(s.joint, s.rest, s.std) for s in whole.stabilisers} == {("j1", 1.0, 0.25), ("j2", 0.0, 0.5)}
    assert (whole.model.nq, subject.model.nq) == (3, 4)  # the wheel has limits now


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    (tmp_path / "mine.toml").write_text("mine")
    assert main(["subjects", "--landmarks", str(tmp_path / "arm.urdf"), "--out", str(tmp_path / "mine.toml")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "mine.toml").read_text() == "mine"
    assert main(["subjects", "--landmarks", str(tmp_path / "arm.urdf")]) == 0
    assert capsys.readouterr().out == landmark_start(load_subject(tmp_path / "arm.urdf"))
    with pytest.raises(km.InputError, match="has landmarks in its URDF"):
        km.landmark_start("arm8")


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("l_elbow_flex_link", "left_elbow"), ("LHipYaw", "left_hip"), ("RKneePitch", "right_knee"),
        ("leftWrist2", "left_wrist"), ("right-ankle", "right_ankle"), ("arm_left_3_link", None), ("wrist_1_link", None),
        ("left_chip", None), ("Shoulder_R", "right_shoulder"), ("left_hip_right_knee", None), ("HIPS_L", "left_hip"),
    ],
)  # fmt: skip
def test_joint_names_give_the_body_part(name: str, part: str | None) -> None:
    assert body_part(name) == part


BIPED = """<robot name="biped"><link name="pelvis"/>{legs}</robot>"""
LEG = """<link name="{s}_hip"/><link name="{s}_knee"/><link name="{s}_ankle"><collision>
    <origin xyz="{ahead}" rpy="0 0 {yaw}"/><geometry><box size="0.24 0.08 0.06"/></geometry></collision></link>
  <joint name="{s}_hip_pitch" type="revolute"><parent link="pelvis"/><child link="{s}_hip"/><origin xyz="{aside}"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="{s}_knee_pitch" type="revolute"><parent link="{s}_hip"/><child link="{s}_knee"/>
    <origin xyz="0 0 -0.4"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="{s}_ankle_pitch" type="revolute"><parent link="{s}_knee"/><child link="{s}_ankle"/>
    <origin xyz="0 0 -0.4"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""


@pytest.mark.parametrize("yaw", [0.0, 90.0, 180.0, -90.0, 30.0])
def test_toes_are_on_the_side_of_the_front(yaw: float, tmp_path: Path) -> None:
    """Whichever axis of its URDF a robot faces; its feet are longer in front of the ankle."""
    turn = np.radians(yaw)
    front, left = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
    legs = "".join(
        LEG.format(
            s=side, yaw=turn, ahead=" ".join(map(str, 0.05 * front - [0.0, 0.0, 0.03])), aside=" ".join(map(str, at))
        )
        for side, at in (("left", 0.1 * left), ("right", -0.1 * left))
    )
    text = landmark_start(subject_from_text(BIPED.format(legs=legs), source="biped.urdf"))
    (tmp_path / "biped.toml").write_text(text)
    marks = read_toml(tmp_path / "biped.toml", remedy="")["landmarks"]
    places = {name: entry["xyz"] for name, entry in marks.items()}
    for side in ("left", "right"):
        assert places[f"{side}_big_toe"] == pytest.approx(0.146 * front - [0.0, 0.0, 0.06], abs=2e-4)
        assert places[f"{side}_heel"] == pytest.approx(-0.046 * front - [0.0, 0.0, 0.06], abs=2e-4)
