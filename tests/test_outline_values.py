"""Values of many poses by one picture: what they depend on, and what must not matter."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.image_cues import ImageCues
from estimator.trackers.dual_chain.outline_kernels import project_limb
from estimator.trackers.dual_chain.outline_values import OutlineLikelihood, OutlineSettings
from estimator.vision.cues.edges import EdgeSettings, edge_map
from estimator.vision.cues.foreground import silhouette_of
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import limb_placements
from tests.builders import body_of

SIZE = (320, 240)


def camera_of(parallel: bool) -> Camera:
    """A camera in front of a person at the origin who faces it."""
    camera = guessed_camera("k", SIZE)
    R = camera.R_camera_world @ np.diag([-1.0, -1.0, 1.0])
    camera = replace(camera, R_camera_world=R, t_camera_world=-R @ np.array([2.5, 0.0, 0.3]))
    K = camera.K.copy()
    K[[0, 1], [0, 1]] /= 2.5
    return replace(camera, K=K, parallel=True) if parallel else camera


@cache
def pose(name: str) -> np.ndarray:
    """A pose with the arms away from the trunk and each other, where a body has arms."""
    body = body_of(name)
    q = body.neutral.copy()
    for joint, angle in (
        ("left_shoulder_elevation", 0.9),
        ("right_shoulder_elevation", 0.5),
        ("left_elbow_flexion", 0.8),
    ):
        if body.model.existJointName(joint):
            q[body.place(joint).q] = angle
    return q


def drawn(body: Body, q: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W) uint8: limbs as polygons, each of its own grey, far ones first."""
    graph = limb_graph(body)
    t, R = limb_placements(graph, body, q)
    picture, shown = np.full(SIZE[::-1], 40, np.uint8), []
    for k, limb in enumerate(graph.limbs):
        z = np.linspace(limb.start, limb.end, 9)
        out = np.empty((9, 5))
        project_limb(t[k], R[k], z, limb.semi_axes(z), *camera.arrays, out)
        corners = np.concatenate([out[:, :2] + out[:, 2:4], (out[:, :2] - out[:, 2:4])[::-1]])
        shown.append((out[:, 4].mean(), k, corners))
    for _, k, corners in sorted(shown, key=lambda x: -x[0]):
        cv2.fillPoly(picture, [np.round(16.0 * corners).astype(np.int32)], int(110 + 20 * k), cv2.LINE_AA, 4)
    return picture


def seen(body: Body, q: np.ndarray, camera: Camera, *, edges: bool = True, silhouette: bool = True) -> ImageCues:
    picture = drawn(body, q, camera)
    read = {}
    if edges:
        read["edges"] = edge_map(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), EdgeSettings())
    if silhouette:
        mask = picture > 80
        read["silhouette"] = silhouette_of(mask, np.ones_like(mask))
    return ImageCues(camera, read)


def likelihood(body: Body, cues: ImageCues, **changes: float) -> OutlineLikelihood:
    return OutlineLikelihood(body, limb_graph(body), cues, 60.0, replace(OutlineSettings(), **changes))  # type: ignore[arg-type]


def around(body: Body, q: np.ndarray, std: float, count: int) -> np.ndarray:
    steps = std * np.random.default_rng(0).standard_normal((count, body.nv))
    return np.vstack([q, body.integrated(np.tile(q, (count, 1)), steps)])


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("name", ["upper13", "human34", "arm8"])
def test_the_true_pose_is_the_likelier(name: str, parallel: bool) -> None:
    """By edges, by the silhouette, and by both."""
    body = body_of(name)
    q, camera = pose(name), camera_of(parallel)
    cues = seen(body, q, camera)
    placed = body.placed(around(body, q, 0.15, 300))
    for changes in ({}, {"edge_evidence": 0.0}, {"silhouette_evidence": 0.0, "cover_evidence": 0.0}):
        values = likelihood(body, cues, **changes).log_likelihood(placed)
        assert np.mean(values[1:] < values[0]) > (0.9 if name == "arm8" else 0.97)


def test_many_are_as_each_alone_to_the_bit() -> None:
    body = body_of("upper13")
    made = likelihood(body, seen(body, pose("upper13"), camera_of(True)))
    q = around(body, pose("upper13"), 0.3, 5)
    values, cover = made.values(body.placed(q))
    for n in range(len(q)):
        alone, alone_cover = made.values(body.placed(q[n : n + 1]))
        np.testing.assert_array_equal(alone[0], values[n])
        assert alone_cover[0] == cover[n]


def test_a_left_out_limb_gives_no_evidence_and_the_others_are_unchanged() -> None:
    body = body_of("upper13")
    made = likelihood(body, seen(body, pose("upper13"), camera_of(False)))
    placed = body.placed(around(body, pose("upper13"), 0.3, 5))
    whole, cover = made.values(placed)
    wanted = np.arange(whole.shape[1]) % 2 == 0
    some, same_cover = made.values(placed, wanted)
    np.testing.assert_array_equal(some[:, wanted], whole[:, wanted])
    assert not some[:, ~wanted].any()
    np.testing.assert_array_equal(cover, same_cover)


def test_without_a_picture_or_an_edge_all_poses_are_alike() -> None:
    body = body_of("upper13")
    camera = camera_of(True)
    black = np.zeros((*SIZE[::-1], 3), np.uint8)
    nothing = np.zeros(SIZE[::-1], bool)
    placed = body.placed(around(body, pose("upper13"), 0.5, 20))
    unknown = silhouette_of(nothing, nothing)
    for read in ({}, {"edges": edge_map(black, EdgeSettings())}, {"silhouette": unknown}):
        values = likelihood(body, ImageCues(camera, read)).log_likelihood(placed)
        assert np.ptp(values) == 0.0


def test_what_is_outside_of_the_picture_is_neither_good_nor_bad() -> None:
    body = body_of("upper13")
    q = pose("upper13")
    cues = seen(body, q, camera_of(True))
    away = q.copy()
    away[body.place("trunk_left").q] = 3.0
    values, cover = likelihood(body, cues).values(body.placed(away[None]))
    assert not values.any()
    assert cover[0] == 0.0


def test_an_outline_behind_a_nearer_limb_gives_no_evidence() -> None:
    """From the right side the left arm is behind the trunk, the right one before it."""
    body, front = body_of("upper13"), camera_of(True)
    side = replace(front, R_camera_world=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))
    side = replace(side, t_camera_world=-side.R_camera_world @ np.array([0.0, -2.5, 0.3]))
    q = body.neutral.copy()
    for name in ("left", "right"):
        for joint in ("shoulder_elevation", "shoulder_flexion", "elbow_flexion"):
            q[body.place(f"{name}_{joint}").q] = 0.0
    made = likelihood(body, seen(body, q, side), silhouette_evidence=0.0, cover_evidence=0.0)
    values, graph = made.values(body.placed(q[None]))[0][0], limb_graph(body)
    assert values[graph.index("left_upper_arm")] == 0.0
    assert values[graph.index("right_upper_arm")] > 0.5


@pytest.mark.parametrize("parallel", [False, True])
def test_a_point_behind_the_trunk_is_hidden_unless_it_is_its_own(parallel: bool) -> None:
    """Not beside it, before it or on another body; nor behind the camera."""
    body, camera = body_of("upper13"), camera_of(parallel)
    made = likelihood(body, seen(body, pose("upper13"), camera))
    graph, placed = limb_graph(body), body.placed(pose("upper13")[None])
    trunk = graph.index("torso")
    t, R = limb_placements(graph, body, placed)
    middle = t[0, trunk] + R[0, trunk, :, 2] * 0.5 * (graph.limbs[trunk].start + graph.limbs[trunk].end)
    away = middle - camera.centre_world if not parallel else camera.R_camera_world[2]
    away = away / np.linalg.norm(away)
    points = middle + np.array([0.3 * away, -0.3 * away, 0.3 * away + [0.0, 0.8, 0.0], -5.0 * away])
    nobody, own = np.full(4, -1), np.full(4, trunk)
    value, hidden = made.with_hidden(placed, points[None], nobody)
    assert hidden[0].tolist() == [True, False, False, False]
    assert not made.with_hidden(placed, points[None], own)[1].any()
    assert value[0] == made.log_likelihood(placed)[0]


def test_the_evidence_does_not_grow_with_the_number_of_points() -> None:
    body = body_of("upper13")
    cues = seen(body, pose("upper13"), camera_of(True))
    placed = body.placed(around(body, pose("upper13"), 0.2, 100))
    few, many = (likelihood(body, cues, stations=s).log_likelihood(placed) for s in (5, 40))
    assert np.std(many) == pytest.approx(np.std(few), rel=0.2)
    assert np.corrcoef(few, many)[0, 1] > 0.9


def test_evidence_scales_values() -> None:
    body = body_of("upper13")
    cues = seen(body, pose("upper13"), camera_of(True))
    placed = body.placed(around(body, pose("upper13"), 0.2, 10))
    once = likelihood(body, cues).log_likelihood(placed)
    twice = likelihood(body, cues, edge_evidence=50.0, silhouette_evidence=50.0, cover_evidence=50.0)
    np.testing.assert_allclose(twice.log_likelihood(placed), 2.0 * once, rtol=1e-9)
