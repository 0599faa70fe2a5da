"""Motion capture files: read unchanged, put upright in metres, and followed by a subject."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from estimator.data.formats.bvh import read_bvh
from estimator.runs.evaluation import limit_violations
from estimator.synthesis.mocap import CMU_UNIT, Mocap, load_mocap
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.retarget import retarget
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from tests.builders import body_of

DATA = Path(os.environ.get("KINEMODE_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "mocap"
FILES = sorted(DATA.glob("*.bvh"))

CHAIN = """HIERARCHY
ROOT Hips
{
  OFFSET 1.0 2.0 3.0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT Arm
  {
    OFFSET 2.0 0.0 0.0
    CHANNELS 3 Xrotation Yrotation Zrotation
    End Site
    {
      OFFSET 0.0 0.0 1.0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.02
5.0 6.0 7.0 0.0 0.0 0.0 0.0 0.0 0.0
0.0 0.0 0.0 90.0 90.0 0.0 90.0 0.0 90.0
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "clip.bvh"
    path.write_text(text)
    return path


def test_joints_stand_where_their_rotations_put_them(tmp_path: Path) -> None:
    motion = read_bvh(written(tmp_path, CHAIN))
    assert motion.names == ("Hips", "Arm", "Arm_end")
    assert motion.frame_time == 0.02
    np.testing.assert_allclose(motion.rest(), [[1, 2, 3], [3, 2, 3], [3, 2, 4]])
    places = motion.positions()
    np.testing.assert_allclose(places[0], [[5, 6, 7], [7, 6, 7], [7, 6, 8]])
    # R_hips = Rz(90) Ry(90) takes x to -z and z to y; R_arm = Rx(90) Rz(90) takes z to -y
    np.testing.assert_allclose(places[1], [[0, 0, 0], [0, 0, -2], [1, 0, -2]], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("HIERARCHY", "MOTION", "line 1: HIERARCHY is needed"),
        ("OFFSET 2.0 0.0 0.0", "OFFSET 2.0 0.0", "line 8: 3 numbers are needed"),
        ("CHANNELS 3", "CHANNELS 2", "line 9: CHANNELS"),
        ("Zrotation Yrotation Xrotation", "Zrotation Yrotation Wrotation", "line 5: .*Xposition"),
        ("JOINT Arm", "JOINT Hips", "line 8: the name 'Hips' is used twice"),
        ("End Site", "End", "line 10: JOINT NAME, End Site or }"),
        ("Frames: 2", "Frames: 3", "3 frames are announced, found 2"),
        ("Frames: 2", "Frames: 0", "line 17: a whole positive number"),
        ("0.02", "nan", "line 18: 1 numbers"),
        ("0.02", "-1", "line 18: a positive number"),
        ("5.0 6.0", "5.0", "line 19: 9 numbers are needed"),
        ("}\nMOTION", "MOTION", "JOINT NAME"),
        ("Frames: 2", "Frames: 2.5", "line 17: a whole positive number"),
    ],
)
def test_faults_are_named_with_their_line(tmp_path: Path, old: str, new: str, match: str) -> None:
    assert old in CHAIN
    with pytest.raises(InputError, match=match):
        read_bvh(written(tmp_path, CHAIN.replace(old, new, 1)))


def test_a_file_cut_short_is_refused_wherever_it_ends(tmp_path: Path) -> None:
    lines = CHAIN.splitlines()
    for count in range(len(lines)):
        with pytest.raises(InputError):
            read_bvh(written(tmp_path, "\n".join(lines[:count])))


def test_a_file_without_a_person_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no joint LeftUpLeg"):
        load_mocap(written(tmp_path, CHAIN))
    with pytest.raises(InputError, match="no such file"):
        load_mocap(tmp_path / "missing.bvh")
    with pytest.raises(InputError, match="unit"):
        load_mocap(written(tmp_path, CHAIN), unit=0.0)


BONES = {  # parent and offset, y up, z forward, x left, in units of which a leg has 10
    "Hips": ("", (0, 0, 0)), "LeftUpLeg": ("Hips", (1, 0, 0)), "LeftLeg": ("LeftUpLeg", (0, -5, 0)),
    "LeftFoot": ("LeftLeg", (0, -5, 0)), "LeftToeBase": ("LeftFoot", (0, -0.6, 2)),
    "RightUpLeg": ("Hips", (-1, 0, 0)), "RightLeg": ("RightUpLeg", (0, -5, 0)), "RightFoot": ("RightLeg", (0, -5, 0)),
    "RightToeBase": ("RightFoot", (0, -0.6, 2)), "Spine1": ("Hips", (0, 3, 0)), "Head": ("Spine1", (0, 3.5, 0)),
    "Head_end": ("Head", (0, 2.5, 0)), "LeftArm": ("Spine1", (2, 3, 0)), "LeftForeArm": ("LeftArm", (3, 0, 0)),
    "LeftHand": ("LeftForeArm", (3, 0, 0)), "RightArm": ("Spine1", (-2, 3, 0)),
    "RightForeArm": ("RightArm", (-3, 0, 0)), "RightHand": ("RightForeArm", (-3, 0, 0)),
}  # fmt: skip


def puppet(
    R_file: np.ndarray, heading: float, scale: float, zero: dict[str, np.ndarray] | None = None, tilt: float = 0.0
) -> str:
    """A walk-in-place of the bones above, in a file whose axes are turned by R_file, facing `heading` [rad].

    zero: how each joint's own frame is turned, which changes what the pose of all zeros is, and nothing else. tilt
    [rad]: of the person, forwards.
    """
    turned = {name: np.eye(3) for name in BONES} if zero is None else zero
    names, rng = list(BONES), np.random.default_rng(3)
    swing = (
        rng.uniform(-30.0, 30.0, (6, len(names), 3)) * np.array([n not in ("Hips", "Head_end") for n in names])[:, None]
    )

    def joint(name: str) -> str:
        parent = BONES[name][0]
        own_offset = scale * R_file @ np.array(BONES[name][1], dtype=float)
        offset = " ".join(f"{v:.9f}" for v in (turned[parent].T if parent else np.eye(3)) @ own_offset)
        if name.endswith("_end"):
            return (
                f"End Site {{ OFFSET {offset} }}".replace(" OFFSET", "\nOFFSET")
                .replace("{", "\n{")
                .replace(" }", "\n}")
            )
        below = "\n".join(joint(n) for n, (parent, _) in BONES.items() if parent == name)
        kind = "ROOT" if name == "Hips" else "JOINT"
        channels = [] if kind == "JOINT" else ["Xposition", "Yposition", "Zposition"]
        channels += [f"{axis}rotation" for axis in "ZYX"]
        own = f"{kind} {name}\n{{\nOFFSET {offset}\nCHANNELS {len(channels)} {' '.join(channels)}\n"
        return own + (below + "\n" if below else "") + "}"

    order: list[str] = []

    def walk(name: str) -> None:
        order.append(name)
        for n, (parent, _) in BONES.items():
            if parent == name and not n.endswith("_end"):
                walk(n)

    walk("Hips")
    c, s = np.cos(heading), np.sin(heading)
    R_heading = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    rows = []
    for t in range(6):
        values: list[float] = []
        for name in order:
            own = _from_degrees(swing[t, names.index(name)])
            if name == "Hips":
                values += (scale * R_file @ R_heading @ np.array([0.3 * t, 10.0, 0.5 * t])).tolist()
                own = R_heading @ np.array(pin.rpy.rpyToMatrix(tilt, 0.0, 0.0)) @ own
            parent = BONES[name][0]
            before = turned[parent].T if parent else np.eye(3)
            values += _zyx_degrees(before @ R_file @ own @ R_file.T @ turned[name])
        rows.append(" ".join(f"{v:.9f}" for v in values))
    return f"HIERARCHY\n{joint('Hips')}\nMOTION\nFrames: 6\nFrame Time: 0.05\n" + "\n".join(rows) + "\n"


def _from_degrees(zyx: np.ndarray) -> np.ndarray:
    return np.asarray(pin.rpy.rpyToMatrix(np.radians(zyx[::-1])))


def _zyx_degrees(R: np.ndarray) -> list[float]:
    return np.degrees(pin.rpy.matrixToRpy(R))[::-1].tolist()


def test_axes_heading_and_unit_do_not_matter(tmp_path: Path) -> None:
    plain = load_mocap(written(tmp_path, puppet(np.eye(3), 0.0, 1.0)))
    assert plain.unit == pytest.approx(0.083)
    assert plain.fps == pytest.approx(20.0)
    first = dict(zip(plain.names, plain.points[0], strict=True))
    assert first["left_hip"][1] > first["right_hip"][1]  # faces x
    assert abs(first["left_hip"][0] - first["right_hip"][0]) < 1e-9
    assert (first["left_toe"] + first["right_toe"] - first["left_ankle"] - first["right_ankle"])[0] > 0.1
    assert first["head_top"][2] > 1.2
    z_up = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])  # a rotation: x left-right, z up
    for R, heading, scale in ((np.eye(3), 2.0, 0.3), (z_up, -1.0, 2.54)):
        other = load_mocap(written(tmp_path, puppet(R, heading, scale)))
        assert other.unit == pytest.approx(plain.unit / scale)
        np.testing.assert_allclose(other.points, plain.points, atol=1e-6)
    twice = load_mocap(written(tmp_path, puppet(np.eye(3), 0.0, 1.0)), unit=2.0 * plain.unit)
    np.testing.assert_allclose(twice.points, 2.0 * plain.points, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_skeleton_whose_zero_pose_does_not_stand_is_upright(seed: int, tmp_path: Path) -> None:
    """The frames decide, whatever the zero pose; as in rigs whose bones lie along their joints' own axes."""
    plain = load_mocap(written(tmp_path, puppet(np.eye(3), 0.0, 1.0)))
    rng = np.random.default_rng(seed)
    along_x = {
        name: np.array(pin.Quaternion.FromTwoVectors(np.array([1.0, 0.0, 0.0]), _child(name)).toRotationMatrix())
        for name in BONES
    }
    anyhow = {name: np.array(pin.exp3(rng.normal(scale=2.0, size=3))) for name in BONES}
    z_up = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    for R, zero in ((np.eye(3), along_x), (np.eye(3), anyhow), (z_up, anyhow), (-np.eye(3)[[1, 0, 2]], anyhow)):
        other = load_mocap(written(tmp_path, puppet(R, 0.4 * seed, 1.0, zero)))
        np.testing.assert_allclose(other.points, plain.points, atol=1e-6)


def _child(name: str) -> np.ndarray:
    """The way to a joint's first child."""
    return next((np.array(o, dtype=float) for p, o in BONES.values() if p == name and np.any(o)), np.ones(3))


def test_an_undeterminable_up_axis_is_requested(tmp_path: Path) -> None:
    """A person lying, in a file with a standing rest pose, could also be one standing in a world with other axes."""
    lying = written(tmp_path, puppet(np.eye(3), 0.0, 1.0, tilt=0.5 * np.pi))
    with pytest.raises(InputError, match=r"which way is up\? its rest pose stands along y, the person along z .*--up"):
        load_mocap(lying)
    upright = load_mocap(written(tmp_path, puppet(np.eye(3), 0.0, 1.0)))
    stands = load_mocap(written(tmp_path, puppet(np.eye(3), 0.0, 1.0, tilt=0.5 * np.pi)), up="z")
    np.testing.assert_allclose(np.ptp(stands.points[0, :, 2]), np.ptp(upright.points[0, :, 2]), rtol=1e-6)
    lies = load_mocap(written(tmp_path, puppet(np.eye(3), 0.0, 1.0, tilt=0.5 * np.pi)), up="y")
    assert np.ptp(lies.points[0, :, 2]) < 0.6 * np.ptp(upright.points[0, :, 2])
    rng = np.random.default_rng(0)
    anyhow = {name: np.array(pin.exp3(rng.normal(scale=2.0, size=3))) for name in BONES}
    oblique = pin.Quaternion.FromTwoVectors(np.array([0.0, 1.0, 0.0]), np.ones(3)).toRotationMatrix()
    with pytest.raises(InputError, match="the person stands along none of its axes"):
        load_mocap(written(tmp_path, puppet(np.array(oblique), 0.0, 1.0, anyhow)))
    with pytest.raises(InputError, match="up: is 'up'"):
        load_mocap(written(tmp_path, puppet(np.eye(3), 0.0, 1.0)), up="up")


def captured(body: Body, q: np.ndarray, fps: float) -> Mocap:
    """The landmarks of a known motion, as a capture would give them."""
    names = tuple(f"{side}_{n}" for n in ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "wrist")
                  for side in ("left", "right"))  # fmt: skip
    own = [n.replace("_toe", "_big_toe") for n in (*names, "head_top")]
    order = [body.landmark_names.index(n) for n in own]
    points = np.array([body.landmarks(body.at(pose))[order] for pose in q])
    neck = points[:, -1:] - [0.0, 0.0, 0.2]
    return Mocap((*names, "head_top", "head_base"), np.concatenate([points, neck], axis=1), fps, 1.0, "known")


def test_a_known_motion_is_recovered_on_a_body_of_other_lengths() -> None:
    body = body_of("human34")
    giant = Body(load_subject("human34").scaled(dict.fromkeys(("left_knee_flexion", "left_ankle_dorsiflexion",
                                                               "left_elbow_flexion", "left_wrist"), 1.15)))  # fmt: skip
    times = np.arange(45) / 30.0
    q = authored_motion(giant, times)
    fitted = retarget(body, captured(giant, q, 30.0), times)
    assert fitted.q.shape == (45, body.nq)
    assert limit_violations(body, fitted.q) == 0
    assert fitted.residual.mean() < 0.006
    # lengths differ, angles do not: knees and elbows bend as in the capture
    for joint in ("left_knee_flexion", "right_knee_flexion", "left_elbow_flexion", "right_elbow_flexion"):
        at = body.q_names.index(joint)
        assert np.abs(fitted.q[:, at] - q[:, at]).mean() < np.radians(4.0)


def test_a_body_that_is_not_a_whole_person_is_refused() -> None:
    body = body_of("human34")
    q = authored_motion(body, np.zeros(2))
    with pytest.raises(InputError, match="no landmark left_hip"):
        retarget(body_of("arm8"), captured(body, q, 30.0), np.zeros(2))


@pytest.mark.skipif(not FILES, reason=f"the motion capture files are not in {DATA}")
def test_lost_bones_of_the_cmu_files_are_put_back() -> None:
    motion = read_bvh(DATA / "walk_straight_07_01.bvh")
    assert not motion.offsets[motion.names.index("Neck")].any()
    mocap = load_mocap(DATA / "walk_straight_07_01.bvh")
    assert mocap.unit == CMU_UNIT == pytest.approx(0.0564444, abs=1e-6)
    first = dict(zip(mocap.names, mocap.points.mean(axis=0), strict=True))
    assert 1.4 < first["head_top"][2] < 1.75
    forearm = np.linalg.norm(mocap.points[:, mocap.names.index("left_wrist")]
                             - mocap.points[:, mocap.names.index("left_elbow")], axis=1)  # fmt: skip
    np.testing.assert_allclose(forearm, 0.265, atol=0.002)


@pytest.mark.skipif(not FILES, reason=f"the motion capture files are not in {DATA}")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_captured_motions_are_followed(path: Path) -> None:
    body, mocap = body_of("human34"), load_mocap(path)
    times = np.arange(round(mocap.seconds * 30.0)) / 30.0
    fitted = retarget(body, mocap, times)
    assert limit_violations(body, fitted.q) == 0
    assert fitted.residual.mean() < 0.02
    self_collision = SelfCollision(body)
    assert max(self_collision.penetration(body.at(pose)) for pose in fitted.q[::3]) < 0.005
    soles = [i for i, n in enumerate(body.landmark_names) if n.endswith(("heel", "toe"))]
    lowest = np.array([body.landmarks(body.at(pose))[soles, 2].min() for pose in fitted.q])
    assert abs(np.median(lowest)) < 0.05  # on the floor most of the time
