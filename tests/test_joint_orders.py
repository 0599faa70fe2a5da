"""Unnamed joints get the order in which a body's limbs are rigid and alike on both sides, or none."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from estimator.retargeting.joint_arrays import load_joints
from estimator.retargeting.joint_orders import ORDERS, clear_order, landmarks_named, order_misfit, orders_of
from estimator.retargeting.source import SourceMotion
from humanoid.support.errors import InputError
from kinemode.inputs.motions import SourceOptions, load_source
from tests.builders import body_of

FRAMES, RATE = 40, 30.0
NOISE = 0.02  # m, along each axis
KNEES = ("left_knee", "right_knee")


@cache
def moving(seed: int) -> dict[str, np.ndarray]:
    """Places (T, 3) [m] of human34's landmarks while all joints move."""
    body, rng = body_of("human34"), np.random.default_rng(seed)
    speed = 0.6 * rng.normal(size=body.nv)
    speed[:6] = 0.5, 0.1, 0.0, 0.0, 0.0, 0.3
    q = np.array([body.clamp(body.integrate(body.neutral, np.sin(t / 8.0) * speed)) for t in range(FRAMES)])
    q[:, 0] += 1.0
    q[:, 2] += 1.0
    points = body.landmarks_of(body.placed(q))
    places = {name: points[:, i] for i, name in enumerate(body.landmark_names)}
    return places | {"head": places["head_top"], "neck": 0.5 * (places["left_shoulder"] + places["right_shoulder"])}


def in_order(name: str, seed: int, noise: float = 0.0) -> np.ndarray:
    """(T, J, 3) [m] of `moving` as a program writes them; joints that are not landmarks lie in the trunk."""
    places, rng = moving(seed), np.random.default_rng(seed)
    hips = 0.5 * (places["left_hip"] + places["right_hip"])
    elsewhere = [hips + rng.uniform(0.0, 1.0) * (places["neck"] - hips) for _ in ORDERS[name]]
    joints = [places.get(own or "", other) for own, other in zip(ORDERS[name], elsewhere, strict=True)]
    points = np.stack(joints, axis=1)
    return np.asarray(points + noise * rng.normal(size=points.shape))


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_order_is_found_by_its_limbs(seed: int, noise: float) -> None:
    for name in ORDERS:
        joints = in_order(name, seed, noise)
        misfits = {other: order_misfit(joints, ORDERS[other]) for other in orders_of(joints.shape[1])}
        assert clear_order(misfits) == name
        assert misfits[name].value < 1.0
        others = {other: misfit for other, misfit in misfits.items() if other != name}
        assert all(misfit.value > 1.0 for misfit in others.values()), "read for another program's"


@pytest.mark.parametrize("name", ["lafan1", "kinect25", "h36m17"])
def test_a_file_in_another_order(tmp_path: Path, name: str) -> None:
    joints = in_order(name, 2)
    np.savez(tmp_path / "a.npz", positions=joints, fps=RATE)
    read = load_source(tmp_path / "a.npz", SourceOptions(up="z"))
    for knee in KNEES:
        assert read.landmark(knee) == pytest.approx(moving(2)[knee])
    assert f"in the order of {name}" in read.notes[0]
    given = load_source(tmp_path / "a.npz", SourceOptions(up="z", layout=name))
    assert given.notes == ()
    assert given.points == pytest.approx(read.points)


@pytest.mark.parametrize(("name", "seed"), [("smpl", 3), ("kinect32", 4)])
def test_an_unknown_order_is_refused(tmp_path: Path, name: str, seed: int) -> None:
    joints = in_order(name, seed)[:, np.random.default_rng(seed).permutation(len(ORDERS[name]))]
    np.savez(tmp_path / "a.npz", joints=joints, fps=RATE)
    with pytest.raises(InputError, match=rf"fit no known order: as .* \(--layout .*{name}") as raised:
        load_source(tmp_path / "a.npz", SourceOptions(up="z"))
    assert "a.npz" in str(raised.value)
    forced = load_source(tmp_path / "a.npz", SourceOptions(up="z", layout=name))
    assert f"not a body's in the order of {name}: the " in forced.notes[0]


def test_invalid_layouts(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", joints=in_order("lafan1", 0), fps=RATE)
    with pytest.raises(InputError, match=r"not an order of joints .*lafan1"):
        load_source(tmp_path / "a.npz", SourceOptions(up="z", layout="lafan"))
    with pytest.raises(InputError, match="kinect25 has 25 joints; --layout smpl or lafan1"):
        load_source(tmp_path / "a.npz", SourceOptions(up="z", layout="kinect25"))
    named = SourceMotion(KNEES, np.zeros((2, 2, 3)), np.arange(2.0), "here")
    with pytest.raises(InputError, match="layout: this source has names of its own"):
        load_source(named, SourceOptions(layout="smpl"))


def test_names_and_layout_words_in_a_file(tmp_path: Path) -> None:
    """Names take precedence over lengths."""
    joints = in_order("lafan1", 5)
    names = [name or f"spine{i}" for i, name in enumerate(ORDERS["lafan1"])]
    turned = np.random.default_rng(0).permutation(len(names))
    np.savez(tmp_path / "a.npz", joints=joints[:, turned], joint_names=np.array(names)[turned], fps=RATE)
    np.savez(tmp_path / "b.npz", joints=joints, skeleton="LAFAN1", fps=RATE)
    for name in ("a.npz", "b.npz"):
        read = load_source(tmp_path / name, SourceOptions(up="z"))
        assert read.notes == ()
        assert read.landmark("left_knee") == pytest.approx(moving(5)["left_knee"])


@pytest.mark.parametrize(
    "names",
    [
        ("Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase", "LeftArm", "LeftForeArm", "LeftHand"),
        ("pelvis", "L_Hip", "L_Knee", "L_Ankle", "L_Foot", "L_Shoulder", "L_Elbow", "L_Wrist"),
        ("SpineBase", "HIP_LEFT", "KNEE_LEFT", "ANKLE_LEFT", "FOOT_LEFT", "SHOULDER_LEFT", "ELBOW_LEFT", "WRIST_LEFT"),
        ("Root", "HipLeft", "KneeLeft", "AnkleLeft", "FootLeft", "ShoulderLeft", "ElbowLeft", "WristLeft"),
    ],
)
def test_programs_names(names: tuple[str, ...]) -> None:
    meant = ("hip", "knee", "ankle", "big_toe", "shoulder", "elbow", "wrist")
    assert landmarks_named(names) == (None, *(f"left_{part}" for part in meant))


@pytest.mark.parametrize(("first", "after"), [(5, 12), (20, 23)])
def test_joints_at_zero_are_missing(tmp_path: Path, first: int, after: int) -> None:
    joints = in_order("smpl", 6)
    knee = ORDERS["smpl"].index("left_knee")
    joints[first:after] = 0.0
    joints[after + 3, knee] = 0.0
    np.savez(tmp_path / "a.npz", joints=joints, fps=RATE)
    read = load_joints(tmp_path / "a.npz", up="z")
    missing = np.isnan(read.points).all(axis=2)
    assert missing[first:after].all()
    assert missing.sum() == (after - first) * len(read.names) + 1
    assert np.isnan(read.landmark("left_knee")[after + 3]).all()
    assert len(read.notes) == 1
    assert f"all joints of {after - first} frames and 1 single joint are at exactly zero" in read.notes[0]


@pytest.mark.parametrize("order", ["h36m17", "kinect25"])
def test_an_origin_in_the_body_is_not_a_gap(tmp_path: Path, order: str) -> None:
    joints = in_order(order, 7)
    joints -= joints[:, :1]
    joints[3] = 0.0
    np.savez(tmp_path / "a.npz", joints=joints, fps=RATE)
    read = load_joints(tmp_path / "a.npz", up="z")
    known = np.isfinite(read.landmark("mid_hip")).all(axis=1)
    assert not known[3]
    assert known.sum() == FRAMES - 1
    assert "single" not in read.notes[0]


def test_a_limb_that_is_never_found_is_missing(tmp_path: Path) -> None:
    """Unless the origin lies in the middle of the body."""
    joints = in_order("smpl", 8)
    joints[:, ORDERS["smpl"].index("right_wrist")] = 0.0
    np.savez(tmp_path / "a.npz", joints=joints, fps=RATE)
    assert np.isnan(load_joints(tmp_path / "a.npz", up="z").landmark("right_wrist")).all()


def test_an_order_that_is_given_stays_with_the_run(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", joints=in_order("lafan1", 0)[:4], fps=RATE)
    how = {"layout": "lafan1", "up": "z", "unit": "m"}
    run = km.retarget(tmp_path / "a.npz", "example-robot-data:g1", method="frames", out=tmp_path / "a.run", **how)
    assert run.header.request is not None
    assert {name: (word,) for name, word in how.items()}.items() <= run.header.request.items()
