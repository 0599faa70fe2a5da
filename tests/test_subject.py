"""Every subject that loads by name keeps the same contract; scaling, locking and landmark files work as documented."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

import kinemode as km
from humanoid import Body, InputError, Subject, load_subject
from humanoid.kinematics.body import points_in_world
from humanoid.shape.solids import solids_of
from humanoid.shape.surface import surface_of
from humanoid.subject.example_robots import PREFIX, installed
from humanoid.subject.subject import Marker, Zero, subject_from_text, subject_names
from humanoid.subject.urdf_flesh import limb_capsule

SIZES = {  # nq, nv
    "human34": (35, 34),
    "human30": (31, 30),
    "arm8": (8, 8),
    "upper13": (13, 13),
    PREFIX + "human": (43, 42),
    PREFIX + "talos": (39, 38),
    PREFIX + "g1": (36, 35),
    PREFIX + "panda": (8, 8),
}


@pytest.fixture(params=SIZES)
def subject(request: pytest.FixtureRequest) -> Subject:
    name: str = request.param
    if name.startswith(PREFIX) and name[len(PREFIX) :] not in installed():
        pytest.skip("example-robot-data is not installed")
    return load_subject(name)


def same(a: Subject, b: Subject) -> bool:
    """Equal in all but origin and notes."""
    return all(getattr(a, f.name) == getattr(b, f.name) for f in fields(Subject) if f.name not in ("source", "notes"))


def random_q(subject: Subject, rng: np.random.Generator) -> np.ndarray:
    body = Body(subject)
    q = body.integrate(body.neutral, rng.normal(size=body.nv))
    i = body.bounded_q
    q[i] = rng.uniform(body.lower[i], body.upper[i])
    return q


def test_size_limits_and_landmarks(subject: Subject) -> None:
    model, body = subject.model, Body(subject)
    assert (model.nq, model.nv) == SIZES[subject.source]
    first = 2 if subject.base == "free" else 1
    low = np.array([model.lowerPositionLimit[model.idx_qs[j]] for j in range(first, model.njoints)])
    high = np.array([model.upperPositionLimit[model.idx_qs[j]] for j in range(first, model.njoints)])
    followers = {model.getJointId(mimic.joint) for mimic in subject.mimics}
    assert {nq for j, nq in enumerate(model.nqs) if j >= first and j not in followers} == {1}
    assert np.isfinite(low).all()
    assert np.isfinite(high).all()
    assert (low < high).all()
    assert (high - low < 2.0 * np.pi).all()
    i = body.bounded_q
    assert len(i) == model.njoints - first - len(followers)
    assert ((body.neutral[i] >= body.lower[i]) & (body.neutral[i] <= body.upper[i])).all()
    assert len(subject.landmarks) >= 7
    assert all(model.existBodyName(landmark.link) for landmark in subject.landmarks)
    assert np.isfinite(body.landmarks(body.at(body.neutral))).all()
    for stabiliser in subject.stabilisers:
        q = model.idx_qs[model.getJointId(stabiliser.joint)]
        assert model.lowerPositionLimit[q] <= stabiliser.rest <= model.upperPositionLimit[q]


def test_text_and_pickle_give_the_same_subject(subject: Subject, tmp_path: Path) -> None:
    assert same(subject_from_text(subject.urdf, source="run"), subject)
    assert same(pickle.loads(pickle.dumps(subject)), subject)
    subject.write(tmp_path / "copy.urdf")
    assert same(load_subject(tmp_path / "copy.urdf"), subject)


def test_yourdfpy_places_every_link_alike(subject: Subject) -> None:
    robot = yourdfpy.URDF.load(io.BytesIO(subject.urdf.encode()), load_meshes=False)
    model, data = subject.model, subject.model.createData()
    root = model.getFrameId(robot.base_link, pin.FrameType.BODY)
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = random_q(subject, rng)
        pin.framesForwardKinematics(model, data, q)
        robot.update_cfg({n: q[model.idx_qs[model.getJointId(n)]] for n in robot.actuated_joint_names})
        for link in robot.link_map:
            placement = data.oMf[root].actInv(data.oMf[model.getFrameId(link, pin.FrameType.BODY)])
            np.testing.assert_allclose(placement.homogeneous, robot.get_transform(link), atol=1e-9)


def test_names_are_listed() -> None:
    listed = {s.name: s for s in subject_names()}
    assert set(listed) == {n for n in SIZES if not n.startswith(PREFIX) or n[len(PREFIX) :] in installed()}
    assert all(s.dof == SIZES[n][1] and s.about for n, s in listed.items())


def mirror_images(subject: Subject, q: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks, and the landmarks with left and right exchanged and the axis mirrored."""
    body = Body(subject)
    points = body.landmarks(body.at(q))
    swap = {"left": "right", "right": "left"}
    names = [n.replace(n.split("_")[0], swap.get(n.split("_")[0], n.split("_")[0]), 1) for n in body.landmark_names]
    mirrored = points[[body.landmark_names.index(n) for n in names]]
    mirrored[:, axis] *= -1.0
    return points, mirrored


@pytest.mark.parametrize(("name", "axis"), [("human34", 1), ("human30", 1), (PREFIX + "human", 2)])
def test_equal_values_left_and_right_give_a_mirrored_pose(name: str, axis: int) -> None:
    if name.startswith(PREFIX) and not installed():
        pytest.skip("example-robot-data is not installed")
    subject = load_subject(name)
    model, rng = subject.model, np.random.default_rng(1)
    for _ in range(5):
        q = random_q(subject, rng)
        q[:7] = [0, 0, 0, 0, 0, 0, 1]
        for j in range(2, model.njoints):
            joint, i = model.names[j], model.idx_qs[j]
            if joint.startswith("right_"):
                q[i] = q[model.idx_qs[model.getJointId(joint.replace("right_", "left_", 1))]]
            elif not joint.startswith("left_") and not joint.endswith(("_flexion", "_Z")):
                q[i] = 0.0
        points, mirrored = mirror_images(subject, q, axis)
        np.testing.assert_allclose(points, mirrored, atol=1e-9)


def test_the_landmarks_of_the_human_are_where_their_names_imply() -> None:
    """Heights, sides and front of a standing person, in both human subjects, each with its own axes."""
    for name, (front, left, up) in {
        "human34": ((0, 1), (1, 1), (2, 1)),
        PREFIX + "human": ((0, 1), (2, -1), (1, 1)),
    }.items():
        if name.startswith(PREFIX) and not installed():
            continue
        body = Body(load_subject(name))
        points = body.landmarks(body.at(pin.neutral(body.model)))
        at = dict(zip(body.landmark_names, points, strict=True))

        def along(point: str, axis: tuple[int, int], at: dict[str, np.ndarray] = at) -> float:
            return float(at[point][axis[0]] * axis[1])

        order = ["big_toe", "ankle", "knee", "hip", "elbow", "shoulder", "ear"]
        heights = [along(f"left_{n}", up) for n in order]
        assert heights == sorted(heights)
        assert all(along(f"left_{n}", left) > along(f"right_{n}", left) for n in order)
        assert along("nose", front) > along("left_eye", front) > along("left_ear", front)
        assert along("left_big_toe", front) > along("left_ankle", front) > along("left_heel", front)
        assert along("left_big_toe", left) < along("left_small_toe", left)
        assert 1.4 < along("head_top", up) - along("left_heel", up) < 2.1
        for joint, what in {"knee": "ankle", "elbow": "wrist"}.items():  # knees bend backwards, elbows forwards
            q, bent = pin.neutral(body.model), f"left_{joint}_" + ("flexion" if name == "human34" else "Z")
            q[body.model.idx_qs[body.model.getJointId(bent)]] = 1.0
            moved = body.landmarks(body.at(q))[body.landmark_names.index(f"left_{what}")]
            assert (moved[front[0]] > at[f"left_{what}"][front[0]]) == (joint == "elbow")


def lengths(subject: Subject) -> dict[str, float]:
    """Distance of every joint, fixed ones included, from its parent joint [m]."""
    model = subject.model
    joints = {model.names[j]: model.jointPlacements[j].translation for j in range(1, model.njoints)}
    fixed = {f.name: f.placement.translation for f in model.frames if f.type == pin.FrameType.FIXED_JOINT}
    return {n: float(np.linalg.norm(t)) for n, t in {**joints, **fixed}.items()}


def test_scaling_is_exact_tied_and_keeps_the_prior_in_metres() -> None:
    subject = load_subject("human34")
    scales = {"left_knee_flexion": 1.13, "left_clavicle_elevation": 0.91, "skull": 1.05}
    scaled = subject.scaled(scales)
    before, after = lengths(subject), lengths(scaled)
    tied = {j: s for p in subject.proportions for j in p.joints if (s := scales.get(p.joint))}
    assert {"right_knee_flexion", "right_clavicle_elevation", "neck_flexion"} < set(tied)
    for name, length in before.items():
        assert after[name] == pytest.approx(length * tied.get(name, 1.0), rel=1e-12), name
    for old, new in zip(subject.proportions, scaled.proportions, strict=True):
        s = scales.get(old.joint, 1.0)
        given = (new.scale_min * s, new.scale_max * s, new.mean * s, new.std * s)
        assert given == pytest.approx((old.scale_min, old.scale_max, old.mean, old.std), rel=1e-12)
    assert lengths(scaled.scaled({n: 1.0 / s for n, s in scales.items()})) == pytest.approx(before, rel=1e-12)
    assert same(subject_from_text(scaled.urdf, source="run"), scaled)
    thigh = {f.link: f for f in subject.flesh}["left_thigh"], {f.link: f for f in scaled.flesh}["left_thigh"]
    capsules = limb_capsule(thigh[0]), limb_capsule(thigh[1])
    assert capsules[0] == pytest.approx((0.07, 0.27))
    assert capsules[1] == pytest.approx((0.07, 1.13 * 0.27))
    assert "Adult of 1.70 m" in scaled.urdf  # the comment at the head stays


@pytest.mark.parametrize(
    ("scales", "message"),
    [
        ({"left_knee": 1.1}, "left_knee_flexion"),
        ({"right_knee_flexion": 1.1}, "tied to 'left_knee_flexion'"),
        ({"skull": 1.3}, "0.8 to 1.2"),
        ({"skull": float("nan")}, "0.8 to 1.2"),
    ],
)
def test_scaling_refuses(scales: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_subject("human34").scaled(scales)


def test_the_30_dof_body_is_the_larger_one_with_its_clavicles_at_rest() -> None:
    clavicles = {f"{s}_clavicle_{a}" for s in ("left", "right") for a in ("elevation", "protraction")}
    scales = {"left_knee_flexion": 1.13, "left_clavicle_elevation": 0.91, "skull": 1.05}  # of locked joints too
    whole, locked = (load_subject(name).scaled(scales) for name in ("human34", "human30"))
    assert set(whole.model.names) - set(locked.model.names) == clavicles
    assert whole.flesh == locked.flesh
    assert whole.proportions == locked.proportions
    assert [s for s in whole.stabilisers if s.joint not in clavicles] == list(locked.stabilisers)
    rest = {s.joint: s.rest for s in whole.stabilisers}
    a, b = Body(whole), Body(locked)
    short = random_q(locked, np.random.default_rng(3))
    q = short[:7]
    for name in whole.model.names[2:]:
        value = rest[name] if name in clavicles else short[locked.model.idx_qs[locked.model.getJointId(name)]]
        q = np.append(q, value)
    assert rest["left_clavicle_protraction"] != 0.0
    np.testing.assert_allclose(a.landmarks(a.at(q)), b.landmarks(b.at(short)), atol=1e-12)
    surfaces = [(surface_of(body), body.at(pose)) for body, pose in ((a, q), (b, short))]
    np.testing.assert_allclose(*(points_in_world(at, s.joint, s.local) for s, at in surfaces), atol=1e-12)
    assert same(subject_from_text(locked.urdf, source="run"), locked)


def test_a_built_in_is_read_once_and_options_make_another() -> None:
    plain = load_subject("arm8")
    assert load_subject("arm8") is plain
    assert (plain.base, load_subject("arm8", base="free").base) == ("fixed", "free")
    assert load_subject("arm8", lock=["left_elbow_flexion"]).model.nv == plain.model.nv - 1
    assert load_subject("arm8").model.nv == plain.model.nv


def test_locked_joints_stay_at_their_rest() -> None:
    whole = load_subject("upper13")
    lock = ["left_elbow_flexion", "neck_flexion", "trunk_up", "left_shoulder_flexion"]
    locked = load_subject("upper13", lock=lock)
    q = random_q(whole, np.random.default_rng(2))
    rest = {s.joint: s.rest for s in whole.stabilisers}
    for name in lock:
        q[whole.model.idx_qs[whole.model.getJointId(name)]] = rest[name]
    left = [n for n in whole.model.names if n not in lock][1:]
    short = np.array([q[whole.model.idx_qs[whole.model.getJointId(n)]] for n in left])
    assert list(locked.model.names)[1:] == left
    a, b = Body(whole), Body(locked)
    np.testing.assert_allclose(a.landmarks(a.at(q)), b.landmarks(b.at(short)), atol=1e-12)


CHAIN = """<robot name="chain"><link name="a"/><link name="b"/><link name="c"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 2"/>
<origin xyz="0 0 1"/><limit lower="-3" upper="3"/></joint>
<joint name="k" type="continuous"><parent link="b"/><child link="c"/><origin xyz="1 0 0"/></joint></robot>"""
TOML = """[subject]
base = "free"
[landmarks]
tip = {link = "c", xyz = [0, 0.5, 0]}
[stabilisers]
j = {rest = 0.2, std = 1}
[proportions]
j = {scale_min = 0.5, scale_max = 2, mean = 1, std = 0.1, symmetric_with = ["k"]}
[limits]
j = [-1, 1.5]
k = [0, 1]
"""


def test_a_foreign_urdf_without_landmarks_gets_its_moving_links(tmp_path: Path) -> None:
    (tmp_path / "chain.urdf").write_text(CHAIN)
    subject = load_subject(tmp_path / "chain.urdf")
    assert subject.base == "fixed"
    assert [landmark.name for landmark in subject.landmarks] == ["b", "c"]
    assert "no landmarks" in subject.notes[0]
    assert (subject.model.nq, subject.model.nv) == (3, 2)  # a continuous joint is (cos, sin)
    assert load_subject(tmp_path / "chain.urdf", base="free").model.nv == 8


def test_a_landmark_file_next_to_the_urdf_is_used(tmp_path: Path) -> None:
    (tmp_path / "chain.urdf").write_text(CHAIN)
    (tmp_path / "chain.landmarks.toml").write_text(TOML)
    subject = load_subject(tmp_path / "chain.urdf")
    assert subject.base == "free"
    assert [(m.name, m.link, m.xyz) for m in subject.landmarks] == [("tip", "c", (0.0, 0.5, 0.0))]
    assert (subject.stabilisers[0].rest, subject.stabilisers[0].std) == (0.2, 1.0)
    assert subject.proportions[0].joints == ("j", "k")
    body = Body(subject)
    assert body.lower[body.bounded_q].tolist() == [-1.0, 0.0]
    assert body.upper[body.bounded_q].tolist() == [1.5, 1.0]
    scaled = subject.scaled({"j": 2.0})
    scaled.write(tmp_path / "chain.urdf")  # self-contained now: the landmark file is not applied again
    assert same(load_subject(tmp_path / "chain.urdf"), scaled)


def test_meshes_are_kept_by_absolute_path(tmp_path: Path) -> None:
    (tmp_path / "pkg" / "urdf").mkdir(parents=True)
    shapes = [
        f'<visual><geometry><mesh filename="{n}"/></geometry></visual>' for n in ("m.stl", "package://pkg/urdf/m.stl")
    ]
    text = CHAIN.replace('<link name="a"/>', f'<link name="a">{"".join(shapes)}</link>')
    (tmp_path / "pkg" / "urdf" / "chain.urdf").write_text(text)
    with pytest.raises(InputError, match=r"m\.stl' of link 'a' is missing"):
        load_subject(tmp_path / "pkg" / "urdf" / "chain.urdf", meshes="require")
    bare = load_subject(tmp_path / "pkg" / "urdf" / "chain.urdf")
    assert "<visual" not in bare.urdf
    assert "2 shapes are left out, their mesh files are missing (the first is 'm.stl')" in bare.notes[0]
    assert "nothing keeps" not in bare.notes[0]  # none of them has collision geometry
    mesh = tmp_path / "pkg" / "urdf" / "m.stl"
    mesh.touch()
    assert load_subject(tmp_path / "pkg" / "urdf" / "chain.urdf").urdf.count(f'filename="{mesh.resolve()}"') == 2


def mesh_shape(kind: str, name: str) -> str:
    return f'<{kind}><geometry><mesh filename="{name}"/></geometry></{kind}>'


@pytest.mark.parametrize("scheme", ["package://gone/", "http://example.org/", "meshes/", "file:///nowhere/"])
def test_without_its_meshes_a_body_moves_alike_and_a_note_names_what_does_not_collide(
    tmp_path: Path, scheme: str
) -> None:
    ball = "<collision><geometry><sphere radius='0.1'/></geometry></collision>"
    whole = CHAIN.replace('<link name="a"/>', f'<link name="a">{ball}</link>')
    lost = CHAIN.replace('<link name="a"/>', f'<link name="a">{ball}{mesh_shape("collision", scheme + "a.stl")}</link>')
    for link in ("b", "c"):
        shapes = mesh_shape("visual", f"{scheme}{link}.dae") + mesh_shape("collision", f"{scheme}{link}.stl")
        lost = lost.replace(f'<link name="{link}"/>', f'<link name="{link}">{shapes}</link>')
    (tmp_path / "whole.urdf").write_text(whole)
    (tmp_path / "lost.urdf").write_text(lost)
    expected, subject = load_subject(tmp_path / "whole.urdf"), load_subject(tmp_path / "lost.urdf")
    body, other = Body(expected), Body(subject)
    np.testing.assert_array_equal(body.landmarks(body.at(body.neutral)), other.landmarks(other.at(other.neutral)))
    assert [solid.link for solid in solids_of(other)] == [solid.link for solid in solids_of(body)] == ["a"]
    assert "5 shapes are left out" in subject.notes[0]
    assert subject.notes[0].endswith("nothing keeps these links apart from others: 'b', 'c'")  # a keeps its ball
    assert same(subject_from_text(subject.urdf, source=subject.source), subject)


@pytest.mark.parametrize("begin", [km.landmark_start, km.match_start])
def test_commands_continue_without_meshes_with_a_note(tmp_path: Path, begin: Callable[..., str]) -> None:
    lost = CHAIN.replace('<link name="b"/>', f'<link name="b">{mesh_shape("visual", "package://gone/b.stl")}</link>')
    (tmp_path / "chain.urdf").write_text(lost)
    with pytest.warns(km.InputWarning, match=r"1 shape is left out, .* 'package://gone/b\.stl'"):
        assert begin(tmp_path / "chain.urdf")


def test_markers_are_kept_in_the_text_resized_with_the_body_and_placed_by_its_kinematics() -> None:
    subject = load_subject("human34")
    toe = Marker("L toe", "left_foot", (0.15, 0.01, -0.03), 0.012)
    marked = subject.with_markers([toe, Marker("r.ASIS", "pelvis", (0.08, -0.12, 0.09), 0.01)])
    again = subject_from_text(marked.urdf, source="human34", base="free")
    assert again.markers == marked.markers
    assert again.markers[0] == toe
    larger = marked.resized(1.1).markers[0]
    assert np.allclose(larger.xyz, 1.1 * np.array(toe.xyz))
    assert np.isclose(larger.std, 1.1 * toe.std)
    body = Body(marked)
    posed = body.at(body.neutral)
    place = points_in_world(posed, body.marker_joint, body.marker_local)[0]
    ankle = body.landmarks(posed)[body.landmark_names.index("left_ankle")]
    turned = posed.rotations[body.marker_joint[0]]
    assert np.allclose(place, ankle + turned @ np.array(toe.xyz))
    with pytest.raises(InputError, match="no link 'left_fot'"):
        subject.with_markers([replace(toe, link="left_fot")])
    assert not marked.with_markers([]).markers


def test_zeros_go_with_the_markers_and_lengths_among_them_with_the_size() -> None:
    subject = load_subject("human34")
    toe = Marker("L toe", "left_foot", (0.15, 0.01, -0.03), 0.012)
    zeros = Zero("root_vx", 0.002), Zero("root_wy", 0.05), Zero("left_hip_flexion", 0.06)
    known = subject.with_markers([toe], zeros)
    assert subject_from_text(known.urdf, source="human34", base="free").zeros == zeros
    assert [z.std for z in known.resized(1.5).zeros] == pytest.approx([0.003, 0.05, 0.06])
    body = Body(known)
    assert np.nansum(body.zero_std) == pytest.approx(0.112)
    assert body.zero_std[body.v_names.index("left_hip_flexion")] == 0.06
    assert not known.with_markers([toe]).zeros
    with pytest.raises(InputError, match=r"no joint 'left_hip_flexon'.*left_hip_flexion"):
        subject.with_markers([toe], [Zero("left_hip_flexon", 0.06)])
