"""Parallel (orthographic) cameras, wherever cameras are used: closed forms, and properties shared with pinholes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.data.cameras.camera import Camera, parallel_camera
from estimator.data.cameras.epipolar import Rays, essential_matrix
from estimator.data.cameras.projection import (
    add_projection_curvature,
    pack_cameras,
    project_point,
    project_with_jacobian,
)
from estimator.data.formats.cameras import load_cameras, write_cameras
from estimator.data.formats.cameras_json import camera_from_json, camera_to_json
from estimator.data.formats.keypoints import load_keypoints
from estimator.search.first_pose import view_sphere
from estimator.search.jumps import KinematicJumps
from estimator.search.jumps.limb_solutions import limb_solutions, pose_on_rays, turned
from estimator.synthesis.render import Renderer
from estimator.synthesis.settings import SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from estimator.vision.patches import patch_view
from estimator.vision.prediction import Prediction, Predictor
from estimator.vision.stereo import undistortion_maps
from estimator.vision.visibility import OUTER, VISIBLE
from humanoid.kinematics.body import ROOT_PLACE_Q, Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from tests.builders import BROWN, bent, body_of, camera_at, observe, random_pose

MIDDLE = np.array([0.1, -0.05, 0.2])
FISHEYE = replace(camera_at(20.0), distortion=np.array([0.02, -0.01, 0.003, 0.001]), fisheye=True)
LONG = replace(camera_at(20.0), distortion=np.array([-0.1, 0.02, 1e-3, 2e-3, 0.01, 0.1, 0.01, 0.002]))


def skewed() -> Camera:
    """A parallel camera that looks along no axis, with oblong pixels, a skew and an eccentric middle."""
    camera = camera_at(33.0, height=1.1)
    K = np.array([[181.0, 3.0, 300.0], [0.0, 165.0, 260.0], [0.0, 0.0, 1.0]])
    return replace(camera, K=K, parallel=True)


def points_around(count: int = 40, spread: float = 0.5) -> np.ndarray:
    return spread * np.random.default_rng(3).normal(size=(count, 3))


# ---- the projection


def test_kernels_are_the_linear_map_and_its_derivatives() -> None:
    camera, jacobian, curvature = skewed(), np.zeros((2, 3)), np.zeros((3, 3))
    for p in points_around(spread=5.0):  # some of them behind the camera's plane
        x = camera.R_camera_world @ p + camera.t_camera_world
        expected = camera.K[:2, :2] @ x[:2] + camera.K[:2, 2]
        np.testing.assert_allclose(camera.project(p), expected, rtol=1e-12)
        np.testing.assert_allclose(project_point(p, *camera.arrays), [*expected, True], rtol=1e-12)
        u, v, seen = project_with_jacobian(p, *camera.arrays, jacobian)
        np.testing.assert_allclose([u, v, seen], [*expected, True], rtol=1e-12)
        step = 1e-2 * np.eye(3)  # the map is linear: no step is too long
        slopes = (camera.project(p + step) - camera.project(p - step)) / 2e-2
        np.testing.assert_allclose(jacobian, slopes.T, atol=1e-8)
        add_projection_curvature(p, *camera.arrays, 0.7, -0.4, curvature)
    assert not curvature.any()


def brown_as_before(camera: Camera, p: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Pixel and Jacobian (2, 3) of a pinhole camera with Brown's lens: operations in the former order."""
    (fx, fy, cx, cy, skew), (k1, k2, p1, p2, k3), R, t = camera.arrays
    x, y, z = (R[i, 0] * p[0] + R[i, 1] * p[1] + R[i, 2] * p[2] + t[i] for i in range(3))
    a, b = x / z, y / z
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    ad = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    bd = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)
    ad_a = radial + 2.0 * a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a
    ad_b = 2.0 * a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
    bd_b = radial + 2.0 * b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a
    u_a, u_b, v_a, v_b = fx * ad_a + skew * ad_b, fx * ad_b + skew * bd_b, fy * ad_b, fy * bd_b
    J = np.zeros((2, 3))
    for k in range(3):
        da, db = (R[0, k] - a * R[2, k]) / z, (R[1, k] - b * R[2, k]) / z
        J[:, k] = u_a * da + u_b * db, v_a * da + v_b * db
    return fx * ad + skew * bd + cx, fy * bd + cy, J


def test_pinholes_are_what_they_were_to_the_bit() -> None:
    camera, jacobian = camera_at(20.0, distortion=BROWN), np.zeros((2, 3))
    for p in points_around():
        u, v, J = brown_as_before(camera, p)
        assert project_point(p, *camera.arrays) == (u, v, True)
        assert project_with_jacobian(p, *camera.arrays, jacobian) == (u, v, True)
        np.testing.assert_array_equal(jacobian, J)


@pytest.mark.parametrize("camera", [FISHEYE, LONG, camera_at(20.0, distortion=BROWN)])
def test_beside_a_parallel_camera_others_project_as_alone(camera: Camera) -> None:
    alone = pack_cameras([camera, LONG])  # the kernels that handle every lens
    mixed = pack_cameras([camera, LONG, skewed()])
    assert mixed[1].ndim == 4
    for p in points_around():
        seen = []
        for packed in (alone, mixed):
            own, jacobian, curvature = (a[0] for a in packed), np.zeros((2, 3)), np.zeros((3, 3))
            arrays = tuple(own)
            pixel = project_with_jacobian(p, *arrays, jacobian)
            assert project_point(p, *arrays) == pixel
            add_projection_curvature(p, *arrays, 0.7, -0.4, curvature)
            seen.append((pixel, jacobian.tolist(), curvature.tolist()))
        assert seen[0] == seen[1]
        parallel = project_point(p, *(a[2] for a in mixed))
        assert parallel == project_point(p, *skewed().arrays)


def test_a_far_pinhole_comes_near_it_as_one_over_the_distance() -> None:
    flat, points = skewed(), points_around()
    x = points @ flat.R_camera_world.T + flat.t_camera_world
    for distance in (10.0, 100.0, 1000.0):
        K = flat.K * [[distance, distance, 1.0], [distance, distance, 1.0], [1.0, 1.0, 1.0]]
        t = flat.t_camera_world + np.array([0.0, 0.0, distance - 4.0])
        pinhole = replace(flat, K=K, t_camera_world=t, parallel=False)
        depth = x[:, 2] - 4.0  # from the plane that both show at the same scale
        off = -(x[:, :2] * (depth / (distance + depth))[:, None]) @ flat.K[:2, :2].T
        np.testing.assert_allclose(pinhole.project(points) - flat.project(points), off, atol=1e-6)


@pytest.mark.parametrize("camera", [skewed(), camera_at(33.0, distortion=BROWN), FISHEYE])
def test_rays_lead_back_to_their_pixels_and_points(camera: Camera) -> None:
    points = points_around()
    pixels = camera.project(points)
    origins, ways = camera.rays(np.vstack([pixels, [[np.nan, 3.0]]]))
    assert np.isnan([origins[-1], ways[-1]]).all()
    origins, ways = origins[:-1], ways[:-1]
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0, atol=1e-12)
    assert (((points - origins) * ways).sum(axis=1) > 0.0).all()  # they lead away from the camera
    for far in (0.5, 7.0):
        np.testing.assert_allclose(camera.project(origins + far * ways), pixels, atol=2e-3)  # of Brown's iterations
    np.testing.assert_allclose(np.cross(points - origins, ways), 0.0, atol=2e-5)
    starts, sights = camera.sight_lines(points)
    np.testing.assert_allclose(np.cross(points - starts, sights), 0.0, atol=1e-12)
    np.testing.assert_allclose(sights, ways, atol=1e-5)


def test_the_helper_faces_a_subject_that_faces_x() -> None:
    front = parallel_camera("front", (640, 480), 200.0, MIDDLE)
    np.testing.assert_allclose(front.project(MIDDLE), [319.5, 239.5])
    shown = front.project(MIDDLE + 0.1 * np.eye(3)) - front.project(MIDDLE)
    np.testing.assert_allclose(shown, [[0.0, 0.0], [20.0, 0.0], [0.0, -20.0]], atol=1e-9)  # its left is at the right
    assert front.depths(MIDDLE + np.eye(3)[0]) == pytest.approx(9.0)
    left = parallel_camera("left", (640, 480), 200.0, MIDDLE, azimuth=0.5 * np.pi)
    np.testing.assert_allclose(left.project(MIDDLE + np.array([0.1, 5.0, 0.0])), [299.5, 239.5], atol=1e-9)


# ---- files and refusals


def test_files_keep_the_kind_to_the_bit(tmp_path: Path) -> None:
    given = [skewed(), replace(camera_at(20.0, distortion=BROWN), name="b"), replace(FISHEYE, name="c")]
    write_cameras(tmp_path / "c.json", given)
    for camera, again in zip(given, load_cameras(tmp_path / "c.json").values(), strict=True):
        assert camera_to_json(camera) == camera_to_json(again)
        assert (camera.parallel, camera.fisheye) == (again.parallel, again.fisheye)
        assert camera.project(MIDDLE).tolist() == again.project(MIDDLE).tolist()
    assert "parallel" not in camera_to_json(given[1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parallel": "yes"}, "c.parallel"),
        ({"parallel": True, "distortion": [0.1, 0.0, 0.0, 0.0, 0.0]}, "c.distortion"),
        ({"parallel": True, "fisheye": True, "distortion": [0.0] * 4}, "c.fisheye"),
        ({"parallel": True, "K": [[0.0, 0, 1], [0, 1, 1], [0, 0, 1]]}, "a scale is not positive"),
    ],
)
def test_bad_entries_are_refused_with_their_place(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        camera_from_json(camera_to_json(camera_at(0.0)) | change, "f.json", "c")


@pytest.mark.parametrize(
    "use",
    [
        lambda c: c.centre_world,
        lambda c: c.directions(np.zeros((1, 2))),
        lambda c: undistortion_maps(c, c.K, c.image_size),
        lambda c: Rays.of(c, np.zeros((1, 2, 2))),
        lambda c: essential_matrix(c, camera_at(0.0)),
        lambda c: patch_view(c, np.zeros((4, 4), np.uint8), np.zeros((4, 4), bool)),
        lambda c: replace(c, distortion=np.array(BROWN)).project(MIDDLE),
        lambda c: ViewSettings(parallel=True, baseline=0.1),
    ],
)
def test_what_needs_a_centre_refuses_it_in_one_line(use: Callable[[Camera], Any]) -> None:
    with pytest.raises(InputError, match="parallel") as caught:
        use(skewed())
    assert "\n" not in str(caught.value)


# ---- flips and starts


@pytest.mark.parametrize("name", ["human34", "arm8", "upper13"])
def test_flips_keep_the_image_and_mirror_the_depth(name: str) -> None:
    body, camera, rng = body_of(name), skewed(), np.random.default_rng(5)
    jumps, mirrored = KinematicJumps(body), 0
    for _ in range(6):
        q = random_pose(body, rng, share=0.7, turn=0.5)
        evidence = pose_on_rays(body, q, camera)
        for limb in jumps.limbs:
            before = evidence.points[limb.landmarks]
            for solution in limb_solutions(body, evidence, limb):
                after = body.landmarks(body.at(turned(body, q, limb.dofs, solution.turns)))[limb.landmarks]
                off = np.abs(camera.project(after) - camera.project(before)).max()
                assert off < 190.0 * solution.error + 1e-6
                if solution.error > 1e-6:
                    continue
                # each segment's step in depth keeps its size, with either sign
                steps = np.diff(camera.depths(before)), np.diff(camera.depths(after))
                np.testing.assert_allclose(np.abs(steps[1]), np.abs(steps[0]), atol=1e-4)
                mirrored += int((steps[0] * steps[1] < -1e-4).any())
    assert mirrored > 5


def test_a_start_needs_no_depth() -> None:
    """With the pose at rest one of the starts has every landmark on its pixel, and the root as deep as at rest."""
    body, camera = body_of("human34"), skewed()
    q = body.neutral.copy()
    q[ROOT_PLACE_Q] = [0.3, 0.2, 0.1]
    seen = observe(body, q, [camera])
    starts = view_sphere(body, body.neutral, seen)
    off = [np.abs(camera.project(body.landmarks(body.at(s))) - seen.pixels[0]).max() for s in starts]
    assert min(off) < 40.0
    depths = [camera.depths(s[ROOT_PLACE_Q]) for s in starts]
    np.testing.assert_allclose(depths, camera.depths(np.zeros(3)), atol=1e-9)


# ---- pictures


def silhouette(body: Body, q: np.ndarray, camera: Camera, nodes: int) -> np.ndarray:
    """Pixels whose centres lie in the projected triangles of a body's surface, (H, W) bool."""
    surface = surface_of(body, nodes=nodes)
    pixels = camera.project(points_in_world(body.at(q), surface.joint, surface.local))
    mask = np.zeros(camera.image_size[::-1], bool)
    for corners in pixels[surface.faces]:
        (x0, y0), (x1, y1) = np.ceil(corners.min(axis=0)).astype(int), np.floor(corners.max(axis=0)).astype(int)
        y, x = np.mgrid[y0 : y1 + 1, x0 : x1 + 1]
        sides = [
            (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            for a, b in zip(corners, corners[[1, 2, 0]], strict=True)
        ]
        mask[y, x] |= np.all(np.array(sides) <= 0.0, axis=0)  # of front sides
    return mask


def drawn(camera: Camera, **angles: float) -> tuple[Body, np.ndarray, Any]:
    body = body_of("upper13")
    q = bent(body, left_shoulder_flexion=0.9, left_elbow_flexion=1.2, right_elbow_flexion=1.9, **angles)
    renderer = Renderer(body, [camera], np.random.default_rng(0), SceneSettings(background="black"))
    return body, q, renderer.maps(body.at(q), 0)


def test_what_is_rendered_is_the_projected_surface() -> None:
    camera = parallel_camera("front", (320, 240), 130.0, np.array([0.0, 0.0, 0.2]), azimuth=0.6)
    body, q, maps = drawn(camera)
    filled = silhouette(body, q, camera, 6000)
    assert maps.mask.sum() > 3000
    assert np.count_nonzero(maps.mask != filled) <= 2  # centres that lie on an outline
    # the map has the depth of every nearest node that faces the camera
    surface = surface_of(body, nodes=6000)
    world = points_in_world(body.at(q), surface.joint, surface.local)
    u, v = np.round(camera.project(world)).astype(int).T
    gap = camera.depths(world) - maps.depth[v, u]
    assert np.isinf(maps.depth[~maps.mask]).all()
    near = np.isfinite(gap)
    assert near.mean() > 0.93
    assert np.quantile(gap[near], 0.05) > -0.02  # nothing is in front of the visible surface, up to a pixel's slope
    assert (np.abs(gap[near]) < 0.01).mean() > 0.2


def predicted(camera: Camera, q: np.ndarray) -> Prediction:
    body = body_of("upper13")
    return Predictor(surface_of(body), camera).predict(body.at(q))


def test_the_prediction_sees_what_is_rendered_from_any_depth() -> None:
    camera = parallel_camera("front", (320, 240), 130.0, np.array([0.0, 0.0, 0.2]), azimuth=0.6)
    body, q, maps = drawn(camera)
    seen = predicted(camera, q)
    u, v = np.round(seen.pixels).astype(int).T
    gap = camera.depths(points_in_world(body.at(q), *_nodes(body))) - maps.depth[v, u]
    known = np.isfinite(gap)
    assert (np.abs(gap[(seen.state == VISIBLE) & known]) < 0.03).mean() > 0.95
    assert (gap[(seen.state != VISIBLE) & known] > 0.01).mean() > 0.95
    outer = seen.contours.pixels[seen.contours.state == OUTER]
    edge = cv2.distanceTransform((~_border(maps.mask)).astype(np.uint8), cv2.DIST_L2, 5)
    x, y = np.round(outer).astype(int).T
    assert len(outer) > 40
    assert np.quantile(edge[y, x], 0.9) < 2.5
    for depth in (-300.0, -10.0, 200.0):  # the body behind the camera's plane, or far before it: the same image
        other = predicted(replace(camera, t_camera_world=camera.t_camera_world + np.array([0.0, 0.0, depth])), q)
        np.testing.assert_array_equal(other.pixels, seen.pixels)
        np.testing.assert_array_equal(other.state, seen.state)
        np.testing.assert_array_equal(other.contours.state, seen.contours.state)


def _nodes(body: Body) -> tuple[np.ndarray, np.ndarray]:
    surface = surface_of(body)
    return surface.joint, surface.local


def _border(mask: np.ndarray) -> np.ndarray:
    return np.asarray(mask & ~cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool))


def test_framed_as_large_as_by_a_pinhole() -> None:
    body = body_of("upper13")
    poses = [random_pose(body, np.random.default_rng(k), share=0.5) for k in range(5)]
    points = np.array([points_in_world(body.at(q), *_nodes(body)) for q in poses])
    (flat,), (pinhole,) = (framing_cameras(points, ViewSettings(parallel=p, fill=0.4)) for p in (True, False))
    tall = [np.ptp(c.project(points)[..., 1], axis=1).max() for c in (flat, pinhole)]
    assert tall[0] == pytest.approx(tall[1], rel=0.15)
    np.testing.assert_array_equal(flat.R_camera_world, pinhole.R_camera_world)
    assert (flat.depths(points) > 0.5).all()


# ---- tracking


@pytest.mark.parametrize("name", ["upper13", "arm8"])
def test_tracked_to_the_truth_but_for_depths_that_are_not_seen(name: str) -> None:
    body = body_of(name)
    camera = parallel_camera("front", (640, 480), 330.0, np.array([0.0, 0.0, 0.1]), azimuth=0.4)
    rng = np.random.default_rng(2)
    start, end = (random_pose(body, rng, share=0.5) for _ in range(2))
    truth = [body.integrate(start, k * 0.08 * body.difference(start, end)) for k in range(4)]
    clip = [observe(body, q, [camera], noise=1.0, rng=rng, index=i, time=i / 25) for i, q in enumerate(truth)]
    chosen = settings_for("css", modes=4, changes={"css": {"samples": 4, "budget": {"searches": 16}}})
    results = [r for r, _ in run(make_tracker("css", body, chosen), clip, 0)]
    for q, result in zip(truth, results, strict=True):
        points = body.landmarks(body.at(q))
        modes = [body.landmarks(body.at(mode)) for mode in result.q]
        best = min(modes, key=lambda m: np.linalg.norm(m - points, axis=1).mean())
        np.testing.assert_allclose(camera.project(modes[0]), camera.project(points), atol=12.0)
        assert np.linalg.norm(best - points, axis=1).mean() < 0.06


def test_a_rendered_clip_has_its_truth_in_a_parallel_camera(tmp_path: Path) -> None:
    exact = "--keypoint-noise 0 --outliers 0 --missing 0"
    given = f"render --motion random --subject upper13 --parallel --seconds 0.07 {exact}"
    assert front.main([*given.split(), "--out", str(tmp_path)]) == 0
    (camera,) = load_cameras(tmp_path / "cameras.json").values()
    assert camera.parallel
    truth, track = np.load(tmp_path / "truth.npz"), load_keypoints(tmp_path / "keypoints" / "cam01.json")
    order = [truth["landmark_names"].tolist().index(name) for name in track.names]
    np.testing.assert_allclose(track.pixels, camera.project(truth["landmarks"][:, order]), atol=0.01)
