"""Masses of a person's segments by regressions: totals, symmetry, scaling with lengths, and known places."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import body_of

from humanoid.kinematics.body import Body
from humanoid.shape.segment_masses import REGRESSIONS, height_over_heels, mass_points, person_inertias, segment_masses
from humanoid.subject.subject import subject_from_text

BODY = body_of("human34")


def centre_of_mass(inertias: list[pin.Inertia]) -> np.ndarray:
    posed = BODY.at(pin.neutral(BODY.model))
    places = [i.mass * (posed.rotations[j] @ i.lever + posed.translations[j]) for j, i in enumerate(inertias)]
    return np.sum(places, axis=0) / sum(i.mass for i in inertias)


def test_the_segments_of_a_person_weigh_as_much_as_the_person() -> None:
    assert sum(i.mass for i in person_inertias(BODY, 72.0)) == pytest.approx(72.0, rel=1e-3)
    points = mass_points(BODY)
    assert points is not None
    assert points.share.sum() == pytest.approx(1.0)


def test_left_and_right_mirror_each_other() -> None:
    inertias = dict(zip(BODY.model.names, person_inertias(BODY), strict=True))
    assert centre_of_mass(list(inertias.values()))[1] == pytest.approx(0.0, abs=1e-12)
    for name, left in inertias.items():
        if name.startswith("left_"):
            right = inertias[name.replace("left_", "right_")]
            assert left.mass == right.mass
            np.testing.assert_allclose(np.sort(np.linalg.eigvalsh(left.inertia)), np.linalg.eigvalsh(right.inertia))


def test_the_thigh_is_where_its_regression_has_it() -> None:
    """From the hip: down the thigh, a little behind its axis, a little outwards."""
    posed, joint = BODY.at(pin.neutral(BODY.model)), BODY.model.getJointId("left_hip_rotation")
    places = dict(zip(BODY.landmark_names, BODY.landmarks(posed), strict=True))
    thigh, hip = segment_masses(BODY)[0][joint], places["left_hip"]
    centre = posed.rotations[joint] @ thigh.centre + posed.translations[joint]
    length = np.linalg.norm(places["left_knee"] - hip)
    x, y, z = REGRESSIONS["thigh"].centre
    np.testing.assert_allclose((centre - hip) / length, [x, z, y], atol=1e-9)  # the model's axes: forward, left, up
    gyration = np.sqrt(np.linalg.eigvalsh(thigh.inertia) / thigh.mass) / length
    np.testing.assert_allclose(gyration, np.sort(REGRESSIONS["thigh"].radii), atol=1e-9)


def test_the_whole_body_balances_over_its_feet_and_at_the_height_of_a_person() -> None:
    """The centre of mass of who stands is at 54 to 58 % of the stature (Winter 2009, section 4.1), ahead of the
    ankles."""
    places = dict(zip(BODY.landmark_names, BODY.landmarks(BODY.at(pin.neutral(BODY.model))), strict=True))
    centre, tall = centre_of_mass(person_inertias(BODY)), height_over_heels(BODY, "head_top")
    assert tall == pytest.approx(1.70, abs=0.01)  # heels lie a little behind the top of the head
    assert 0.53 < (centre[2] - places["left_heel"][2]) / tall < 0.59
    assert places["left_heel"][0] < centre[0] < places["left_big_toe"][0]


def test_mass_scales_masses_and_inertias_alike() -> None:
    light, heavy = person_inertias(BODY, 50.0), person_inertias(BODY, 100.0)
    for a, b in zip(light, heavy, strict=True):
        if a.mass > 0.01:
            np.testing.assert_allclose(2.0 * a.toDynamicParameters(), b.toDynamicParameters(), rtol=1e-9, atol=1e-12)
    assert height_over_heels(body_of("arm8"), "head_top") is None


def test_a_segment_whose_ends_are_in_one_place_is_spread_over_its_flesh() -> None:
    text = BODY.subject.urdf.replace('name="left_knee" link="left_shank"', 'name="left_knee" link="left_thigh"')
    inertias = person_inertias(Body(subject_from_text(text, source="wrong.urdf")), 60.0)
    assert sum(i.mass for i in inertias) == pytest.approx(60.0, rel=1e-3)
    assert all(np.isfinite(i.toDynamicParameters()).all() for i in inertias)


def test_a_body_whose_feet_point_nowhere_has_its_centres_on_the_axes_of_its_limbs() -> None:
    arm = body_of("arm8")
    masses, posed = segment_masses(arm)[0], arm.at(pin.neutral(arm.model))
    places = dict(zip(arm.landmark_names, arm.landmarks(posed), strict=True))
    joint = arm.model.frames[arm.model.getFrameId("left_upper_arm", pin.FrameType.BODY)].parentJoint
    centre = posed.rotations[joint] @ masses[joint].centre + posed.translations[joint]
    along = places["left_elbow"] - places["left_shoulder"]
    expected = places["left_shoulder"] - REGRESSIONS["upper_arm"].centre[1] * along
    np.testing.assert_allclose(centre, expected, atol=1e-9)
