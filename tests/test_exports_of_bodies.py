"""Exports for animation and for laboratories, read by other readers: bvh, c3d, glb, rrd."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from test_run_file import header, state_of, walk

from estimator.data.formats.bvh import read_bvh, write_bvh
from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.runs.bvh_skeleton import bvh_motion, skeleton_of
from estimator.runs.run_file import RunWriter
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode import export
from tests.builders import body_of
from viz.gltf import link_names

FRAMES = 9
NEVER_SEEN = 4  # the frame without a visible person
MACHINE = """<robot name="machine"><link name="rail"/><link name="cart"/><link name="wheel"/><link name="arm one"/>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><origin xyz="0 0 1" rpy="0.3 0.2 1"/>
<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="spin" type="continuous"><parent link="cart"/><child link="wheel"/><axis xyz="0 1 0"/></joint>
<joint name="lift" type="revolute"><parent link="wheel"/><child link="arm one"/><origin xyz="0 .5 0" rpy="1 0 2"/>
<axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<link name="tip"/><joint name="reach" type="prismatic"><parent link="arm one"/><child link="tip"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A walk with several hypotheses; in one frame no person was seen."""
    file = tmp_path_factory.mktemp("run") / "a.run"
    with RunWriter.create(file, header(FRAMES)) as writer:
        for i, result in enumerate(walk(body_of("human34"), FRAMES)):
            if i == NEVER_SEEN:
                result = type(result)(**{**vars(result), "status": "unobserved"})
            writer.append(result, state_of(result))
    return Run.open(file)


# --- bvh ---


@pytest.fixture(params=["human34", "arm8", "upper13", "machine"])
def body(request: pytest.FixtureRequest, tmp_path: Path) -> Body:
    if request.param != "machine":
        return body_of(request.param)
    (tmp_path / "machine.urdf").write_text(MACHINE)
    return Body(load_subject(tmp_path / "machine.urdf"))


def test_a_skeleton_of_any_tree_is_where_the_body_is(body: Body, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    q = np.array([body.integrate(body.neutral, rng.normal(size=body.nv)) for _ in range(30)])
    write_bvh(tmp_path / "a.bvh", bvh_motion(body, q, np.arange(30) / 50.0))
    read, skeleton = read_bvh(tmp_path / "a.bvh"), skeleton_of(body)
    assert read.frame_time == pytest.approx(0.02)
    places = 0.01 * read.positions() @ R_OPENSIM_WORLD  # metres, z up
    of_joint = dict(zip(skeleton.names, skeleton.joints.tolist(), strict=True))
    placed = body.placed(q).placements
    for name in read.names:
        place = places[:, read.names.index(name)]
        if name in of_joint:
            np.testing.assert_allclose(place, placed[:, of_joint[name], 9:], atol=1e-6)
        else:  # an end site is fixed to its joint, so the joint's rotation is right too
            joint = of_joint[name.removesuffix("_end")]
            R = placed[:, joint, :9].reshape(-1, 3, 3)  # transposed
            fixed = np.einsum("tab,tb->ta", R, place - placed[:, joint, 9:])
            assert np.linalg.norm(fixed[0]) > 0.01
            own = body.landmark_local[body.landmark_joint == joint]
            own = own[np.linalg.norm(own, axis=1) > 0.01]
            assert not len(own) or np.linalg.norm(own - fixed[0], axis=1).min() < 1e-6
            np.testing.assert_allclose(fixed - fixed[0], 0.0, atol=1e-6)


def test_hinges_at_one_place_are_one_joint_and_zero_stands_upright() -> None:
    body = body_of("human34")
    motion = bvh_motion(body, pin.neutral(body.model)[None], np.zeros(1))
    channels = [kind for j, kind in motion.channels if motion.names[j] == "left_thigh"]
    assert channels == ["Zrotation", "Xrotation", "Yrotation"]
    assert motion.names[0] == "pelvis"
    assert "left_hip_flexion_link" not in motion.names
    np.testing.assert_allclose(motion.values, 0.0, atol=1e-9)
    height = dict(zip(motion.names, motion.rest()[:, 1], strict=True))  # [cm], y up
    assert height["left_foot"] < -70.0 < 0.0 < height["torso"] < height["neck"]
    np.testing.assert_allclose(motion.rest(), motion.positions()[0], atol=1e-9)


def test_missing_poses_are_held() -> None:
    body = body_of("arm8")
    q = np.tile(body.neutral, (5, 1))
    q[2, 0] += 0.1
    q[[0, 3]] = np.nan
    values = bvh_motion(body, q, np.arange(5) / 30.0).values
    np.testing.assert_array_equal(values[0], values[1])
    np.testing.assert_array_equal(values[3], values[2])
    assert (values[2] != values[1]).any()


# --- c3d ---


def test_c3d(run: Run, tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d", reason="the extra c3d is not installed")
    file = ezc3d.c3d(str(export(run, tmp_path / "a.c3d")))
    point, data = file["parameters"]["POINT"], file["data"]["points"]
    labels, count = point["LABELS"]["value"], len(run.body.landmark_names)
    assert tuple(labels[:count]) == run.body.landmark_names
    assert (point["UNITS"]["value"], point["ANGLE_UNITS"]["value"]) == (["mm"], ["deg"])
    assert point["RATE"]["value"][0] == pytest.approx(30.0)
    seen = np.arange(FRAMES) != NEVER_SEEN
    np.testing.assert_allclose(data[:3, :count].T[seen], 1e3 * run.landmarks[seen], atol=1e-3)
    assert (file["data"]["meta_points"]["residuals"][0, :, NEVER_SEEN] == -1.0).all()
    assert (file["data"]["meta_points"]["residuals"][0][:, seen] == 0.0).all()
    for name in ("left_knee_flexion", "right_elbow_flexion"):
        assert name in point["ANGLES"]["value"]
        angle = np.deg2rad(data[0, labels.index(name)])
        np.testing.assert_allclose(angle[seen], run.q[seen, run.body.q_names.index(name)], atol=1e-6)


def test_sliding_joints_are_scalars_in_millimetres(tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d", reason="the extra c3d is not installed")
    (tmp_path / "machine.urdf").write_text(MACHINE)
    subject = load_subject(tmp_path / "machine.urdf")
    body = Body(subject)
    described = header(3, subject_urdf=subject.urdf, subject_source=subject.name, subject_base=subject.base)
    with RunWriter.create(tmp_path / "a.run", described) as writer:
        for result in walk(body, 3):
            writer.append(result, state_of(result))
    run = Run.open(tmp_path / "a.run")
    file = ezc3d.c3d(str(export(run, tmp_path / "a.c3d")))
    point, data = file["parameters"]["POINT"], file["data"]["points"]
    assert point["SCALAR_UNITS"]["value"] == ["mm"]
    assert set(point["SCALARS"]["value"]) == {"slide", "reach"}
    for name in ("slide", "reach"):
        place = 1e-3 * data[0, point["LABELS"]["value"].index(name)]
        np.testing.assert_allclose(place, run.q[:, body.q_names.index(name)], atol=1e-6)


@pytest.mark.parametrize(("module", "ending", "extra"), [("ezc3d", "c3d", "c3d"), ("rerun", "rrd", "rerun")])
def test_a_missing_library_is_one_line(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, ending: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"{module}: is not installed.*{ending}.*pip install 'kinemode\[{extra}\]'"):
        export(run, tmp_path / f"a.{ending}")
    assert not list(tmp_path.iterdir())


def test_an_unknown_ending_lists_all(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no export format 'fbx' \(one of npz, csv, trc, mot, .*c3d, bvh.*glb, rrd\)"):
        export(run, tmp_path / "a.fbx")


# --- glb ---


def glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary part of a glb, by its specification."""
    data = path.read_bytes()
    assert data[:4] == b"glTF"
    assert struct.unpack("<II", data[4:12]) == (2, len(data))
    length, kind = struct.unpack("<I4s", data[12:20])
    assert kind == b"JSON"
    size, kind = struct.unpack("<I4s", data[20 + length : 28 + length])
    assert (kind, size) == (b"BIN\0", len(data) - length - 28)
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def values(tree: dict[str, Any], binary: bytes, accessor: int) -> np.ndarray:
    entry = tree["accessors"][accessor]
    view = tree["bufferViews"][entry["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[entry["type"]]
    part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    return np.frombuffer(part, "<f4")[: entry["count"] * width].reshape(entry["count"], width)


def test_glb(run: Run, tmp_path: Path) -> None:
    file = export(run, tmp_path / "a.glb")
    tree, binary = glb(file)
    names, placed = link_names(run.body), run.body.placed(run.q).placements
    (animation,) = tree["animations"]
    moved = set()
    for channel in animation["channels"]:
        sampler, node = animation["samplers"][channel["sampler"]], tree["nodes"][channel["target"]["node"]]
        placement = placed[:, names.index(node["name"])]
        np.testing.assert_allclose(values(tree, binary, sampler["input"])[:, 0], run.time - run.time[0], atol=1e-6)
        got = values(tree, binary, sampler["output"])
        if channel["target"]["path"] == "translation":
            np.testing.assert_allclose(got, placement[:, 9:], atol=1e-6)
        else:
            R = Rotation.from_quat(got).as_matrix()
            np.testing.assert_allclose(R, placement[:, :9].reshape(-1, 3, 3).swapaxes(1, 2), atol=1e-5)
        assert "matrix" not in node
        moved.add((node["name"], channel["target"]["path"]))
    assert {name for name, _ in moved} == {flesh.link for flesh in run.subject.flesh} - {
        "left_hand",
        "right_hand",
        "head",
    }
    assert len(moved) == len(animation["channels"])
    scene = trimesh.load(file)  # in the pose of the first frame
    for name in ("pelvis", "left_shank"):
        place = R_OPENSIM_WORLD @ placed[0, names.index(name), 9:]
        np.testing.assert_allclose(scene.graph.get(name)[0][:3, 3], place, atol=1e-6)
    assert len(scene.geometry) == len(tree["meshes"])


def test_a_robot_as_glb_needs_no_flesh(tmp_path: Path) -> None:
    from viz.gltf import animated_glb

    (tmp_path / "machine.urdf").write_text(MACHINE)
    body = Body(load_subject(tmp_path / "machine.urdf"))
    ways = np.linspace(0.0, 7.0, 30)[:, None] * np.array([0.1, 1.0, 0.1, 0.1])
    q = np.array([body.integrate(body.neutral, way) for way in ways])
    (tmp_path / "a.glb").write_bytes(animated_glb(body, q, np.arange(30) / 10.0))
    tree, binary = glb(tmp_path / "a.glb")
    for sampler in tree["animations"][0]["samplers"]:
        got = values(tree, binary, sampler["output"])
        assert got.shape[1] == 3 or (np.sum(got[1:] * got[:-1], axis=1) > 0.9).all()  # no quaternion sign flips
    drawn = {tree["nodes"][channel["target"]["node"]]["name"] for channel in tree["animations"][0]["channels"]}
    assert drawn == {"rail", "wheel"}  # links with a next joint at some distance


# --- rrd ---


def test_rrd(run: Run, tmp_path: Path) -> None:
    rr = pytest.importorskip("rerun", reason="the extra rerun is not installed")
    file = export(run, tmp_path / "a.rrd")
    columns: dict[str, dict[str, list[Any]]] = {}
    for chunk in rr.chunk.RrdReader(str(file)).stream():
        batch, mine = chunk.to_record_batch(), columns.setdefault(chunk.entity_path, {})
        for key in set(batch.schema.names) - {"time"}:
            mine.setdefault(key, []).extend(batch.column(key).to_pylist())
    names, placed = link_names(run.body), run.body.placed(run.q).placements
    pelvis = columns["/world/body/pelvis"]
    translation = np.array(pelvis["Transform3D:translation"]).reshape(-1, 3)
    np.testing.assert_allclose(translation, placed[:, names.index("pelvis"), 9:], atol=1e-6)
    assert pelvis["frame"] == list(range(FRAMES))
    knee = np.array(columns["/angles/left_knee_flexion"]["Scalars:scalars"][-FRAMES:]).reshape(-1)
    np.testing.assert_allclose(knee, np.rad2deg(run.q[:, run.body.q_names.index("left_knee_flexion")]), rtol=1e-9)
    std = np.array(columns["/angles/left_knee_flexion/std"]["Scalars:scalars"][-FRAMES:]).reshape(-1)
    np.testing.assert_allclose(std, np.rad2deg(run.std[:, run.body.v_names.index("left_knee_flexion")]), rtol=1e-6)
    assert any(path.startswith("/world/hypotheses/") for path in columns)
    assert "Pinhole:image_from_camera" in columns["/world/cameras/a"]
