"""Motions for trainers, read back: q is unchanged, links are where the body has them, times are even."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import kinemode as km
from humanoid.kinematics.body import Body
from humanoid.subject.example_robots import installed
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from tests.builders import body_of
from tests.made_runs import made_run
from tests.test_exports_of_bodies import MACHINE

FRAMES, RATE = 12, 50.0
BODIES = ("human34", "arm8", "machine", "example-robot-data:g1")


@pytest.fixture(params=BODIES)
def body(request: pytest.FixtureRequest, tmp_path: Path) -> Body:
    name = request.param
    if name.startswith("example") and "g1" not in installed():
        pytest.skip("example-robot-data is not installed")
    if name != "machine":
        return body_of(name)
    (tmp_path / "machine.urdf").write_text(MACHINE)
    return Body(load_subject(tmp_path / "machine.urdf"))


def moved(body: Body, frames: int = FRAMES) -> np.ndarray:
    """Poses (T, nq) that follow each other smoothly, turning by more than one whole turn."""
    v = np.random.default_rng(3).normal(size=body.nv)
    if body.has_free_root:
        v[5] = 8.0
    return np.array([body.integrate(body.neutral, s * v) for s in np.linspace(0.0, 1.0, frames)])


def rebuilt(body: Body, root: np.ndarray | None, joints: dict[str, np.ndarray]) -> np.ndarray:
    """q (T, nq) from a root's (T, 7) and joints (T) by name."""
    q = np.full((FRAMES, body.nq), np.nan)
    if root is not None:
        q[:, :7] = root
    for j in range(2 if body.has_free_root else 1, body.model.njoints):
        at, value = body.model.idx_qs[j], joints[body.model.names[j]]
        if body.model.nqs[j] == 1:
            q[:, at] = value
        else:
            q[:, at : at + 2] = np.column_stack([np.cos(value), np.sin(value)])
    return q


def same(body: Body, q: np.ndarray, expected: np.ndarray) -> None:
    if body.has_free_root:  # a quaternion and its negative are the same rotation
        signs = np.sign(np.sum(q[:, 3:7] * expected[:, 3:7], axis=1))
        q[:, 3:7] *= signs[:, None]
    np.testing.assert_allclose(q, expected, rtol=0.0, atol=1e-12)


def test_npz_is_read_back(body: Body, tmp_path: Path) -> None:
    q = moved(body)
    run = made_run(tmp_path / "a.run", body.subject, q[:, None], times=np.arange(FRAMES) / RATE)
    with np.load(km.export(run, tmp_path / "a.npz", format="motion-npz")) as file:
        read = {name: file[name] for name in file.files}
    assert read["fps"] == RATE
    assert ("root_position" in read) == body.has_free_root
    root = np.column_stack([read["root_position"], read["root_quaternion_xyzw"]]) if body.has_free_root else None
    joints = dict(zip(read["joint_names"].tolist(), read["joint_position"].T, strict=True))
    same(body, rebuilt(body, root, joints), run.q)
    speed = np.gradient(read["joint_position"], 1.0 / RATE, axis=0)
    np.testing.assert_allclose(read["joint_velocity"], speed, atol=1e-9)
    data = body.model.createData()
    for t in (0, FRAMES - 1):
        pin.framesForwardKinematics(body.model, data, run.q[t])
        for b, name in enumerate(read["link_names"].tolist()):
            frame = data.oMf[body.model.getFrameId(name, pin.FrameType.BODY)]
            np.testing.assert_allclose(read["link_position"][t, b], frame.translation, atol=1e-9)
            R = pin.Quaternion(read["link_quaternion_xyzw"][t, b]).toRotationMatrix()
            np.testing.assert_allclose(R, frame.rotation, atol=1e-9)
    for turns in (read["link_quaternion_xyzw"], *([read["root_quaternion_xyzw"]] if body.has_free_root else [])):
        assert (np.sum(turns[1:] * turns[:-1], axis=-1) > 0.0).all()


def test_csv_is_read_back(body: Body, tmp_path: Path) -> None:
    run = made_run(tmp_path / "a.run", body.subject, moved(body)[:, None], times=np.arange(FRAMES) / RATE)
    file = km.export(run, tmp_path / "a.csv", format="motion-csv")
    head, *rows = csv.reader(file.read_text().splitlines())
    values = np.array(rows, dtype=float)
    first = 7 if body.has_free_root else 0
    assert head[:first] == ["root_x", "root_y", "root_z", "root_qx", "root_qy", "root_qz", "root_qw"][:first]
    joints = dict(zip(head[first:], values[:, first:].T, strict=True))
    same(body, rebuilt(body, values[:, :7] if first else None, joints), run.q)


def test_joints_and_links_are_in_the_order_of_the_urdf(tmp_path: Path) -> None:
    link, joint = '<link name="{}"/>', '<joint name="{0}" type="{3}"><parent link="{1}"/><child link="{2}"/></joint>'
    parts = [link.format(name) for name in ("base", "z_arm", "a_arm", "cap")]
    parts += [
        joint.format("z", "base", "z_arm", "continuous"), joint.format("a", "base", "a_arm", "continuous"),
        joint.format("glue", "a_arm", "cap", "fixed"),
    ]  # fmt: skip
    (tmp_path / "two.urdf").write_text(f'<robot name="two">{"".join(parts)}</robot>')
    body = Body(load_subject(tmp_path / "two.urdf"))
    run = made_run(tmp_path / "a.run", body.subject, np.tile(body.neutral, (3, 1, 1)))
    with np.load(km.export(run, tmp_path / "a.npz", format="motion-npz")) as file:
        assert file["joint_names"].tolist() == ["z", "a"]
        assert file["link_names"].tolist() == ["base", "z_arm", "a_arm", "cap"]


def test_uneven_times_become_even_and_missing_poses_are_refused(tmp_path: Path) -> None:
    body = body_of("arm8")
    q = moved(body)[:, None]
    times = np.concatenate([np.arange(6) / RATE, (np.arange(6) + 8) / RATE])
    run = made_run(tmp_path / "a.run", body.subject, q, times=times)
    with pytest.warns(km.InputWarning, match="not evenly spaced: motion-npz has poses between them, at 50 a second"):
        file = km.export(run, tmp_path / "a.npz", format="motion-npz")
    with np.load(file) as read:
        assert len(read["joint_position"]) == FRAMES + 2
    q = q.copy()
    q[4] = np.nan
    run = made_run(tmp_path / "b.run", body.subject, q, times=np.arange(FRAMES) / RATE)
    with pytest.raises(InputError, match=rf"b\.run: has no pose in 1 of {FRAMES} frames.*npz marks them"):
        km.export(run, tmp_path / "b.npz", format="motion-npz")
