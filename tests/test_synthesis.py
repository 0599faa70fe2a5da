"""The built-in clip: its motion is possible, its pictures and keypoints agree with its truth."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.evaluation import Reference, largest_penetration, limit_violations
from estimator.synthesis import (
    MOTION_SECONDS,
    Renderer,
    authored_motion,
    keypoints,
    scene_cameras,
    write_truth,
    write_video,
)
from estimator.synthesis.raster import paint
from humanoid.body import Body
from humanoid.errors import InputError
from humanoid.flesh import flesh_meshes
from humanoid.landmarks import COCO17
from humanoid.subject import load_subject

TIMES = np.arange(round(30 * MOTION_SECONDS)) / 30.0


@pytest.fixture(scope="module")
def body() -> Body:
    return Body(load_subject("human34").scaled({"left_knee_flexion": 1.07, "left_elbow_flexion": 1.05}))


@pytest.fixture(scope="module")
def q(body: Body) -> np.ndarray:
    return authored_motion(body, TIMES)


def test_motion_is_possible(body: Body, q: np.ndarray) -> None:
    assert limit_violations(body, q) == 0
    assert largest_penetration(body, q) == 0.0
    np.testing.assert_allclose(np.linalg.norm(q[:, 3:7], axis=1), 1.0)
    soles = [i for i, n in enumerate(body.landmark_names) if n.endswith(("heel", "toe"))]
    lowest = np.array([body.landmarks(body.at(one))[soles, 2].min() for one in q])
    assert np.abs(lowest).max() < 0.02
    # nothing jumps: no degree of freedom changes its speed faster than a person can
    speed = np.array([body.difference(a, b) for a, b in pairwise(q)]) * 30.0
    assert np.abs(np.diff(speed, axis=0)).max() * 30.0 < 60.0
    assert np.abs(speed).max() < 8.0


def test_motion_does_not_depend_on_the_times_asked_for(body: Body, q: np.ndarray) -> None:
    np.testing.assert_array_equal(authored_motion(body, TIMES[7:9]), q[7:9])


def test_motion_of_another_body_is_refused() -> None:
    with pytest.raises(InputError, match="lumbar_flexion"):
        authored_motion(Body(load_subject("arm8")), TIMES)


def test_solids_are_closed_and_have_their_volume(body: Body) -> None:
    for mesh, flesh in zip(flesh_meshes(body, 64, 48), body.subject.flesh, strict=True):
        p = mesh.vertices[mesh.faces]
        volume = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6.0
        r, length, _ = flesh.size
        exact = np.pi * r**2 * (length + 4 / 3 * r) if flesh.shape == "capsule" else 4 / 3 * np.pi * np.prod(flesh.size)
        assert volume == pytest.approx(exact, rel=0.01)
        edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
        assert {tuple(e) for e in edges.tolist()} == {(b, a) for a, b in edges.tolist()}


def test_the_nearer_triangle_hides_the_farther() -> None:
    image, nearness = np.zeros((20, 20, 3), dtype=np.float32), np.zeros((20, 20))
    corners = np.array([[2.0, 2.0], [16.0, 2.0], [2.0, 16.0]])
    pixels, depth = np.concatenate([corners, corners]), np.repeat([1.0, 2.0], 3)
    colour = np.repeat([[10.0, 20.0, 30.0], [200.0, 200.0, 200.0]], 3, axis=0)
    paint(image, nearness, pixels, depth, colour, np.array([[0, 1, 2], [3, 4, 5]]))
    np.testing.assert_allclose(image[4, 4], [10.0, 20.0, 30.0])
    assert np.count_nonzero(nearness) == 15 * 16 // 2
    assert image[17, 17].max() == 0.0


def test_pictures_show_the_body_where_it_is(body: Body, q: np.ndarray, tmp_path: Path) -> None:
    cameras = scene_cameras()
    renderer = Renderer(body, cameras, np.random.default_rng(0))
    frames = [renderer.frame(body.at(one), 0, np.random.default_rng(5)) for one in (q[0], q[60])]
    changed = np.abs(frames[0].astype(int) - frames[1]).max(axis=2) > 25
    away = cameras[0].project(_boxes(body, q[[0, 60]]))
    low, high = away.min(axis=0) - 3, away.max(axis=0) + 3
    y, x = np.nonzero(changed[: int(high[1]) - 90])  # above the shadow on the floor
    assert len(x) > 3000
    assert ((x >= low[0]) & (x <= high[0]) & (y >= low[1])).mean() > 0.999
    again = Renderer(body, cameras, np.random.default_rng(0)).frame(body.at(q[0]), 0, np.random.default_rng(5))
    np.testing.assert_array_equal(again, frames[0])
    write_video(tmp_path / "a.mp4", frames, 30.0)
    capture = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == 2
    capture.release()
    with pytest.raises(InputError, match="no frame"):
        write_video(tmp_path / "b.mp4", [], 30.0)


def _boxes(body: Body, q: np.ndarray) -> np.ndarray:
    """Every vertex of the body's solids at every configuration, in the world."""
    meshes = flesh_meshes(body)
    posed = [body.at(one) for one in q]
    return np.concatenate(
        [m.vertices @ p.rotations[m.joint].T + p.translations[m.joint] for p in posed for m in meshes]
    )


def test_keypoints_scatter_as_asked(body: Body, q: np.ndarray) -> None:
    cameras = scene_cameras()
    order = [body.landmark_names.index(name) for name in COCO17]
    exact = np.array([cameras[1].project(body.landmarks(body.at(one)))[order] for one in q])
    clean = keypoints(body, q, cameras, np.random.default_rng(0), noise_px=0.0, outlier_fraction=0, missing_fraction=0)
    np.testing.assert_allclose(clean[1].pixels, exact)
    assert clean[1].confidence.min() > 0.0
    noisy = keypoints(body, q, cameras, np.random.default_rng(0), outlier_fraction=0.05, missing_fraction=0.1)
    assert noisy[1].names == COCO17
    error = noisy[1].pixels - exact
    missing = np.isnan(error).any(axis=2)
    np.testing.assert_array_equal(missing, noisy[1].confidence == 0.0)
    assert missing.mean() == pytest.approx(0.1, abs=0.025)
    wrong = np.linalg.norm(error, axis=2)[~missing] > 18.0
    assert wrong.mean() == pytest.approx(0.05, abs=0.02)
    assert np.median(np.abs(error[~missing])) / 0.6745 == pytest.approx(2.5, rel=0.15)


def test_truth_is_a_reference(body: Body, q: np.ndarray, tmp_path: Path) -> None:
    write_truth(tmp_path / "truth.npz", body, q[:5], TIMES[:5])
    reference = Reference.load(tmp_path / "truth.npz")
    assert reference.names == body.landmark_names
    np.testing.assert_allclose(reference.time, TIMES[:5])
    np.testing.assert_array_equal(reference.points[3], body.landmarks(body.at(q[3])))
