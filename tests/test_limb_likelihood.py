"""The likelihood of limbs: outlines against brute force, laws of views and volumes, true poses against false ones."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.papers_loose_limbed.limb_pictures import moved_away
from estimator.data.cameras.camera import Camera
from estimator.synthesis.plate import place_of
from estimator.synthesis.render import Renderer
from estimator.synthesis.settings import SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.trackers.loose_limbed.limbs.features import FEATURES, _outlined, cone_of
from estimator.trackers.loose_limbed.limbs.likelihood import (
    LimbLikelihood,
    LimbSettings,
    LimbView,
    common_box,
    limb_view,
)
from estimator.trackers.loose_limbed.limbs.models import SHIPPED, load_models, shipped_models
from humanoid.kinematics.body import points_in_world
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import Limb, limb_placements
from humanoid.shape.surface import surface_of
from humanoid.support.errors import InputError
from tests.builders import BROWN, bent, body_of, camera_at

LIMB = Limb(
    "some", ("some",), "some", np.zeros(3), np.eye(3), 0.4, 0.02, 0.4, np.array([0.1, 0.06]), np.array([0.05, 0.04])
)
INSIDE = np.array([[0.0, 0.0, 0.1], [0.2, -0.1, 0.0], [-0.1, 0.3, -0.2]])
NO_LIMIT = LimbSettings(margin=100.0)


def noise_view(camera: Camera, seed: int = 0, *, masked: bool = True) -> LimbView:
    rng = np.random.default_rng(seed)
    small = rng.uniform(0, 255, (24, 32, 3))
    picture = np.kron(small, np.ones((20, 20, 1))).astype(np.uint8)
    mask = np.kron(rng.random((24, 32)) < 0.5, np.ones((20, 20))) > 0
    return limb_view(camera, picture, mask if masked else None)


def some_rotations(count: int) -> np.ndarray:
    return np.asarray(Rotation.random(count, random_state=np.random.default_rng(3)).as_matrix())


def test_the_outline_is_where_the_cone_ends_across_the_line_of_sight() -> None:
    camera = camera_at(30.0, distortion=BROWN)
    points, across = np.empty((6, 3, 2)), np.empty(2)
    round_about = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    for t, R in zip(INSIDE, some_rotations(3), strict=True):
        half = _outlined(cone_of(LIMB), t, R, camera.arrays, across, points, np.array([480, 640]))
        widths = []
        for k in range(6):
            share = (k + 0.5) / 6
            a, b = (1 - share) * LIMB.proximal + share * LIMB.distal
            z = np.full(4000, LIMB.start + share * (LIMB.end - LIMB.start))
            ring = np.stack([a * np.cos(round_about), b * np.sin(round_about), z], axis=1) @ R.T + t
            side = np.cross(R[:, 2], ring.mean(axis=0) - camera.centre_world)
            ends = ring[[np.argmax(ring @ side), np.argmin(ring @ side)]]
            np.testing.assert_allclose(points[k, 1:], camera.project(ends), atol=0.05)
            np.testing.assert_allclose(points[k, 0], camera.project(ring.mean(axis=0)), atol=1e-6)
            widths.append(np.linalg.norm(points[k, 1] - points[k, 2]))
        assert half == pytest.approx(0.5 * np.mean(widths))
        # the sides lie across the axis in the picture, too
        along = (points[-1, 0] - points[0, 0]) / np.linalg.norm(points[-1, 0] - points[0, 0])
        assert abs(along @ across) < 1e-9


def test_a_bar_before_black_is_measured_as_it_is() -> None:
    """A bright upright bar, as wide as the limb and longer: both edges, a ridge; inside and beyond its ends is the
    person, beside it is not."""
    camera = camera_at(0.0, height=0.0)
    limb = replace(LIMB, start=0.0, end=1.0, proximal=np.full(2, 0.06), distal=np.full(2, 0.06))
    t, R = np.array([[0.0, 0.0, -0.5]]), np.eye(3)[None]
    left, right = sorted(camera.project(np.array([[0.0, 0.06, 0.0], [0.0, -0.06, 0.0]]))[:, 0])
    mask = np.zeros((480, 640), bool)
    mask[:, round(left) : round(right) + 1] = True
    values = limb_view(camera, np.where(mask[..., None], 200, 0).astype(np.uint8).repeat(3, axis=2), mask).features(
        limb, t, R
    )
    named = dict(zip(FEATURES, values[0], strict=True))
    step = 200.0 / np.sqrt(2.0 * np.pi)
    assert named["left edge"] == pytest.approx(step / (step + 4.0), rel=0.02)
    assert named["right edge"] == pytest.approx(step / (step + 4.0), rel=0.02)
    assert named["ridge"] > 0.3 * 200.0
    assert [named[name] for name in FEATURES[3:]] == [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]


def test_views_are_added_and_the_world_may_be_turned() -> None:
    cameras = [camera_at(10.0), camera_at(110.0, distortion=BROWN)]
    views = [noise_view(camera, seed) for seed, camera in enumerate(cameras)]
    R = some_rotations(3)
    both = LimbLikelihood([LIMB], views, settings=NO_LIMIT).log_ratio(0, INSIDE, R)
    each = [LimbLikelihood([LIMB], [view], settings=NO_LIMIT).log_ratio(0, INSIDE, R) for view in views]
    np.testing.assert_allclose(both, each[0] + each[1], atol=1e-12)
    turn, shift = some_rotations(1)[0], np.array([1.0, -2.0, 0.5])
    elsewhere = [
        replace(
            view,
            camera=replace(
                view.camera,
                R_camera_world=view.camera.R_camera_world @ turn.T,
                t_camera_world=view.camera.t_camera_world - view.camera.R_camera_world @ turn.T @ shift,
            ),
        )
        for view in views
    ]
    moved = LimbLikelihood([LIMB], elsewhere, settings=NO_LIMIT).log_ratio(0, INSIDE @ turn.T + shift, turn @ R)
    np.testing.assert_allclose(moved, both, atol=1e-9)


def test_a_view_without_background_is_one_whose_foreground_does_not_count() -> None:
    camera, R = camera_at(10.0), some_rotations(3)
    bare = LimbLikelihood([LIMB], [noise_view(camera, masked=False)], settings=NO_LIMIT)
    outline_only = LimbLikelihood([LIMB], [noise_view(camera)], settings=replace(NO_LIMIT, foreground=False))
    np.testing.assert_allclose(bare.log_ratio(0, INSIDE, R), outline_only.log_ratio(0, INSIDE, R), atol=1e-12)
    unknown = limb_view(
        camera, np.zeros((480, 640, 3), np.uint8), np.ones((480, 640), bool), np.zeros((480, 640), bool)
    )
    assert np.isnan(unknown.features(LIMB, INSIDE, R)[:, 3:]).all()


def test_beyond_the_common_volume_there_is_nothing() -> None:
    cameras = [camera_at(0.0), camera_at(90.0)]
    likelihood = LimbLikelihood([LIMB], [noise_view(c) for c in cameras])
    low, high = likelihood.box
    R = np.eye(3)[None].repeat(2, axis=0)
    middle = np.array([0.0, 0.0, 0.5 * (LIMB.start + LIMB.end)])
    at = np.array([high + np.array([0.01, 0.0, 0.0]), 0.5 * (low + high)]) - middle
    assert np.isneginf(likelihood.log_ratio(0, at, R)).tolist() == [True, False]
    # a corner of the box that a view does not show: the view counts as `unseen`
    corner = np.array([high - 0.01]) - middle
    shown = [np.isfinite(view.features(LIMB, corner, R[:1])[0, 0]) for view in (noise_view(c) for c in cameras)]
    assert shown == [False, False]
    assert likelihood.log_ratio(0, corner, R[:1])[0] == 2.0 * likelihood.settings.unseen
    looks_away = replace(cameras[1], R_camera_world=np.diag([-1.0, 1.0, -1.0]) @ cameras[1].R_camera_world,
                         t_camera_world=np.diag([-1.0, 1.0, -1.0]) @ cameras[1].t_camera_world)  # fmt: skip
    with pytest.raises(InputError, match="no place in common"):
        common_box([cameras[0], looks_away], 12.0, 0.1)


def test_every_place_that_all_cameras_see_is_in_the_box() -> None:
    cameras = [camera_at(0.0), camera_at(120.0, height=1.5), camera_at(240.0)]
    low, high = common_box(cameras, 12.0, 0.15)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (4000, 3))
    pixels = np.array([camera.project(points) for camera in cameras])
    seen = ((pixels > 0.0) & (pixels < [639.0, 479.0])).all(axis=(0, 2))
    assert seen.sum() > 100
    assert ((points[seen] > low) & (points[seen] < high)).all()
    assert (np.ptp(points[seen], axis=0) > 0.8 * (high - low - 0.3)).all()


def test_no_view_and_no_volume_give_no_nan() -> None:
    camera = camera_at(0.0)
    black = limb_view(camera, np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), bool))
    likelihood = LimbLikelihood([LIMB], [black], settings=replace(NO_LIMIT, unseen=-5.0))
    centre, forward = camera.centre_world, camera.R_camera_world[2]
    towards = Rotation.align_vectors(forward[None], [[0.0, 0.0, 1.0]])[0].as_matrix()
    t = np.array([centre, centre - 0.5 * forward, centre + forward, centre + 2.0 * forward])
    ratios = likelihood.log_ratio(0, t, np.stack([np.eye(3), np.eye(3), towards, towards]))
    assert np.isfinite(ratios).all()
    assert ratios[1] == -5.0


@pytest.fixture(scope="module")
def standing() -> tuple[tuple[Limb, ...], list[LimbView], np.ndarray, np.ndarray]:
    body = body_of("human34")
    graph, q = limb_graph(body), bent(body, left_shoulder_elevation=0.9, right_elbow_flexion=1.2, left_hip_flexion=0.5)
    surface = surface_of(body, nodes=300)
    points = points_in_world(body.at(q), surface.joint, surface.local)[None]
    cameras = framing_cameras(points, ViewSettings(count=3, image_size=(320, 240), fill=0.85))
    rng = np.random.default_rng(7)
    renderer = Renderer(body, cameras, rng, SceneSettings("room"), place_of(points))
    views = [
        limb_view(camera, renderer.frame(body.at(q), c, rng), renderer.maps(body.at(q), c).mask)
        for c, camera in enumerate(cameras)
    ]
    return graph.limbs, views, *limb_placements(graph, body, q)


@pytest.mark.parametrize(("foreground", "least"), [(True, 0.95), (False, 0.75)])
def test_the_true_pose_beats_far_ones(standing, foreground: bool, least: float) -> None:
    """A person in clothes and a room outside the training set, in three small pictures."""
    limbs, views, t, R = standing
    likelihood = LimbLikelihood(limbs, views, settings=LimbSettings(foreground=foreground))
    rng, shares = np.random.default_rng(0), []
    for i in range(len(limbs)):
        far = moved_away(rng, t[i], 400, 0.2, 1.0)
        ratios = likelihood.log_ratio(i, np.concatenate([t[i : i + 1], far]), np.repeat(R[i : i + 1], 401, axis=0))
        shares.append(float(np.mean(ratios[0] > ratios[1:])))
    assert np.mean(shares) > least + 0.02
    assert min(shares) > least


def test_a_limb_of_any_name_has_a_density() -> None:
    models = shipped_models()
    both, coarse = models.log_ratios("no such limb", ("edges", "ridges", "foreground"))
    levels = [len(b) + 1 for b in models.bins]
    assert both.size == np.prod(levels)
    assert coarse.size == np.prod(levels[:3])
    assert np.isfinite(both).all()


def test_what_ships_is_small_and_has_not_seen_the_test_clip() -> None:
    assert SHIPPED.stat().st_size < 300_000
    about = json.loads(SHIPPED.read_text())["about"]
    assert "Clips" in about
    assert not re.search(r"(07|16|49)_\d\d", about)


def test_a_file_round_trips_and_a_damaged_one_is_refused(tmp_path: Path) -> None:
    models, path = shipped_models(), tmp_path / "again.json"
    models.save(path, "again")
    again = load_models(path)
    for name in ("head", "torso"):
        for a, b in zip(again.log_ratios(name, ("edges",)), models.log_ratios(name, ("edges",)), strict=True):
            np.testing.assert_allclose(a, b, atol=0.02)
    content = json.loads(path.read_text())
    damaged = {
        "bins": content | {"bins": content["bins"] | {"ridge": [3.0, 2.0]}},
        "marginals": content | {"marginals": [["ridge", "colour"]]},
        "background": content | {"background": content["background"][:-1]},
        "any limb": {k: v for k, v in content.items() if k != "any limb"},
    }
    for place, wrong in damaged.items():
        path.write_text(json.dumps(wrong))
        with pytest.raises(InputError, match=place):
            load_models(path)
