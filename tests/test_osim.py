"""Models for OpenSim: their markers follow our landmarks in every pose of the motion file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from builders import MULTIPLIER, OFFSET, body_of, gripper, random_pose
from osim_reader import OsimModel, numbers, offset

from estimator.data.formats.opensim import R_OPENSIM_WORLD, read_mot, write_mot
from estimator.data.formats.osim import body_xyz, component_name, write_osim
from estimator.runs.coordinates import opensim_coordinates
from estimator.runs.opensim_model import opensim_model
from humanoid.kinematics.body import Body
from humanoid.shape.segment_masses import ADULT, LEAST, flesh_of
from humanoid.subject.subject import load_subject, subject_from_text
from humanoid.support.errors import InputError

POSES = 12
JOINTS_OF_ALL_KINDS = """<robot name="all kinds"><link name="base plate"/>
<joint name="cart" type="planar"><parent link="base plate"/><child link="cart"/>
  <origin xyz="1 2 0.5" rpy="0.3 0.1 -0.7"/><axis xyz="0 0 1"/></joint>
<link name="cart"/>
<joint name="wheel" type="continuous"><parent link="cart"/><child link="wheel"/>
  <origin xyz="0 0.2 0.1" rpy="0 1.5707963267948966 0.4"/><axis xyz="1 2 -0.5"/></joint>
<link name="wheel"/>
<joint name="lift" type="prismatic"><parent link="cart"/><child link="lift"/><origin xyz="0 0 1" rpy="1 1 1"/>
  <axis xyz="0 0.6 0.8"/><limit lower="-0.2" upper="0.5" effort="1" velocity="1"/></joint>
<link name="lift"/>
<joint name="yaw" type="revolute"><parent link="lift"/><child link="a"/><origin xyz="0 0.1 0" rpy="0.2 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="a"/>
<joint name="pitch" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0" rpy="0.5 -0.4 0.3"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="b"/>
<joint name="pitch again" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0 0"/>
  <axis xyz="0 1 0.01"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="c"/>
<joint name="loose" type="floating"><parent link="c"/><child link="d"/><origin xyz="0 0 0.3" rpy="0 0 1"/></joint>
<link name="d"/>
<landmark name="on plate" link="base plate" xyz="0.1 0 0"/><landmark name="on cart" link="cart" xyz="0 0.1 0"/>
<landmark name="on wheel" link="wheel" xyz="0.1 0.2 0.3"/><landmark name="on lift" link="lift" xyz="0 0 0.1"/>
<landmark name="on c" link="c" xyz="0.3 -0.1 0.2"/><landmark name="on d" link="d" xyz="0.1 0.1 -0.2"/>
</robot>"""


def fitted() -> Body:
    """human34 after a fit: other lengths, left and right alike."""
    subject = load_subject("human34")
    scales = {p.joint: 1.0 + 0.02 * (i - 3) for i, p in enumerate(subject.proportions)}
    return Body(subject.scaled(scales))


def all_kinds(tmp_path: Path) -> Body:
    path = tmp_path / "kinds.urdf"
    path.write_text(JOINTS_OF_ALL_KINDS)
    return Body(load_subject(path, base="fixed"))


NAMES = (
    "fitted human34", "human30", "upper13", "arm8", "example-robot-data:panda", "joints of all kinds",
    "gripper", "gripper, sliding", "gripper, still",
)  # fmt: skip


def body_named(name: str, tmp_path: Path) -> Body:
    if name == "fitted human34":
        return fitted()
    if name == "gripper, sliding":
        return Body(subject_from_text(gripper(master="knuckle", kind="prismatic"), source=name))
    if name == "gripper, still":  # a follower that its master does not move
        text = gripper().replace(f'multiplier="{MULTIPLIER}"', 'multiplier="0"')
        return Body(subject_from_text(text, source=name))
    if name == "joints of all kinds":
        return all_kinds(tmp_path)
    return body_of(name) if not name.startswith("example") else Body(load_subject(name))


def poses(body: Body) -> np.ndarray:
    """Random poses within the limits; continuous, planar and inner floating joints anywhere."""
    rng = np.random.default_rng(4)
    q = np.array([random_pose(body, rng) for _ in range(POSES)])
    for row in q:
        moved = pin.integrate(body.model, row, rng.normal(size=body.nv))
        free = ~np.isin(np.arange(body.nq), body.bounded_q)
        row[free] = moved[free]
    return q


def written(body: Body, tmp_path: Path, q: np.ndarray) -> tuple[Path, Path]:
    """A model and a motion file."""
    model, motion = tmp_path / "a.osim", tmp_path / "a.mot"
    write_osim(model, opensim_model(body, "a"))
    names, values = opensim_coordinates(body, q)
    write_mot(motion, names, values, np.arange(len(q)) / 30.0, title="a")
    return model, motion


@pytest.mark.parametrize("name", NAMES)
def test_markers_are_the_landmarks(name: str, tmp_path: Path) -> None:
    """Within a thousandth of a millimetre, by a second reader, at the values of the motion file."""
    body = body_named(name, tmp_path)
    q = poses(body)
    model, motion = written(body, tmp_path, q)
    read = OsimModel(model)
    (names, values, in_degrees), _ = read_mot(motion)
    assert in_degrees
    assert set(names) == set(read.coordinates)
    lengths = {n for n in names if n in slid(read)}
    for row, pose in zip(values, q, strict=True):
        named = {n: v if n in lengths else np.deg2rad(v) for n, v in zip(names, row, strict=True)}
        places = read.marker_places(named)
        theirs = np.array([places[component_name(n)] for n in body.landmark_names])
        ours = body.landmarks(body.at(pose)) @ R_OPENSIM_WORLD.T
        np.testing.assert_allclose(theirs, ours, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "follower"), [("gripper", "inner"), ("gripper, sliding", "inner"), ("gripper, still", "")]
)
def test_followers_go_where_their_leader_takes_them(name: str, follower: str, tmp_path: Path) -> None:
    """The model's own constraints give the followers' values of the motion file from the other coordinates alone."""
    body = body_named(name, tmp_path)
    model, motion = written(body, tmp_path, poses(body))
    read = OsimModel(model)
    (names, values, _), _ = read_mot(motion)
    assert {c.findtext("dependent_coordinate_name") for c in read.couplings} == ({follower} if follower else set())
    assert ("inner" in read.coordinates) == bool(follower)  # one that cannot move is welded, at its offset
    for coupling in read.couplings:
        coefficients = numbers(coupling, "coupled_coordinates_function/LinearFunction/coefficients")
        np.testing.assert_array_equal(coefficients, [MULTIPLIER, OFFSET])
    lengths = slid(read)
    for row in values:
        named = {n: v if n in lengths else np.deg2rad(v) for n, v in zip(names, row, strict=True)}
        leaders = {n: 9.0 if n == follower else v for n, v in named.items()}
        assert read.coupled(leaders) == pytest.approx(named, abs=1e-8)  # rounding in the file


def slid(read: OsimModel) -> set[str]:
    """The coordinates that are lengths."""
    axes = [axis for joint in read.joints for axis in joint.iter("TransformAxis")]
    named = {axis.findtext("coordinates") or "" for axis in axes if (axis.get("name") or "").startswith("translation")}
    return named - {""}


def test_turns_about_one_point_are_one_joint(tmp_path: Path) -> None:
    """Unless a body lies between them, as the belly between the joints of the back."""
    read = OsimModel(written(body_of("human34"), tmp_path, body_of("human34").neutral[None])[0])
    joints = {joint.get("name"): [c.get("name") for c in joint.iter("Coordinate")] for joint in read.joints}
    assert joints["left_hip"] == [f"left_hip_{n}" for n in ("flexion", "abduction", "rotation")]
    assert joints["root"] == [f"root_{n}" for n in ("tilt", "list", "rotation", "x", "y", "z")]
    assert joints["lumbar_flexion"] == ["lumbar_flexion"]
    assert joints["lumbar"] == ["lumbar_lateral", "lumbar_axial"]
    assert len(set(joints)) == len(read.joints) == len(read.segments) == 16
    parts = OsimModel(written(all_kinds(tmp_path), tmp_path, all_kinds(tmp_path).neutral[None])[0])
    apart = [[c.get("name") for c in joint.iter("Coordinate")] for joint in parts.joints]
    assert ["yaw", "pitch"] in apart  # with a fixed turn between them
    assert ["pitch_again"] in apart  # whose axis is nearly the same


def test_coordinates_keep_the_limits_and_start_at_rest(tmp_path: Path) -> None:
    body = body_of("human34")
    read = OsimModel(written(body, tmp_path, body.neutral[None])[0])
    for i in body.bounded_q:
        coordinate = read.coordinates[body.q_names[i]]
        np.testing.assert_array_equal(numbers(coordinate, "range"), [body.lower[i], body.upper[i]])
        assert float(coordinate.findtext("default_value") or "") == body.neutral[i]
        assert coordinate.findtext("clamped") == "true"
    assert read.coordinates["root_tilt"].findtext("clamped") == "false"


def test_masses_of_the_urdf_are_kept(tmp_path: Path) -> None:
    """The centre of mass is where Pinocchio has it, and every segment's inertia about any of its own axes."""
    body = body_named("example-robot-data:panda", tmp_path)
    q = poses(body)[0]
    read = OsimModel(written(body, tmp_path, q[None])[0])
    (names, values) = opensim_coordinates(body, q[None])
    lengths = slid(read)
    placed = read.at({n: v if n in lengths else np.deg2rad(v) for n, v in zip(names, values[0], strict=True)})
    mass = {name: float(segment.findtext("mass") or "") for name, segment in read.segments.items()}
    centre = {name: placed[name] * numbers(segment, "mass_center") for name, segment in read.segments.items()}
    total = sum(mass.values())
    data = body.model.createData()
    fixed = body.model.inertias[0]  # of the fixed part, which Pinocchio leaves out
    moving = pin.centerOfMass(body.model, data, q)
    whole = (data.mass[0] * moving + fixed.mass * fixed.lever) / (data.mass[0] + fixed.mass)
    assert total == pytest.approx(data.mass[0] + fixed.mass)
    np.testing.assert_allclose(sum(mass[n] * centre[n] for n in mass) / total, R_OPENSIM_WORLD @ whole, atol=1e-9)
    placements = body.at(q).rotations
    for j, segment in enumerate(read.segments.values()):
        xx, yy, zz, xy, xz, yz = numbers(segment, "inertia")
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        R = placed[segment.get("name", "")].rotation
        world = R_OPENSIM_WORLD @ placements[j] @ body.model.inertias[j].inertia @ placements[j].T @ R_OPENSIM_WORLD.T
        np.testing.assert_allclose(R @ tensor @ R.T, world, atol=1e-9)


def test_masses_of_an_adult_where_the_urdf_has_none(tmp_path: Path) -> None:
    body = fitted()
    read = OsimModel(written(body, tmp_path, body.neutral[None])[0])
    mass = {name: float(segment.findtext("mass") or "") for name, segment in read.segments.items()}
    assert sum(mass.values()) == pytest.approx(ADULT, abs=0.01)
    assert mass["left_thigh"] == mass["right_thigh"] == pytest.approx(0.1345 * ADULT, rel=2e-3)
    assert mass["left_clavicle"] == LEAST
    for segment in read.segments.values():
        moments = numbers(segment, "inertia")
        assert np.linalg.eigvalsh(np.diag(moments[:3]))[0] > 0.0
        assert moments[:3].max() < moments[:3].sum() - moments[:3].max()  # as of any body with an extent
    places = dict(zip(body.landmark_names, body.landmarks(body.at(body.neutral)), strict=True))
    shank, placed = read.segments["left_shank"], body.at(body.neutral)
    j = joint_of(body, "left_shank")
    centre = placed.translations[j] + placed.rotations[j] @ R_OPENSIM_WORLD.T @ numbers(shank, "mass_center")
    share = np.linalg.norm(centre - places["left_knee"]) / np.linalg.norm(places["left_ankle"] - places["left_knee"])
    assert share == pytest.approx(np.linalg.norm([0.0485, 0.407, 0.019]), abs=1e-3)
    assert "65 kg" in (read.model.findtext("credits") or "")
    assert "those of the URDF" in opensim_model(body_named("example-robot-data:panda", tmp_path), "a").credits


def joint_of(body: Body, link: str) -> int:
    return int(body.model.frames[body.model.getFrameId(link)].parentJoint)


def inside(size: tuple[float, float, float], placed: pin.SE3) -> np.ndarray:
    """Points spread evenly in an ellipsoid, in proportion to its volume, in its parent frame."""
    rng, box = np.random.default_rng(5), np.array(size)
    points = rng.uniform(-box, box, (round(1e8 * box.prod()), 3))
    return points[np.square(points / box).sum(axis=1) < 1.0] @ placed.rotation.T + placed.translation


def test_what_is_displayed_lies_where_the_flesh_does(tmp_path: Path) -> None:
    body = fitted()
    read = OsimModel(written(body, tmp_path, body.neutral[None])[0])
    (frame,) = read.segments["left_thigh"].iterfind("components/PhysicalOffsetFrame")
    ((flesh, placed),) = flesh_of(body, joint_of(body, "left_thigh"))
    radii, shown = numbers(frame, "attached_geometry/Ellipsoid/radii"), offset(frame)
    for ours, theirs in ((2, 1), (0, 0), (1, 2)):  # our z is their y
        end = placed * (flesh.size[ours] * np.eye(3)[ours])
        sign = -1.0 if ours == 1 else 1.0
        np.testing.assert_allclose(shown * (sign * radii[theirs] * np.eye(3)[theirs]), R_OPENSIM_WORLD @ end, atol=1e-9)


def test_turns_of_a_frame() -> None:
    rng = np.random.default_rng(0)
    right = [pin.exp3(np.array([0.0, side * np.pi / 2, 0.0])) @ pin.exp3(np.array([0.3, 0.0, 0.0])) for side in (1, -1)]
    for R in [*(pin.exp3(rng.normal(size=3) * 2.0) for _ in range(20)), *right]:
        x, y, z = body_xyz(R)
        about = [pin.exp3(angle * axis) for angle, axis in zip((x, y, z), np.eye(3), strict=True)]
        np.testing.assert_allclose(about[0] @ about[1] @ about[2], R, atol=1e-12)


def test_a_joint_unknown_to_opensim_is_refused(tmp_path: Path) -> None:
    body = body_of("arm8")
    model = pin.Model(body.model)
    model.addJoint(1, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    with pytest.raises(InputError, match="ball neither turns nor slides"):
        opensim_model(Body(body.subject, model), "a")


@pytest.fixture
def osim() -> Any:
    module: Any = pytest.importorskip("opensim", reason="OpenSim is not installed: pip install opensim")
    module.Logger.setLevelString("error")
    return module


class InOpenSim:
    """A model and a motion as OpenSim itself loads them."""

    def __init__(self, osim: Any, path: Path, motion: Path) -> None:
        self.model = osim.Model(str(path))
        self.state = self.model.initSystem()
        self.table = osim.Storage(str(motion))
        self.model.getSimbodyEngine().convertDegreesToRadians(self.table)
        labels = self.table.getColumnLabels()
        self.labels = [labels.get(i) for i in range(1, labels.getSize())]
        coordinates = self.model.updCoordinateSet()
        self.following = {name for name in self.labels if coordinates.get(name).isDependent(self.state)}

    def places(self, t: int, names: tuple[str, ...], *, coupled: bool) -> np.ndarray:
        """Markers (L, 3) [m] at row t; coupled: followers are left to the model's constraints."""
        row = self.table.getStateVector(t).getData()
        for i, label in enumerate(self.labels):
            if not (coupled and label in self.following):
                self.model.updCoordinateSet().get(label).setValue(self.state, row.get(i), False)
        if coupled:
            self.model.assemble(self.state)
        self.model.realizePosition(self.state)
        markers = self.model.getMarkerSet()
        points = [markers.get(component_name(name)).getLocationInGround(self.state) for name in names]
        return np.array([[point.get(k) for k in range(3)] for point in points])


@pytest.mark.parametrize("name", NAMES)
def test_opensim_poses_the_markers_as_ours(osim: Any, name: str, tmp_path: Path) -> None:
    """Measure 3: OpenSim itself loads model and motion; its markers are ours within 1e-3 mm over the clip, also where
    joints follow others and only their leaders are driven."""
    body = body_named(name, tmp_path)
    q = poses(body)
    there = InOpenSim(osim, *written(body, tmp_path, q))
    coordinates = there.model.getCoordinateSet()
    assert set(there.labels) == {coordinates.get(i).getName() for i in range(coordinates.getSize())}
    assert there.following == {component_name(mimic.joint) for mimic in body.subject.mimics}
    for coupled in (False, True) if there.following else (False,):
        for t, pose in enumerate(q):
            ours = body.landmarks(body.at(pose)) @ R_OPENSIM_WORLD.T
            np.testing.assert_allclose(there.places(t, body.landmark_names, coupled=coupled), ours, atol=1e-6)
