"""Gait: events and strides of feet with a known motion, and none without walking."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import body_of
from test_run_file import header, state_of, walk

import kinemode as km
from benchmarks.accuracy.foot_contact import WALKS, gait_agreements
from benchmarks.accuracy.gait_events import KINDS, WAYS
from estimator.runs.contact import contact_of_points
from estimator.runs.events import SIDES
from estimator.runs.gait import Gait, gait_of_landmarks
from estimator.runs.run_file import RunWriter
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from viz.pictures.contact_plot import contact_drawing
from viz.report.tables import gait_part

NAMES = ("mid_hip", "left_heel", "left_big_toe", "right_heel", "right_big_toe")
SPEED, STRIDE, SWING = 1.3, 1.1, 0.42  # m/s, s, s of a stride
WIDTH = 0.14  # m
HEEL, TOE = -0.05, 0.17  # m from the ankle, along the foot
LATE = SWING / (2.0 * np.pi) * np.arccos(1.0 - SPEED * SWING / (SPEED * STRIDE))
"""[s] The time after toe-off, and before a strike, at which a swinging foot is as fast as the pelvis."""


def foot(time: np.ndarray, shift: float) -> np.ndarray:
    """Where a foot is along the way (T,) [m]: it stands, then swings along a cycloid to where it strikes next."""
    turn = time / STRIDE + shift
    whole, part = np.floor(turn), turn - np.floor(turn)
    u = np.clip((part - 1.0) * STRIDE / SWING + 1.0, 0.0, 1.0)
    return SPEED * STRIDE * (whole + u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))


def walker(time: np.ndarray, turn: float = 0.0) -> np.ndarray:
    """Landmarks (T, 5, 3) in the order of `NAMES`, walking in a direction `turn` [rad] from x."""
    middle = SPEED * time
    points = np.zeros((len(time), 5, 3))
    points[:, 0] = np.stack([middle, np.zeros_like(time), np.full_like(time, 0.9)], axis=1)
    for i, (shift, side) in enumerate(((0.0, 1.0), (0.5, -1.0))):
        ankle = foot(time, shift) - SPEED * STRIDE * shift + 0.5 * SPEED * (STRIDE - SWING)
        for k, along in enumerate((HEEL, TOE)):
            points[:, 1 + 2 * i + k, 0] = ankle + along
            points[:, 1 + 2 * i + k, 1] = side * WIDTH / 2.0
    c, s = np.cos(turn), np.sin(turn)
    return points @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def gait_of_walk(seconds: float = 8.0, fps: float = 50.0, turn: float = 0.0, **how: np.ndarray) -> Gait:
    time = 0.3 + np.arange(round(seconds * fps)) / fps
    return gait_of_landmarks(time, NAMES, walker(time, turn), **how)


@pytest.mark.parametrize(("fps", "turn"), [(100.0, 0.0), (30.0, 2.5)])
def test_a_known_walk(fps: float, turn: float) -> None:
    gait = gait_of_walk(fps=fps, turn=turn)
    assert gait.remark == ""
    assert len(gait.strides) >= 10
    for stride in gait.strides:
        assert stride.seconds == pytest.approx(STRIDE, abs=0.01)
        assert stride.length == pytest.approx(SPEED * STRIDE, abs=0.01)
        assert stride.width == pytest.approx(WIDTH, abs=0.005)
        assert stride.speed == pytest.approx(SPEED, abs=0.01)
        assert stride.cadence == pytest.approx(120.0 / STRIDE, abs=1.0)
        assert stride.stance == pytest.approx(100.0 * (STRIDE - SWING + 2.0 * LATE) / STRIDE, abs=2.0)
        assert stride.stance + stride.swing == pytest.approx(100.0)
        assert stride.unsure == 0


@pytest.mark.parametrize("fps", [100.0, 25.0])
def test_events_are_where_a_foot_is_as_fast_as_the_pelvis(fps: float) -> None:
    """The extremes of the method: the strike itself comes `LATE` after, toe-off `LATE` before."""
    gait = gait_of_walk(fps=fps)
    for event in gait.events:
        shift = 0.0 if event.side == "left" else 0.5
        phase = (event.time / STRIDE + shift) % 1.0 * STRIDE
        expected = STRIDE - LATE if event.kind == "strike" else STRIDE - SWING + LATE
        assert phase == pytest.approx(expected, abs=0.015), event
        assert abs(0.3 + event.frame / fps - event.time) <= 0.51 / fps
    kinds = [(event.side, event.kind) for event in gait.events if 2.0 < event.time < 6.0]
    order = [("left", "strike"), ("right", "off"), ("right", "strike"), ("left", "off")]
    start = order.index(kinds[0])
    assert kinds == [order[(start + i) % 4] for i in range(len(kinds))]


def stepping(stride: float, swing: float, speed: float, fps: float = 60.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and landmarks as by `walker`, with feet that lift 12 cm between steps."""
    time = np.arange(round(5.0 * fps)) / fps
    points = walker(time * STRIDE / stride)
    points[:, 0, 0] = speed * time
    for i, shift in enumerate((0.0, 0.5)):
        turn = time / stride + shift
        u = np.clip((turn % 1.0 - 1.0) * stride / swing + 1.0, 0.0, 1.0)
        ankle = speed * stride * (np.floor(turn) - shift + u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))
        for k, along in enumerate((HEEL, TOE)):
            points[:, 1 + 2 * i + k, 0] = ankle + along + 0.5 * speed * (stride - swing)
            points[:, 1 + 2 * i + k, 2] = 0.12 * np.sin(np.pi * u) ** 2
    return time, points


@pytest.mark.parametrize(("stride", "swing", "speed"), [(1.1, 0.42, 1.3), (0.72, 0.48, 3.0)])
def test_events_by_contact(stride: float, swing: float, speed: float) -> None:
    """A foot strikes when it comes to rest and leaves when it no longer rests; a runner has both in the air."""
    time, points = stepping(stride, swing, speed)
    gait = gait_of_landmarks(time, NAMES, points, contact=contact_of_points(time, NAMES[1:], points[:, 1:]))
    alone = gait_of_landmarks(time, NAMES, points)
    assert (gait.method, alone.method) == ("contact", "pelvis")
    runs = 2.0 * swing > stride
    for event in gait.events:
        phase = (event.time / stride + (0.0 if event.side == "left" else 0.5)) % 1.0 * stride
        if event.kind == "strike":
            assert min(phase, stride - phase) < 0.05
        elif runs:
            assert phase == pytest.approx(stride - swing, abs=0.05)
    if not runs:
        offs = [[e.time for e in of.events if e.kind == "off"] for of in (gait, alone)]
        assert set(offs[0]) <= set(offs[1])
    assert len(gait.strides) >= 6
    flight = 100.0 * max(0.0, 2.0 * swing / stride - 1.0)
    for of in gait.strides:
        assert of.seconds == pytest.approx(stride, abs=0.02)
        assert 0.25 * flight <= of.flight <= flight  # a foot that begins to swing, or ends to, is slow
    assert not any(of.flight for of in alone.strides)
    assert gait.remark == ""
    assert ("faster than people walk" in alone.remark) == runs


def test_steps_too_few_for_a_stride_have_events() -> None:
    time, points = stepping(1.1, 0.42, 1.3)
    few = (time > 0.55) & (time < 1.75)
    contact = contact_of_points(time[few], NAMES[1:], points[few, 1:])
    gait = gait_of_landmarks(time[few], NAMES, points[few], contact=contact)
    assert gait.strides == ()
    assert [event.kind for event in gait.events].count("strike") >= 1
    still = points[few] - (points[few, :1] - points[few][0, :1]) * [1.0, 0.0, 0.0]  # feet slide back under a pelvis
    assert gait_of_landmarks(time[few], NAMES, still, contact=contact).events == ()


def test_unseen_contact_has_no_events() -> None:
    time, points = stepping(1.1, 0.42, 1.3)
    contact = contact_of_points(time, NAMES[1:], points[:, 1:])
    doubted = replace(contact, seen=np.zeros(len(contact.names)))
    assert doubted.remark
    assert gait_of_landmarks(time, NAMES, points, contact=doubted) == gait_of_landmarks(time, NAMES, points)


def test_the_report_has_strides_and_marks() -> None:
    time, points = stepping(1.1, 0.42, 1.3)
    contact = contact_of_points(time, NAMES[1:], points[:, 1:])
    gait = gait_of_landmarks(time, NAMES, points, contact=contact)
    text = gait_part(gait)
    assert text.count("<tr>") == len(gait.strides) + 1
    assert f"{gait.strides[0].length:.2f}" in text
    assert "begin and cease to stand" in text
    bands = contact_drawing(contact, gait.events).axes[0]
    drawn = [(line.get_xdata()[0], line.get_marker()) for line in bands.lines]
    assert drawn == [(e.time, "v" if e.kind == "strike" else "^") for e in gait.events]
    nothing = gait_part(Gait((), (), "too short"))
    assert "<tr>" not in nothing
    assert "None: too short." in nothing


def test_events_of_markers_are_those_of_force_plates(shared_data: Path) -> None:
    """On average over two walks, and closer than by the pelvis alone."""
    several = [gait_agreements(shared_data / "opencap" / "subject4", trial) for trial in WALKS]
    off = {(way, kind): np.concatenate([of[way, kind].off for of in several]) for way in WAYS for kind in KINDS}
    mean = {key: float(np.abs(values).mean()) for key, values in off.items()}
    assert len(off["gait", "strike"]) + len(off["gait", "off"]) == 7
    assert mean["gait", "strike"] < 0.015 < mean["pelvis", "strike"]
    assert mean["gait", "off"] < 0.01 < mean["contact", "off"]


def test_noise_moves_strides_little() -> None:
    time = np.arange(240) / 30.0
    points = walker(time) + 0.01 * np.random.default_rng(0).normal(size=(240, 5, 3))
    gait = gait_of_landmarks(time, NAMES, points)
    lengths = [stride.length for stride in gait.strides]
    assert len(lengths) >= 10
    assert np.abs(np.array(lengths) - SPEED * STRIDE).max() < 0.08
    assert np.abs([stride.seconds - STRIDE for stride in gait.strides]).max() < 0.06


def test_motions_without_walking_are_reported() -> None:
    time = np.arange(150) / 30.0
    standing = walker(np.zeros(150))
    assert gait_of_landmarks(time, NAMES, standing).remark.startswith("not walking: the pelvis moves at 0.00 m/s")
    slid = standing + SPEED * time[:, None, None] * np.array([1.0, 0.0, 0.0])  # the whole body carried along
    assert "no foot strikes the ground twice" in gait_of_landmarks(time, NAMES, slid).remark
    swung = slid + 0.1 * np.array([0, 1, 1, -1, -1])[:, None] * np.sin(6.0 * time)[:, None, None] * [1.0, 0.0, 0.0]
    in_air = gait_of_landmarks(time, NAMES, swung)  # carried, and swinging the legs
    assert in_air.strides == in_air.events == ()
    assert "does it stand" in in_air.remark
    short = gait_of_walk(seconds=0.8)
    assert short.strides == short.events == ()
    assert "too short: the feet are known for 0.8 s" in short.remark
    assert gait_of_walk(seconds=1.4).strides == ()
    fast = gait_of_landmarks(np.arange(200) / 100.0, NAMES, walker(np.arange(200) / 50.0))
    assert "faster than people walk" in fast.remark


def test_frames_without_a_pose_are_not_bridged() -> None:
    time = np.arange(400) / 50.0
    points = walker(time)
    points[200:203] = np.nan
    gait, whole = gait_of_landmarks(time, NAMES, points), gait_of_walk()
    assert 0 < len(gait.strides) < len(whole.strides)
    assert all(stride.end <= time[200] or stride.start >= time[202] for stride in gait.strides)
    nothing = gait_of_landmarks(time, NAMES, np.full_like(points, np.nan))
    assert "0.0 s" in nothing.remark


def test_unsure_frames_are_counted() -> None:
    sure = np.ones(400, dtype=bool)
    sure[100:104] = False
    gait = gait_of_walk(sure=sure)
    within = [s for s in gait.strides if s.start < 2.3 and s.end > 2.36]
    assert within
    assert all(s.unsure == 4 for s in within)
    assert all(s.unsure == 0 for s in gait.strides if s.start > 2.4)


def test_strides_as_a_table(tmp_path: Path) -> None:
    gait = gait_of_walk()
    with gait.write(tmp_path / "strides.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(gait.strides)
    assert list(rows[0]) == [
        "side", "start [s]", "off [s]", "end [s]", "seconds [s]", "length [m]", "width [m]", "speed [m/s]",
        "cadence [steps/min]", "stance [%]", "swing [%]", "flight [%]", "unsure [frames]",
    ]  # fmt: skip
    assert float(rows[3]["length [m]"]) == pytest.approx(gait.strides[3].length, rel=1e-5)
    with pytest.raises(InputError, match="cannot be written"):
        gait.write(tmp_path / "none" / "strides.csv")


def test_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run without walking, by the function and by the command; a body without feet is refused."""
    body = Body(load_subject("human34"))
    with RunWriter.create(tmp_path / "a.run", header(40)) as writer:
        for result in walk(body, 40):
            writer.append(result, state_of(result))
    gait = km.gait(tmp_path / "a.run")
    assert gait.strides == ()
    assert gait.remark
    assert front.main(["gait", str(tmp_path / "a.run"), "--out", str(tmp_path / "s.csv")]) == 0
    assert gait.remark in capsys.readouterr().out
    assert (tmp_path / "s.csv").read_text().count("\n") == 1
    arm = load_subject("arm8")
    with RunWriter.create(tmp_path / "b.run", header(20, subject_urdf=arm.urdf, subject_base=arm.base)) as writer:
        for result in walk(Body(arm), 20):
            writer.append(result, state_of(result))
    with pytest.raises(InputError, match="has no landmark left_heel"):
        km.gait(tmp_path / "b.run")


def test_captured_walking(shared_data: Path) -> None:
    """Events agree with when the feet stop and start; strides with the path of the hips."""
    body = body_of("human34")
    mocap = load_mocap(shared_data / "mocap" / "walk_straight_07_01.bvh")
    time = np.arange(0.0, mocap.seconds - 1e-6, 1.0 / mocap.fps)
    points = body.landmarks_of(body.placed(retarget(body, mocap, time).q))
    gait = gait_of_landmarks(time, body.landmark_names, points)
    assert {stride.side for stride in gait.strides} == set(SIDES)
    place = dict(zip(body.landmark_names, points.transpose(1, 0, 2), strict=True))
    for event in gait.events:
        part = "heel" if event.kind == "strike" else "big_toe"
        speed = np.linalg.norm(np.gradient(place[f"{event.side}_{part}"], time, axis=0), axis=1)
        still = speed < 0.5  # m/s; Bruening and Ridge, Gait & Posture 39(1), 2014, on such thresholds
        changes = time[1:][still[1:] & ~still[:-1]] if event.kind == "strike" else time[1:][still[:-1] & ~still[1:]]
        assert np.abs(changes - event.time).min() < 0.1, event
    hips = place["mid_hip"]
    for stride in gait.strides:
        way = [np.interp([stride.start, stride.end], time, hips[:, axis]) for axis in (0, 1)]
        assert np.hypot(*np.diff(way)[:, 0]) == pytest.approx(stride.length, rel=0.08)
        assert 55.0 < stride.stance < 72.0
