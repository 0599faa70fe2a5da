"""Clips with known truth: motions are possible, pictures, masks, depths and keypoints agree with the truth."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from estimator.runs.evaluation import limit_violations
from estimator.runs.reference_motion import Reference
from estimator.synthesis.clothing import Garment, dressed
from estimator.synthesis.detector import first_frame, keypoints
from estimator.synthesis.motion import MOTION_SECONDS, authored_motion
from estimator.synthesis.motion_keys import MOTIONS
from estimator.synthesis.plate import place_of
from estimator.synthesis.raster import paint
from estimator.synthesis.render import Renderer
from estimator.synthesis.scene import write_truth
from estimator.synthesis.settings import DetectorSettings, SceneSettings, ViewSettings
from estimator.synthesis.views import framing_cameras, scene_cameras
from estimator.vision.stereo import StereoPair
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.landmarks import COCO17, landmark_spread
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from tests.builders import camera_at

TIMES = np.arange(round(30 * MOTION_SECONDS)) / 30.0


@pytest.fixture(scope="module")
def body() -> Body:
    return Body(load_subject("human34").scaled({"left_knee_flexion": 1.07, "left_elbow_flexion": 1.05}))


@pytest.fixture(scope="module")
def q(body: Body) -> np.ndarray:
    return authored_motion(body, TIMES)


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_motions_are_possible(motion) -> None:
    body = Body(load_subject(motion.subject))
    times = np.arange(round(30 * motion.seconds)) / 30.0
    q = authored_motion(body, times, motion)
    assert limit_violations(body, q) == 0
    self_collision = SelfCollision(body)
    assert max(self_collision.penetration(body.at(pose)) for pose in q[::3]) < 0.003
    # nothing jumps: no degree of freedom changes its speed faster than a person can
    speed = np.array([body.difference(a, b) for a, b in pairwise(q)]) * 30.0
    assert np.abs(np.diff(speed, axis=0)).max() * 30.0 < 60.0
    assert 1.0 < np.abs(speed).max() < 8.0
    if body.has_free_root:
        np.testing.assert_allclose(np.linalg.norm(q[:, 3:7], axis=1), 1.0)
        soles = [i for i, n in enumerate(body.landmark_names) if n.endswith(("heel", "toe"))]
        lowest = np.array([body.landmarks(body.at(pose))[soles, 2].min() for pose in q[::3]])
        assert np.abs(lowest).max() < 0.02
    assert {"human30": 30, "arm8": 8, "upper13": 13}.get(motion.subject, 34) == body.nv


def test_motion_does_not_depend_on_the_requested_times(body: Body, q: np.ndarray) -> None:
    np.testing.assert_array_equal(authored_motion(body, TIMES[7:9]), q[7:9])


def test_motion_of_another_body_is_refused() -> None:
    with pytest.raises(InputError, match="lumbar_flexion"):
        authored_motion(Body(load_subject("arm8")), TIMES)
    with pytest.raises(InputError, match="no fixed base"):
        authored_motion(Body(load_subject("arm8", base="free")), TIMES, MOTIONS["arm"])


def test_the_nearer_triangle_hides_the_farther() -> None:
    image, nearness = np.zeros((20, 20, 3), dtype=np.float32), np.zeros((20, 20))
    corners = np.array([[2.0, 2.0], [16.0, 2.0], [2.0, 16.0]])
    pixels, depth = np.concatenate([corners, corners]), np.repeat([1.0, 2.0], 3)
    colour = np.repeat([[10.0, 20.0, 30.0], [200.0, 200.0, 200.0]], 3, axis=0)
    paint(image, nearness, pixels, depth, colour, np.array([[0, 1, 2], [3, 4, 5]]))
    np.testing.assert_allclose(image[4, 4], [10.0, 20.0, 30.0])
    assert np.count_nonzero(nearness) == 15 * 16 // 2
    assert image[17, 17].max() == 0.0


def test_depth_and_part_are_those_of_ray_casting(body: Body, q: np.ndarray) -> None:
    camera = camera_at(35.0, distance=3.5, height=1.2, aim=(0.0, 0.0, 0.95))
    renderer = Renderer(body, [camera], np.random.default_rng(0), SceneSettings(background="black"))
    posed = body.at(q[45])
    maps = renderer.maps(posed, 0)
    surface = surface_of(body, nodes=6000)
    world = points_in_world(posed, surface.joint, surface.local)
    mesh = trimesh.Trimesh(world, surface.faces, process=False)
    v, u = (a.ravel() for a in np.mgrid[60:420:13, 220:420:7])
    rays = np.linalg.solve(camera.K, np.stack([u, v, np.ones_like(u)]).astype(float)).T @ camera.R_camera_world
    depth, part = _cast(mesh, camera.centre_world, rays, surface.part[surface.faces[:, 0]])
    hit = np.isfinite(depth)
    assert 150 < hit.sum() < len(hit)
    agree = maps.mask[v, u] == hit
    assert agree.mean() > 0.995  # a ray may graze an outline
    both = hit & agree
    np.testing.assert_allclose(maps.depth[v, u][both], depth[both], rtol=1e-3)
    assert (maps.part[v, u][both] == part[both]).mean() > 0.995
    assert np.isinf(maps.depth[~maps.mask]).all()


def _cast(
    mesh: trimesh.Trimesh, origin: np.ndarray, rays: np.ndarray, face_part: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest hit along each ray (N, 3) as a multiple of it, and the part hit (Moeller and Trumbore 1997)."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    e1, e2, s = b - a, c - a, origin - a
    across = np.cross(s, e1)
    far = np.einsum("fi,fi->f", e2, across)
    depth, part = np.full(len(rays), np.inf), np.full(len(rays), -1)
    for i, ray in enumerate(rays):
        h = np.cross(ray, e2)
        det = np.einsum("fi,fi->f", e1, h)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y, t = np.einsum("fi,fi->f", s, h) / det, across @ ray / det, far / det
        hits = np.where((x >= 0.0) & (y >= 0.0) & (x + y <= 1.0) & (t > 0.0), t, np.inf)
        best = int(np.argmin(hits))
        if np.isfinite(hits[best]):
            depth[i], part[i] = hits[best], face_part[best]
    return depth, part


def test_cloth_moves_with_the_body(body: Body, q: np.ndarray) -> None:
    camera = camera_at(0.0, distance=3.0, focal=1400.0, height=1.1, aim=(0.0, 0.0, 1.1))
    flat = SceneSettings(background="black", ambient=1.0, diffuse=0.0, noise=0.0)
    renderer = Renderer(body, [camera], np.random.default_rng(0), flat)
    surface = surface_of(body, nodes=6000)
    torso = surface.links.index("torso")
    faces = surface.faces[surface.part[surface.faces[:, 0]] == torso]
    mesh = trimesh.Trimesh(surface.local, faces, process=False)
    local, face = trimesh.sample.sample_surface(mesh, 600, seed=0)
    joint = np.full(600, surface.joint[surface.part == torso][0])
    seen = []
    for turn in (0.0, 0.12):
        move = np.array([0.0, 0.06, 0.04, 0.0, 0.0, turn]) * (turn > 0.0)
        posed = body.at(body.integrate(q[0], np.concatenate([move, np.zeros(body.nv - 6)])))
        picture, maps = renderer.frame(posed, 0, np.random.default_rng(0)).astype(np.float32), renderer.maps(posed, 0)
        world = points_in_world(posed, joint, local)
        at = camera.project(world).astype(np.float32)
        x, y = np.round(at).astype(int).T
        facing = (mesh.face_normals[face] @ posed.rotations[joint[0]].T)[:, 0] > 0.5
        depth = world @ camera.R_camera_world[2] + camera.t_camera_world[2]
        visible = facing & (maps.depth[y, x] > depth - 0.01)
        seen.append((cv2.remap(picture, at[:, None, 0], at[:, None, 1], cv2.INTER_LINEAR)[:, 0, 0], visible))
    both = seen[0][1] & seen[1][1]
    first, second = seen[0][0][both], seen[1][0][both]
    assert both.sum() > 80
    assert first.std() > 15.0  # the fabric has a pattern
    assert np.corrcoef(first, second)[0, 1] > 0.9


def test_pictures_show_the_body_where_it_is(body: Body, q: np.ndarray) -> None:
    cameras = scene_cameras()
    settings = SceneSettings(shadow=0.0, noise=0.0, ambient=0.4, diffuse=0.4)  # no pixel saturates
    renderer = Renderer(body, cameras, np.random.default_rng(0), settings)
    posed = [body.at(q[0]), body.at(q[60])]
    frames = [renderer.frame(pose, 0, np.random.default_rng(5)) for pose in posed]
    for pose, frame in zip(posed, frames, strict=True):
        mask = renderer.maps(pose, 0).mask
        changed = np.abs(frame.astype(int) - renderer.plate(0)).max(axis=2) > 0
        assert not changed[~cv2.dilate(mask.astype(np.uint8), np.ones((3, 3))).astype(bool)].any()
        assert changed[mask].mean() > 0.98
    again = Renderer(body, cameras, np.random.default_rng(0), settings)
    np.testing.assert_array_equal(again.frame(posed[0], 0, np.random.default_rng(5)), frames[0])
    blurred = renderer.frame(posed, 0, np.random.default_rng(5))
    assert np.abs(blurred - np.mean(frames, axis=0)).max() <= 1.0  # rounding


def test_light_shadow_noise_and_blur(body: Body, q: np.ndarray) -> None:
    cameras, posed = scene_cameras()[:1], body.at(q[0])

    def picture(**changes: float) -> tuple[np.ndarray, Renderer]:
        renderer = Renderer(body, cameras, np.random.default_rng(0), SceneSettings(**({"noise": 0.0} | changes)))
        return renderer.frame(posed, 0, np.random.default_rng(1)).astype(float), renderer

    plain, renderer = picture()
    mask = renderer.maps(posed, 0).mask
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3))).astype(bool)
    shade = renderer.plate(0).astype(float) - plain
    assert (shade[~grown] >= 0.0).all()  # a shadow only darkens
    assert (shade[~grown].max(axis=-1) > 10.0).sum() > 300
    noisy, _ = picture(noise=4.0)
    spread = (noisy - plain)[(plain > 30.0) & (plain < 220.0)].std()
    assert spread == pytest.approx(4.0, rel=0.05)
    dark, _ = picture(ambient=0.25, diffuse=0.3)
    assert dark[mask].mean() == pytest.approx(0.5 * plain[mask].mean(), rel=0.05)
    left, right = (picture(light_azimuth=a, light_elevation=10.0)[0] for a in (132.0, -48.0))  # across the view
    columns = np.arange(640)
    west = mask & (columns < np.median(np.nonzero(mask)[1]))
    assert (left - right)[mask & ~west].mean() * (left - right)[west].mean() < 0.0
    soft, _ = picture(lens_blur=2.0)
    assert np.abs(cv2.Laplacian(soft, cv2.CV_64F)).mean() < 0.5 * np.abs(cv2.Laplacian(plain, cv2.CV_64F)).mean()


def test_other_clothes_change_nothing_else(body: Body, q: np.ndarray) -> None:
    cameras, posed, red = scene_cameras()[:1], body.at(q[0]), Garment((40.0, 40.0, 200.0), 0.1, 0.1)
    plain, other = (
        Renderer(body, cameras, np.random.default_rng(0), SceneSettings(noise=0.0), dress=partial(dressed, others=worn))
        for worn in (None, {"thigh": red})
    )
    np.testing.assert_array_equal(plain.plate(0), other.plate(0))
    first, second = (maker.frame(posed, 0, np.random.default_rng(0)).astype(int) for maker in (plain, other))
    thighs = np.isin(plain.maps(posed, 0).part, [k for k, link in enumerate(plain.parts) if link.endswith("thigh")])
    changed = (first != second).any(axis=2)
    assert changed[thighs].mean() > 0.98
    assert not changed[~cv2.dilate(thighs.astype(np.uint8), np.ones((3, 3))).astype(bool)].any()
    assert (second - first)[thighs][:, 2].mean() > 30.0


def test_an_occluder_hides_part_of_the_body_and_touches_none(body: Body, q: np.ndarray) -> None:
    points = _surfaces(body, q[::15])
    cameras = framing_cameras(points, ViewSettings(azimuth=20.0))
    posed, place = body.at(q[40]), place_of(points, 0.0)
    renderers = {
        kind: Renderer(body, cameras, np.random.default_rng(0), SceneSettings(occluder=kind, noise=0.0), place)
        for kind in ("none", "post", "box")
    }
    maps = {kind: renderer.maps(posed, 0) for kind, renderer in renderers.items()}
    for kind in ("post", "box"):
        hidden = maps["none"].mask & ~maps[kind].mask
        assert 0.02 < hidden.sum() / maps["none"].mask.sum() < 0.7
        assert (maps[kind].depth[hidden] < maps["none"].depth[hidden] - 0.1).all()
        assert not (maps[kind].mask & ~maps["none"].mask).any()
        inner = cv2.erode(hidden.astype(np.uint8), np.ones((3, 3))).astype(bool)
        picture = renderers[kind].frame(posed, 0, np.random.default_rng(0))
        np.testing.assert_array_equal(picture[inner], renderers[kind].plate(0)[inner])


@pytest.mark.parametrize("background", ["textured", "moving"])
def test_a_screen_hides_the_person_from_every_camera_and_changes_no_other_picture(
    body: Body, q: np.ndarray, background: str
) -> None:
    """What stereo sees of it lies in one plane."""
    points, posed = _surfaces(body, q[::15]), body.at(q[40])
    cameras = framing_cameras(points, ViewSettings(count=2, baseline=0.12, image_size=(160, 120)))
    place = place_of(points, 0.0)
    hidden, plain = (
        Renderer(body, cameras, np.random.default_rng(0), SceneSettings(background, hidden=spans, noise=0.0), place)
        for spans in ([(1.0, 2.0)], ())
    )
    for c, camera in enumerate(cameras):
        for time in (0.9, 1.0, 1.9, 2.0):
            seen = hidden.frame(posed, c, np.random.default_rng(0), time)
            maps = hidden.maps(posed, c, time)
            if time in (0.9, 2.0):
                np.testing.assert_array_equal(seen, plain.frame(posed, c, np.random.default_rng(0), time))
                assert maps.mask.any()
                continue
            np.testing.assert_array_equal(seen, hidden.frame(body.at(q[0]), c, np.random.default_rng(0), time))
            assert not maps.mask.any()
            assert cv2.Laplacian(cv2.cvtColor(seen, cv2.COLOR_BGR2GRAY), cv2.CV_64F).std() > 10.0
            np.testing.assert_allclose(maps.depth, maps.depth[0, 0])
            assert 0.5 < maps.depth[0, 0] < 0.5 * np.linalg.norm(camera.centre_world[:2] - place.centre)
    left, right = (hidden.frame(posed, c, np.random.default_rng(0), 1.0) for c in (0, 1))
    if background == "textured":
        depth = StereoPair(*cameras[:2]).depth(left, right)
        assert np.isfinite(depth).mean() > 0.6
        away = np.abs(depth - hidden.maps(posed, 0, 1.0).depth)[np.isfinite(depth)]
        assert np.percentile(away, 95) < 0.05


def test_a_moving_background_moves_and_nothing_else_does(body: Body, q: np.ndarray) -> None:
    cameras, settings = scene_cameras()[:1], SceneSettings(background="moving", noise=0.0)
    renderer, posed = Renderer(body, cameras, np.random.default_rng(0), settings), body.at(q[20])
    first, later = (renderer.frame(posed, 0, np.random.default_rng(0), t) for t in (0.0, 0.2))
    inner = cv2.erode(renderer.maps(posed, 0).mask.astype(np.uint8), np.ones((3, 3))).astype(bool)
    # the mask samples pixel centres only: gaps between the feet are narrower than that
    assert (first != later).any(axis=-1)[inner].mean() < 1e-3
    assert (first != later).any(axis=-1)[~inner].mean() > 0.9
    plates = [cv2.cvtColor(renderer.plate(0, t), cv2.COLOR_BGR2GRAY).astype(float) for t in (0.0, 0.2)]
    (dx, _), _ = cv2.phaseCorrelate(plates[0], plates[1], cv2.createHanningWindow((640, 480), cv2.CV_64F))
    assert dx == pytest.approx(settings.pan * np.sin(2.0 * np.pi * 0.2 / 2.5), abs=2.0 * settings.shake)


def test_cameras_see_the_whole_person_at_all_times(body: Body, q: np.ndarray) -> None:
    points = _surfaces(body, q[::5])
    for size in ((640, 480), (480, 640)):
        for camera in framing_cameras(points, ViewSettings(count=3, image_size=size)):
            pixels = camera.project(points)
            assert (pixels > 0.0).all()
            assert (pixels < size).all()
            height = np.ptp(pixels[..., 1], axis=1).max() / size[1]
            assert 0.4 < height <= 0.701


def _surfaces(body: Body, q: np.ndarray) -> np.ndarray:
    """Surface points (T, N, 3) of every configuration, in the world."""
    surface = surface_of(body, nodes=500)
    return np.array([points_in_world(body.at(pose), surface.joint, surface.local) for pose in q])


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: SceneSettings(background="sea"), "one of room, textured, pillar, black, moving"),
        (lambda: SceneSettings(shutter=1.5), "shutter: is 1.5"),
        (lambda: SceneSettings(noise=float("nan")), "noise"),
        (lambda: SceneSettings(hidden=[(2.0, 1.0)]), "hidden: is 2.0:1.0"),
        (lambda: ViewSettings(count=0), "cameras"),
        (lambda: ViewSettings(image_size=(641, 480)), "even"),
        (lambda: DetectorSettings(missing_fraction=2.0), "missing_fraction"),
    ],
)
def test_settings_out_of_range_are_named(make, match: str) -> None:
    with pytest.raises(InputError, match=match):
        make()


def test_keypoints_have_the_requested_scatter(body: Body, q: np.ndarray) -> None:
    cameras = scene_cameras()
    order = [body.landmark_names.index(name) for name in COCO17]
    exact = np.array([cameras[1].project(body.landmarks(body.at(pose)))[order] for pose in q])
    clean = keypoints(body, q, cameras, np.random.default_rng(0), DetectorSettings(0.0, 0.0, 0.0))
    np.testing.assert_allclose(clean[1].pixels, exact)
    assert clean[1].confidence.min() > 0.0
    noisy = keypoints(body, q, cameras, np.random.default_rng(0), DetectorSettings(2.5, 0.05, 0.1))
    assert noisy[1].names == COCO17
    error = noisy[1].pixels - exact
    missing = np.isnan(error).any(axis=2)
    np.testing.assert_array_equal(missing, noisy[1].confidence == 0.0)
    assert missing.mean() == pytest.approx(0.1, abs=0.025)
    wrong = np.linalg.norm(error, axis=2)[~missing] > 18.0
    assert wrong.mean() == pytest.approx(0.05, abs=0.02)
    assert np.median(np.abs(error[~missing])) / 0.6745 == pytest.approx(2.5, rel=0.15)


def test_lasting_errors_have_the_requested_duration_and_size(body: Body, q: np.ndarray) -> None:
    """Correlations in time and between points are e^(-t / correlation) and e^(-distance / reach)."""
    camera, still = scene_cameras()[0], np.tile(q[:1], (4000, 1))
    errors = DetectorSettings(2.0, 0.0, 0.0, correlation=0.1, reach=0.3)
    (track,) = keypoints(body, still, [camera], np.random.default_rng(0), errors, fps=50.0)
    points = body.landmarks(body.at(q[0]))[[body.landmark_names.index(name) for name in COCO17]]
    noise = (track.pixels - camera.project(points)) / landmark_spread(COCO17)[:, None]
    noise /= noise.std()
    for lag in (1, 5, 10):
        assert np.mean(noise[lag:] * noise[:-lag]) == pytest.approx(np.exp(-lag / 5.0), abs=0.03)
    alike = np.einsum("tix,tjx->ij", noise, noise) / (2.0 * len(noise))
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    np.testing.assert_allclose(alike, np.exp(-apart / 0.3), atol=0.15)
    assert np.mean(np.abs(alike - np.exp(-apart / 0.3))) < 0.05


def test_a_bias_stays_in_its_link_and_is_one_for_all_cameras(body: Body, q: np.ndarray) -> None:
    """Rays of two cameras through a noise-free detector's keypoints meet at one place in the landmark's link."""
    points = np.array([body.landmarks(body.at(pose)) for pose in q])
    cameras = [replace(camera, distortion=np.zeros(5)) for camera in framing_cameras(points, ViewSettings(count=2))]
    errors = DetectorSettings(0.0, 0.0, 0.0, bias=0.02)
    tracks = keypoints(body, q, cameras, np.random.default_rng(3), errors)
    pixels = np.stack([track.pixels for track in tracks])
    projections = np.stack([c.K @ np.c_[c.R_camera_world, c.t_camera_world] for c in cameras])
    offsets = []
    for t in (0, len(q) - 1):
        posed = body.at(q[t])
        for k, name in enumerate(COCO17):
            joint = body.landmark_joint[body.landmark_names.index(name)]
            rows = [
                p[2] * x - p[i] for p, uv in zip(projections, pixels[:, t, k], strict=True) for i, x in enumerate(uv)
            ]
            place = np.linalg.svd(np.array(rows))[2][-1]
            gap = place[:3] / place[3] - points[t, body.landmark_names.index(name)]
            offsets.append(posed.rotations[joint].T @ gap)
    first, last = np.split(np.array(offsets), 2)
    np.testing.assert_allclose(last, first, atol=1e-8)
    relative = first / landmark_spread(COCO17)[:, None] * landmark_spread(COCO17).mean()
    assert relative.std() == pytest.approx(0.02, rel=0.2)


def test_the_first_frame_is_exact_and_alone(body: Body, q: np.ndarray) -> None:
    camera = scene_cameras()[0]
    (track,) = first_frame(body, q[:4], [camera])
    np.testing.assert_array_equal(track.pixels[0], camera.project(body.landmarks(body.at(q[0]))))
    assert np.isnan(track.pixels[1:]).all()
    np.testing.assert_array_equal(track.confidence.any(axis=1), [True, False, False, False])


def test_truth_is_a_reference(body: Body, q: np.ndarray, tmp_path: Path) -> None:
    write_truth(tmp_path / "truth.npz", body, q[:5], TIMES[:5])
    reference = Reference.load(tmp_path / "truth.npz")
    assert reference.names == body.landmark_names
    np.testing.assert_allclose(reference.time, TIMES[:5])
    np.testing.assert_array_equal(reference.points[3], body.landmarks(body.at(q[3])))
