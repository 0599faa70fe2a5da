"""Limbs proposed by a visual hull: candidates lie in it and include the true limbs of any body; an empty hull gives
none."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from benchmarks.papers_loose_limbed.limb_detectors import RATES, instant_rates, right
from estimator.data.cameras.camera import Camera
from estimator.inference.beliefs.space import placements_of, points_of
from estimator.trackers.loose_limbed.limb_choices import outermost
from estimator.trackers.loose_limbed.limbs.features import PERSON, SCENE
from estimator.trackers.loose_limbed.limbs.left_over import LeftOver
from estimator.trackers.loose_limbed.limbs.likelihood import LimbLikelihood, LimbView, limb_view
from estimator.trackers.loose_limbed.limbs.visual_hull import visual_hull
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from estimator.trackers.loose_limbed.part_detectors.hull import HullSettings, hull_proposals
from estimator.trackers.loose_limbed.tracker import left_over_places
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph, limb_placements
from tests.builders import bent, body_of, camera_at

SMALL = HullSettings(poses=2000, places=1500)
Scene = tuple[LimbGraph, list[LimbView], np.ndarray, np.ndarray]


def painted(graph: LimbGraph, t: np.ndarray, R: np.ndarray, camera: Camera) -> LimbView:
    """White cones before black, and their places."""
    about = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    circle = np.stack([np.cos(about), np.sin(about), np.zeros(40)], axis=1)
    picture = np.zeros((*camera.image_size[::-1], 3), np.uint8)
    for i, limb in enumerate(graph.limbs):
        ends = [
            circle * [*limb.semi_axes(np.array(z)), 0.0] + [0.0, 0.0, z] for z in np.linspace(limb.start, limb.end, 5)
        ]
        outline = camera.project(np.concatenate(ends) @ R[i].T + t[i])
        shade = 255 - 12 * i  # limbs differ from each other a little
        cv2.fillConvexPoly(picture, cv2.convexHull(np.rint(outline).astype(np.int32)), (shade, shade, shade))
    return limb_view(camera, picture, picture[..., 0] > 0)


def scene_of(name: str, cameras: int, **angles: float) -> Scene:
    body = body_of(name)
    graph = limb_graph(body)
    t, R = limb_placements(graph, body, bent(body, **angles))
    aim = t.mean(axis=0)
    seen_by = [camera_at(20.0 + 80.0 * k, height=aim[2] + 0.4, aim=aim) for k in range(cameras)]
    return graph, [painted(graph, t, R, camera) for camera in seen_by], t, R


def proposals_of(
    scene: Scene, settings: HullSettings = SMALL, views: Sequence[LimbView] | None = None
) -> AllPartProposals:
    graph, own, _, _ = scene
    views = own if views is None else views
    return hull_proposals(np.random.default_rng(4), graph, LimbLikelihood(graph.limbs, views), views, settings)


@pytest.fixture(scope="module")
def person() -> Scene:
    return scene_of("human34", 4, left_shoulder_elevation=0.9, right_elbow_flexion=1.2, left_hip_flexion=0.5)


@pytest.fixture(scope="module")
def proposed(person: Scene) -> AllPartProposals:
    return proposals_of(person)


def test_candidates_lie_where_all_views_see_the_person(person, proposed) -> None:
    graph, views, _, _ = person
    for limb, proposals in zip(graph.limbs, proposals_of(person, HullSettings(overlooked=0, poses=1000)), strict=True):
        t, R = placements_of(proposals.points)
        middle = t + 0.5 * (limb.start + limb.end) * R[:, :, 2]
        for view in views:
            away = cv2.distanceTransform((view.foreground == 0).astype(np.uint8), cv2.DIST_L2, 5)
            x, y = np.rint(view.camera.project(middle)).astype(int).T
            shown = (x >= 0) & (y >= 0) & (x < 640) & (y < 480)
            assert shown.mean() > 0.9
            # half a 60 mm cell plus half its diagonal, at 714 px per metre at a distance of 1 m
            depth = (middle @ view.camera.R_camera_world.T + view.camera.t_camera_world)[:, 2]
            assert (away[y[shown], x[shown]] * depth[shown]).max() < 714.0 * (0.03 + 0.052) * 1.1
    for proposals in proposed:
        assert 10 < len(proposals.points) <= SMALL.count
        assert proposals.weights.max() == 1.0
        assert (proposals.weights > 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(proposals.points[:, 3:], axis=1), 1.0)


def test_candidates_differ(proposed) -> None:
    for proposals in proposed:
        t, R = placements_of(proposals.points)
        far = np.linalg.norm(t[:, None] - t, axis=2) >= SMALL.apart
        turned = R[:, :, 2] @ R[:, :, 2].T <= np.cos(SMALL.turned) + 1e-9
        assert (far | turned | np.eye(len(t), dtype=bool)).all()


def test_true_limbs_are_among_the_candidates(person, proposed) -> None:
    graph, _, t, R = person
    rates = instant_rates(proposed, t, R, graph.mirror)
    assert rates[:, RATES.index("recall, either side")].mean() >= 0.7


@pytest.mark.parametrize(("name", "cameras"), [("arm8", 3), ("upper13", 4), ("human34", 2)])
def test_other_bodies_and_fewer_cameras(name: str, cameras: int) -> None:
    scene = scene_of(name, cameras)
    graph, _, t, R = scene
    rates = instant_rates(proposals_of(scene), t, R, graph.mirror)
    assert rates[:, RATES.index("recall, either side")].mean() >= 0.6


def test_equal_seeds_give_equal_bits(person, proposed) -> None:
    for a, b in zip(proposed, proposals_of(person), strict=True):
        assert a.points.tobytes() == b.points.tobytes()
        assert a.weights.tobytes() == b.weights.tobytes()


def test_empty_silhouettes_give_no_candidates_and_no_background_gives_some(person) -> None:
    graph, views, _, _ = person
    black = np.zeros((480, 640, 3), np.uint8)
    empty = [limb_view(v.camera, black, np.zeros((480, 640), bool)) for v in views]
    assert [len(s.points) for s in proposals_of(person, views=empty)] == [0] * len(graph.limbs)
    one_sees = [empty[0], empty[1], views[2]]
    assert [len(s.points) for s in proposals_of(person, views=one_sees)] == [0] * len(graph.limbs)
    for masked in (None, np.zeros((480, 640), bool)):  # without a background, and with an unknown one
        bare = [limb_view(v.camera, black, masked, masked) for v in views]
        for proposals in proposals_of(person, HullSettings(poses=500, rounds=1), bare):
            assert np.isfinite(proposals.points).all()
            assert np.isfinite(proposals.weights).all()
    for proposals in proposals_of(person, views=views[:1]):  # one camera
        assert len(proposals.points)
        assert np.isfinite(proposals.points).all()


def test_a_view_may_overlook_what_two_others_see(person) -> None:
    graph, views, t, R = person
    hidden = limb_view(views[0].camera, np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), bool))
    four = [hidden, *views[1:]]
    box = LimbLikelihood(graph.limbs, four).box
    middles = t + 0.5 * np.array([[limb.start + limb.end] for limb in graph.limbs]) * R[:, :, 2]
    assert visual_hull(views, box, 0.06, 0).holds(middles).all()
    assert not visual_hull(four, box, 0.06, 0).holds(middles).any()
    assert visual_hull(four, box, 0.06, 1).holds(middles).all()
    assert not visual_hull(four[:2], box, 0.06, 1).holds(middles).any()  # a second that sees them is needed


def test_what_is_right() -> None:
    R = np.eye(3)[None].repeat(4, axis=0)
    tilt = np.radians(31.0)
    R[2] = [[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), np.cos(tilt)]]
    R[3] = np.diag([-1.0, -1.0, 1.0])  # turned about its axis alone
    t = np.array([[0.0, 0.0, 0.09], [0.0, 0.0, 0.11], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    proposals = PartProposals(points_of(t, R), np.array([4.0, 1.0, 1.0, 2.0]))
    assert right(proposals, np.zeros(3), np.eye(3)).tolist() == [True, False, False, True]
    rates = instant_rates((proposals, proposals), np.array([[0.0, 0.0, 5.0], np.zeros(3)]), R[:2], (1, 0))
    np.testing.assert_allclose(rates, [[0.0, 1.0, 0.5, 0.75, 4.0], [1.0, 1.0, 0.5, 0.75, 4.0]])


def test_what_a_pose_leaves_over_is_what_it_does_not_cover(person) -> None:
    graph, views, t, R = person
    left_over, arm = LeftOver(graph.limbs, views), graph.names.index("right_forearm")
    assert left_over.share(t, R) < 0.01
    assert left_over.share(t + 50.0 * np.eye(3)[0], R) == pytest.approx(len(views), abs=0.1)
    inside = t.copy()
    inside[arm] = t[graph.names.index("torso")]
    assert left_over.share(inside, R) > left_over.share(t, R) + 0.02
    for whole, rest in zip(views, left_over.views(inside, R), strict=True):
        assert ((rest.foreground == SCENE) == (whole.foreground == SCENE)).all()
        assert 0.0 < (rest.foreground == PERSON).sum() < 0.3 * (whole.foreground == PERSON).sum()


def test_a_forearm_in_place_of_the_trunk_is_proposed_as_a_forearm(person) -> None:
    graph, views, t, R = person
    arm, wrong = graph.names.index("right_forearm"), t.copy()
    wrong[arm] = t[graph.names.index("torso")]
    left = LeftOver(graph.limbs, views).views(wrong, R)
    likelihood = LimbLikelihood(graph.limbs, views)
    places = left_over_places(np.random.default_rng(0), graph, likelihood, left, HullSettings())
    assert set(places) <= set(outermost(graph))
    length = graph.limbs[arm].length
    true = np.stack([t[arm], t[arm] + length * R[arm, :, 2]])
    received = [placements_of(place.point[None]) for place in places[arm]]
    ends = [np.stack([a[0], a[0] + length * b[0, :, 2]]) for a, b in received]
    assert min(np.linalg.norm(e - true, axis=1).mean() for e in ends) < 0.1
