"""Lenses of every model: OpenCV's pixels, derivatives by central differences, and the inverse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from estimator.data.cameras.camera import Camera
from estimator.data.cameras.projection import (
    add_projection_curvature,
    pack_cameras,
    project_point,
    project_with_jacobian,
)
from estimator.energy.reprojection import Reprojection
from humanoid.support.errors import InputError
from kinemode.testing import check_term
from tests.builders import BROWN, body_of, camera_at, observe, random_pose

LENSES = {
    "brown4": (-0.11, 0.05, 0.002, -0.003),
    "brown5": BROWN,
    "rational8": (0.31, -0.12, 0.002, -0.003, 0.04, 0.42, -0.1, 0.02),
    "prism12": (0.31, -0.12, 0.002, -0.003, 0.04, 0.42, -0.1, 0.02, 0.004, -0.002, 0.003, 0.001),
    "tilted14": (-0.2, 0.06, 0.002, -0.003, 0.01, 0.05, -0.02, 0.01, 0.004, -0.002, 0.003, 0.001, 0.05, -0.08),
    "fisheye": (0.06, -0.02, 0.008, -0.002),
}


def lens_camera(model: str, azimuth: float = 20.0) -> Camera:
    camera = camera_at(azimuth, distance=2.0, focal=420.0)
    return replace(camera, distortion=np.array(LENSES[model]), fisheye=model == "fisheye")


def points_before(camera: Camera, model: str) -> np.ndarray:
    """Points in the world (60, 3) [m] in view of a camera, up to 80 degrees off axis for a fisheye, one on the axis."""
    rng = np.random.default_rng(3)
    r = np.tan(np.radians(rng.uniform(0.0, 80.0 if model == "fisheye" else 32.0, 60)))
    r[:3] = 0.0, 1e-9, 1e-3
    turn = rng.uniform(0.0, 2.0 * np.pi, 60)
    rays = np.stack([r * np.cos(turn), r * np.sin(turn), np.ones(60)], axis=1)
    x = rays * rng.uniform(0.8, 4.0, (60, 1))
    return (x - camera.t_camera_world) @ camera.R_camera_world


def slopes(function: Callable[[np.ndarray], np.ndarray], p: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Central differences of a function by a point (3,), a column each."""
    return np.stack([(function(p + e) - function(p - e)) / (2.0 * step) for e in step * np.eye(3)], axis=-1)


@pytest.mark.parametrize("model", LENSES)
def test_pixels_are_those_of_opencv(model: str) -> None:
    camera = lens_camera(model)
    points = points_before(camera, model)
    turn, t = cv2.Rodrigues(camera.R_camera_world)[0], camera.t_camera_world
    lens = np.array(LENSES[model])
    if model == "fisheye":
        skew = camera.K[0, 1] / camera.K[0, 0]
        pixels, _ = cv2.fisheye.projectPoints(points[:, None], turn, t, camera.K, lens, alpha=skew)
    else:
        K = camera.K * [[1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]  # OpenCV's pinhole has no skew
        camera = replace(camera, K=K)
        pixels, _ = cv2.projectPoints(points[:, None], turn, t, K, lens)
    np.testing.assert_allclose(camera.project(points), pixels[:, 0], rtol=0.0, atol=1e-9)
    compiled = [project_point(p, *camera.arrays)[:2] for p in points]
    np.testing.assert_allclose(compiled, pixels[:, 0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("model", LENSES)
def test_derivatives_are_central_differences(model: str) -> None:
    camera = lens_camera(model)
    for p in points_before(camera, model)[:30]:
        J, aside = np.zeros((2, 3)), np.zeros((2, 3))
        u, v, _ = project_with_jacobian(p, *camera.arrays, J)
        np.testing.assert_array_equal((u, v), project_point(p, *camera.arrays)[:2])
        numeric = slopes(lambda x: np.array(project_point(x, *camera.arrays)[:2]), p)
        np.testing.assert_allclose(J, numeric, rtol=1e-6, atol=1e-5 * np.abs(J).max())

        def pulled(x: np.ndarray, aside: np.ndarray = aside) -> np.ndarray:
            project_with_jacobian(x, *camera.arrays, aside)
            return np.array([0.7, -1.3]) @ aside

        H = np.zeros((3, 3))
        add_projection_curvature(p, *camera.arrays, 0.7, -1.3, H)
        np.testing.assert_allclose(H, slopes(pulled, p), rtol=1e-5, atol=1e-5 * np.abs(H).max())


@pytest.mark.parametrize("model", LENSES)
def test_directions_lead_back(model: str) -> None:
    """For Brown's model within the accuracy of OpenCV's five iterations."""
    camera = lens_camera(model)
    points = points_before(camera, model)
    x = points @ camera.R_camera_world.T + camera.t_camera_world
    rays = x[:, :2] / x[:, 2:]
    back = camera.directions(camera.project(points))[:, :2]
    if model.startswith("brown"):
        near = np.linalg.norm(rays, axis=1) < 0.35
        np.testing.assert_allclose(back[near], rays[near], atol=1e-5)
    else:
        np.testing.assert_allclose(back, rays, rtol=1e-8, atol=1e-10)


def test_beyond_a_fisheyes_circle_there_is_no_direction() -> None:
    camera = replace(lens_camera("fisheye"), distortion=np.zeros(4))
    outside = camera.K[:2, 2] + [0.52 * np.pi * camera.K[0, 0], 0.0]
    rays = camera.directions(np.stack([outside, camera.K[:2, 2]]))
    assert np.isnan(rays[0]).all()
    np.testing.assert_allclose(rays[1], [0.0, 0.0, 1.0], atol=1e-12)


def test_cameras_of_several_models_go_together() -> None:
    """A camera with Brown's model then has exactly the pixels it has alone."""
    cameras = [lens_camera(model, 20.0 * i) for i, model in enumerate(LENSES)]
    packed = pack_cameras(cameras)
    assert pack_cameras(cameras[:2])[1].shape == (2, 5)
    p = np.array([0.1, -0.2, 0.3])
    for i, camera in enumerate(cameras):
        assert project_point(p, *(a[i] for a in packed)) == project_point(p, *camera.arrays)
    longer = replace(cameras[1], distortion=np.concatenate([BROWN, np.zeros(9)]))
    np.testing.assert_allclose(longer.project(p), cameras[1].project(p), rtol=1e-14)


def test_the_energy_takes_all_of_them() -> None:
    """Keypoints of cameras of every model: a perfect pose has no energy, and the term keeps its contract."""
    body = body_of("arm8")
    rng = np.random.default_rng(4)
    cameras = [lens_camera(model, 60.0 * i) for i, model in enumerate(LENSES)]
    q = random_pose(body, rng, share=0.5)
    seen = observe(body, q, cameras)
    sigma = np.full(seen.confidence.shape, 6.0)
    assert Reprojection(body, seen, sigma, "lorentzian", 6.0).value(body.at(q)) < 1e-12
    noisy = observe(body, q, cameras, noise=6.0, rng=rng)
    check_term(Reprojection(body, noisy, sigma, "lorentzian", 6.0), body, random_pose(body, rng, share=0.5))


@pytest.mark.parametrize(("count", "fisheye"), [(3, False), (6, False), (15, False), (5, True)])
def test_other_numbers_of_coefficients_are_refused(count: int, fisheye: bool) -> None:
    camera = replace(camera_at(0.0), distortion=np.zeros(count), fisheye=fisheye)
    with pytest.raises(InputError, match=f"distortion: has {count} coefficients"):
        camera.project(np.zeros(3))
