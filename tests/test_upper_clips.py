"""Clips of an upper body: sleeves, boards in the colour of skin, hands that cross, keys of sliding joints in metres."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from estimator.data.cameras.camera import Camera
from estimator.search.jumps.anatomy import anatomy_of
from estimator.search.point_features import skin_features
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import MOTIONS
from estimator.synthesis.plate import MotionArea, place_of
from estimator.synthesis.render import Renderer
from estimator.synthesis.settings import SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import load_subject

HAND, FACE = 0.09, 0.12  # m from the middle of a hand, of a face, within which a hand's middle covers some of it
BLUE, RED = 0, 2


@pytest.fixture(scope="module")
def body() -> Body:
    return Body(load_subject("upper13"))


@pytest.fixture(scope="module")
def framed(body: Body) -> tuple[list[Camera], MotionArea]:
    surface = surface_of(body, nodes=300)
    motion = MOTIONS["cross_arms"]
    q = authored_motion(body, np.arange(0.0, motion.seconds, 0.5), motion)
    points = np.array([points_in_world(body.at(pose), surface.joint, surface.local) for pose in q])
    cameras = framing_cameras(points, ViewSettings(parallel=True, image_size=(320, 240), azimuth=0.0))
    return list(cameras), place_of(points, -1.1)


def picture(body: Body, framed: tuple[list[Camera], MotionArea], time: float = 0.0, **scene: object) -> tuple:
    """The first pose of a motion at a time of the scene, without noise; and what rendered it."""
    cameras, place = framed
    renderer = Renderer(body, cameras, np.random.default_rng(0), SceneSettings(noise=0.0, **scene), place)
    posed = body.at(authored_motion(body, np.zeros(1), MOTIONS["cross_arms"])[0])
    return (
        renderer.frame(posed, 0, np.random.default_rng(0), time).astype(float),
        renderer.maps(posed, 0, time),
        renderer,
    )


@pytest.mark.parametrize("name", ["reach_out", "cross_arms", "talk"])
def test_sliding_joints_are_keyed_in_metres_and_others_in_degrees(body: Body, name: str) -> None:
    motion = MOTIONS[name]
    assert motion.seconds * 25.0 >= 150
    q = authored_motion(body, np.array(motion.times), motion)
    columns = list(body.q_names)
    for joint in ("trunk_left", "trunk_up"):
        np.testing.assert_allclose(q[:, columns.index(joint)], motion.angles[joint], atol=1e-9)
    elbow = "left_elbow_flexion"
    np.testing.assert_allclose(np.degrees(q[:, columns.index(elbow)]), motion.angles[elbow], atol=1e-9)


def test_hands_cross_each_other_and_the_face_and_come_towards_the_camera(body: Body) -> None:
    """The camera faces along x, with y left and z up."""
    features = skin_features(body, anatomy_of(body))
    for name, crosses in (("reach_out", False), ("cross_arms", True), ("talk", True)):
        motion = MOTIONS[name]
        q = authored_motion(body, np.arange(0.0, motion.seconds, 0.02), motion)
        face, left, right = features.points(body.placed(q)).transpose(1, 0, 2)
        assert min(np.ptp(left[:, 0]), np.ptp(right[:, 0])) > 0.2
        if not crosses:
            continue
        before = np.linalg.norm((left - right)[:, 1:], axis=1) < HAND
        assert (left - right)[before, 0].max() > 0.1  # the left hand before the right
        assert (left - right)[before, 0].min() < -0.1  # and the right one before the left
        assert (left[:, 1] < right[:, 1]).any()
        for hand in (left, right):
            assert np.linalg.norm((hand - face)[:, 1:], axis=1).min() < FACE
            assert (hand[:, 0] > face[:, 0] + 0.1)[np.linalg.norm((hand - face)[:, 1:], axis=1) < FACE].all()


def test_long_sleeves_cover_the_forearms_alone(body: Body, framed: tuple[list[Camera], MotionArea]) -> None:
    (short, maps, renderer), (long, _, _) = (picture(body, framed, sleeves=s) for s in ("short", "long"))
    parts = {link: maps.part == k for k, link in enumerate(renderer.parts)}
    inside = {link: cv2.erode(m.astype(np.uint8), np.ones((3, 3))) > 0 for link, m in parts.items()}
    for side in ("left", "right"):
        forearm, hand = inside[f"{side}_forearm"], inside[f"{side}_hand"]
        assert short[forearm, RED].mean() > 1.3 * short[forearm, BLUE].mean()
        assert long[forearm, BLUE].mean() > 1.3 * long[forearm, RED].mean()
        np.testing.assert_array_equal(long[hand], short[hand])
    bare = ~(cv2.dilate((parts["left_forearm"] | parts["right_forearm"]).astype(np.uint8), np.ones((3, 3))) > 0)
    np.testing.assert_array_equal(long[bare], short[bare])


def test_boards_are_part_of_the_empty_scene_and_swinging_ones_are_not(
    body: Body, framed: tuple[list[Camera], MotionArea]
) -> None:
    plain, maps, renderer = picture(body, framed)
    boards, _, with_boards = picture(body, framed, boards=4)
    inner = cv2.erode(maps.mask.astype(np.uint8), np.ones((3, 3))) > 0
    np.testing.assert_array_equal(plain[inner], boards[inner])
    changed = (with_boards.plate(0) != renderer.plate(0)).any(axis=2)
    assert changed.mean() > 0.01
    swung = [picture(body, framed, time, swinging=2) for time in (0.0, 0.7)]
    (first, there, with_swinging), (later, _, _) = swung
    np.testing.assert_array_equal(with_swinging.plate(0), renderer.plate(0))
    np.testing.assert_array_equal(first[inner], plain[inner])
    moved = (first != later).any(axis=2)
    assert 0.01 < moved.mean() < 0.5
    nearer = there.depth < maps.depth - 1e-6
    assert nearer.any()
    assert not nearer[maps.mask].any()
    solid = cv2.erode(nearer.astype(np.uint8), np.ones((5, 5))) > 0
    assert (first[solid, RED] > 1.3 * first[solid, BLUE]).all()
