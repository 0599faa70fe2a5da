"""Our body in the coordinates of the gait models: known turns, their axes and signs, and poses composed again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from builders import bent, body_of, random_pose

from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.runs.gait_coordinates import GAIT_MODELS, continuous_turns, gait_coordinates, turn_about
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

X, Y, Z = np.eye(3)
ELBOWS_FORWARD = dict.fromkeys(("left_shoulder_rotation", "right_shoulder_rotation"), -0.6109)
"""[rad] The arm's own axes begin in the plane of the scapula; with this turn the elbows bend straight forward."""


def standing(body: Body, **angles: float) -> np.ndarray:
    """All joints at zero, the elbows bending forward, and some joints at given angles [rad]."""
    joints = [name for name in body.q_names if not name.startswith("root")]
    return bent(body, **(dict.fromkeys(joints, 0.0) | ELBOWS_FORWARD | angles))


def coordinates(q: np.ndarray, model: str = "rajagopal") -> dict[str, Any]:
    """Values by name: numbers for a pose (nq,), columns for several."""
    names, values = gait_coordinates(body_of("human34"), np.atleast_2d(q), GAIT_MODELS[model])
    return dict(zip(names, values[0] if q.ndim == 1 else values.T, strict=True))


def segment(q: np.ndarray, link: str) -> np.ndarray:
    """Rotation (3, 3) of a link in OpenSim's ground, both in OpenSim's axes."""
    body = body_of("human34")
    frame = body.model.frames[body.model.getFrameId(link)]
    R = body.at(q).rotations[frame.parentJoint] @ frame.placement.rotation
    return np.asarray(R_OPENSIM_WORLD @ R @ R_OPENSIM_WORLD.T)


def about(axis: np.ndarray, degrees: float) -> np.ndarray:
    return pin.exp3(np.deg2rad(degrees) * axis)


KNOWN = {
    "right_hip_flexion": ("hip_flexion_r", 1.0), "left_hip_flexion": ("hip_flexion_l", 1.0),
    "right_hip_abduction": ("hip_adduction_r", -1.0), "left_hip_abduction": ("hip_adduction_l", -1.0),
    "right_hip_rotation": ("hip_rotation_r", 1.0), "left_hip_rotation": ("hip_rotation_l", 1.0),
    "right_knee_flexion": ("knee_angle_r", 1.0), "left_knee_flexion": ("knee_angle_l", 1.0),
    "lumbar_flexion": ("lumbar_extension", -1.0), "lumbar_lateral": ("lumbar_bending", 1.0),
    "lumbar_axial": ("lumbar_rotation", 1.0),
}  # fmt: skip


@pytest.mark.parametrize("joint", KNOWN)
def test_a_turn_of_a_joint_is_its_coordinate_alone(joint: str) -> None:
    name, sign = KNOWN[joint]
    values = coordinates(standing(body_of("human34"), **{joint: 0.4}))
    expected = {name: sign * np.rad2deg(0.4)}
    if "knee" in name:
        expected[f"{name}_beta"] = expected[name]  # the kneecap's own coordinate follows
    for other, value in values.items():
        if other not in ("pelvis_tx", "pelvis_ty", "pelvis_tz"):
            assert value == pytest.approx(expected.get(other, 0.0), abs=1e-3), other


def test_the_knee_bends_the_other_way_in_gait2392() -> None:
    pose = standing(body_of("human34"), left_knee_flexion=1.0)
    values = coordinates(pose, "gait2392")
    assert values["knee_angle_l"] == pytest.approx(-np.rad2deg(1.0))
    assert not [name for name in values if name.startswith(("arm", "elbow")) or name.endswith("beta")]
    assert coordinates(pose)["knee_angle_l"] == pytest.approx(np.rad2deg(1.0))


def test_oblique_axes_are_followed_as_far_as_they_go() -> None:
    """Toes up, and forearms forward, are positive; the share of the turn about the axis is reported."""
    values = coordinates(standing(body_of("human34"), right_ankle_dorsiflexion=0.3, left_elbow_flexion=1.0))
    assert 0.97 * np.rad2deg(0.3) < values["ankle_angle_r"] < np.rad2deg(0.3)
    assert 0.96 * np.rad2deg(1.0) < values["elbow_flex_l"] < np.rad2deg(1.0)
    assert {name: v for name, v in values.items() if name.startswith(("subtalar", "mtp", "pro_sup", "wrist"))} == (
        dict.fromkeys(
            [f"{n}_{s}" for s in "rl" for n in ("subtalar_angle", "mtp_angle", "pro_sup", "wrist_flex", "wrist_dev")],
            0.0,
        )
    )


def test_arms_raised() -> None:
    body = body_of("human34")
    forward = coordinates(standing(body, right_shoulder_flexion=1.0, right_shoulder_rotation=0.0))
    assert forward["arm_flex_r"] > 45.0  # in the plane of the scapula, a little outwards
    aside = coordinates(standing(body, left_shoulder_elevation=1.0, left_shoulder_rotation=0.0))
    assert aside["arm_add_l"] < -40.0


def test_poses_are_composed_again() -> None:
    """Turns about z, x, y make the segments' rotations, on left sides with x and y negated; hips are in place."""
    body, rng = body_of("human34"), np.random.default_rng(1)
    for q in (random_pose(body, rng) for _ in range(20)):
        values = coordinates(q)

        def ball(names: tuple[str, str, str], sign: float = 1.0, values: dict[str, Any] = values) -> np.ndarray:
            z, x, y = (values[name] for name in names)
            return about(Z, z) @ about(X, sign * x) @ about(Y, sign * y)

        pelvis, torso = segment(q, "pelvis"), segment(q, "torso")
        np.testing.assert_allclose(ball(("pelvis_tilt", "pelvis_list", "pelvis_rotation")), pelvis, atol=1e-9)
        back = ball(("lumbar_extension", "lumbar_bending", "lumbar_rotation"))
        np.testing.assert_allclose(pelvis @ back, torso, atol=1e-9)
        for side, s, sign in (("right", "r", 1.0), ("left", "l", -1.0)):
            hip = ball((f"hip_flexion_{s}", f"hip_adduction_{s}", f"hip_rotation_{s}"), sign)
            np.testing.assert_allclose(pelvis @ hip, segment(q, f"{side}_thigh"), atol=1e-9)
            knee = about(-Z, values[f"knee_angle_{s}"])
            np.testing.assert_allclose(pelvis @ hip @ knee, segment(q, f"{side}_shank"), atol=1e-9)
            arm = ball((f"arm_flex_{s}", f"arm_add_{s}", f"arm_rot_{s}"), sign)
            np.testing.assert_allclose(torso @ arm, segment(q, f"{side}_upper_arm"), atol=1e-9)
        place = np.array([values[f"pelvis_t{axis}"] for axis in "xyz"])
        landmarks = dict(zip(body.landmark_names, body.landmarks(body.at(q)) @ R_OPENSIM_WORLD.T, strict=True))
        middle = place + pelvis @ GAIT_MODELS["rajagopal"].mid_hip
        np.testing.assert_allclose(middle, 0.5 * (landmarks["left_hip"] + landmarks["right_hip"]), atol=1e-9)


def test_mirrored_poses_have_the_same_angles_on_the_other_side() -> None:
    body = body_of("human34")
    angles = {"hip_flexion": 0.6, "hip_abduction": 0.2, "hip_rotation": 0.3, "knee_flexion": 0.9,
              "ankle_dorsiflexion": -0.3, "shoulder_flexion": 0.4, "shoulder_elevation": 0.5,
              "elbow_flexion": 1.1}  # fmt: skip
    right = coordinates(standing(body, **{f"right_{name}": value for name, value in angles.items()}))
    left = coordinates(standing(body, **{f"left_{name}": value for name, value in angles.items()}))
    for name, value in right.items():
        if name.endswith("_r"):
            assert left[f"{name[:-1]}l"] == pytest.approx(value, abs=1e-9), name


def test_nothing_jumps_where_the_arm_goes_through_a_right_angle() -> None:
    """Raised sideways to overhead, and through a half turn of the pelvis: no coordinate jumps between frames."""
    body = body_of("human34")
    poses = []
    for share in np.linspace(0.0, 1.0, 120):
        q = standing(body, right_shoulder_elevation=2.9 * share, right_shoulder_flexion=0.15)
        q[3:7] = pin.Quaternion(pin.exp3(np.array([0.0, 0.0, 7.0 * share]))).coeffs()
        poses.append(q)
    values = coordinates(np.array(poses))
    for name, column in values.items():
        if name not in ("arm_flex_r", "arm_rot_r"):  # undetermined where the arm is level
            assert np.abs(np.diff(column)).max() < 5.0, name
    assert np.abs(np.diff(values["arm_add_r"])).max() < 5.0
    assert np.abs(np.diff(values["arm_flex_r"])).max() < 60.0
    assert values["pelvis_rotation"][-1] == pytest.approx(np.rad2deg(7.0), abs=1e-6)


def test_turns_are_continuous_and_make_the_rotation() -> None:
    share = np.linspace(0.0, 1.0, 200)
    path = np.stack([0.4 * np.sin(5.0 * share), 2.5 * share, -0.3 * share], axis=1)
    turns = np.stack([pin.exp3(a * Z) @ pin.exp3(b * X) @ pin.exp3(c * Y) for a, b, c in path])
    angles = continuous_turns(turns)
    for R, (a, b, c) in zip(turns, angles, strict=True):
        np.testing.assert_allclose(pin.exp3(a * Z) @ pin.exp3(b * X) @ pin.exp3(c * Y), R, atol=1e-9)
    assert np.abs(path[:, 1]).max() > np.pi / 2  # beyond the range of the middle angle in the usual formula
    np.testing.assert_allclose(angles, path, atol=1e-6)


def test_the_turn_about_an_axis_leaves_the_least_angle() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        R, axis = pin.exp3(rng.normal(size=3)), rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        best = turn_about(R[None], axis)[0]

        def left(angle: float, R: np.ndarray = R, axis: np.ndarray = axis) -> float:
            return float(np.linalg.norm(pin.log3(pin.exp3(angle * axis).T @ R)))

        assert left(best) <= min(left(best + step) for step in (-1.0, -0.01, 0.01, 1.0))
        assert turn_about(pin.exp3(0.7 * axis)[None], 3.0 * axis)[0] == pytest.approx(0.7)


def test_frames_without_a_pose_have_no_values() -> None:
    q = np.repeat(standing(body_of("human34"), left_knee_flexion=0.5)[None], 3, axis=0)
    q[1] = np.nan
    angles = coordinates(q)
    assert all(np.isnan(column[1]) and np.isfinite(column[[0, 2]]).all() for column in angles.values())


def test_only_whole_persons_have_these_coordinates() -> None:
    for name, message in (("arm8", "no link pelvis"), ("upper13", "no link pelvis")):
        body = body_of(name)
        with pytest.raises(InputError, match=message):
            gait_coordinates(body, body.neutral[None], GAIT_MODELS["rajagopal"])


BODIES = {"thigh": "femur", "shank": "tibia", "foot": "calcn", "upper_arm": "humerus", "forearm": "ulna"}
LEFT_OPEN = {"thigh": 0.1, "shank": 14.0, "foot": 16.0, "upper_arm": 0.1, "forearm": 16.0}
"""[deg] of each segment from ours. The model's own knee turns the shank as it bends; ankle and elbow are oblique."""


def test_a_gait_model_moves_as_our_body_does() -> None:
    """With the user's model: KINEMODE_GAIT_MODEL names an .osim with Rajagopal's coordinates."""
    osim: Any = pytest.importorskip("opensim", reason="OpenSim is not installed: pip install opensim")
    path = os.environ.get("KINEMODE_GAIT_MODEL", "")
    if not Path(path).is_file():
        pytest.skip("KINEMODE_GAIT_MODEL names no gait model")
    osim.Logger.setLevelString("error")
    model, body = osim.Model(path), body_of("human34")
    state = model.initSystem()
    known = [model.getCoordinateSet().get(i).getName() for i in range(model.getNumCoordinates())]
    pose = standing(body, right_hip_flexion=0.7, right_hip_abduction=0.3, left_hip_rotation=0.2, right_knee_flexion=0.9,
                    left_ankle_dorsiflexion=0.3, left_elbow_flexion=1.0, left_shoulder_flexion=0.6)  # fmt: skip
    pose[:7] = [0.3, 0.2, 1.0, *pin.Quaternion(pin.rpy.rpyToMatrix(0.2, 0.3, 1.1)).coeffs()]
    values = coordinates(pose)
    lumbar = {f"lumbar_{n}" for n in ("extension", "bending", "rotation")}
    assert set(values) - set(known) <= lumbar | {f"knee_angle_{s}_beta" for s in "lr"}
    for name in set(values) & set(known):
        coordinate = model.updCoordinateSet().get(name)
        coordinate.setClamped(state, False)
        value = values[name] if name[:-1] == "pelvis_t" else np.deg2rad(values[name])
        coordinate.setValue(state, float(value), False)
    model.realizePosition(state)
    for side, s in (("right", "r"), ("left", "l")):
        for ours, theirs in BODIES.items():
            R = model.getBodySet().get(f"{theirs}_{s}").getTransformInGround(state).R()
            made = np.array([[R.get(i, j) for j in range(3)] for i in range(3)])
            apart = np.rad2deg(np.linalg.norm(pin.log3(made.T @ segment(pose, f"{side}_{ours}"))))
            assert apart < LEFT_OPEN[ours], (side, ours)
