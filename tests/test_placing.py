"""A subject fixed in the world, filmed by a camera without a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.data.cameras.camera import Camera, camera_before, guessed_camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from kinemode.inputs.lens import PHONES
from kinemode.inputs.load import Inputs, load_inputs
from kinemode.request import FileOptions
from tests.builders import body_of

SIZE = 640, 480
GUESSED = guessed_camera("cam01", SIZE)


def standing(depth: float, aside: float, up: float) -> Camera:
    """The guessed camera, given its distance from the origin, which is so far right of and below its axis [m]."""
    towards = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    return replace(GUESSED, R_camera_world=towards, t_camera_world=np.array([aside, up, depth]))


def test_a_camera_before_flat_points_is_found_exactly() -> None:
    true = standing(3.7, 0.4, -0.2)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (6, 3)) * [0.0, 1.0, 1.0] + [0.1, 0.0, 0.3]
    placed = camera_before(GUESSED, points, true.project(points))
    np.testing.assert_allclose(placed.t_camera_world, true.t_camera_world, atol=1e-9)
    np.testing.assert_allclose(placed.R_camera_world, true.R_camera_world)
    np.testing.assert_allclose(placed.K, GUESSED.K)


def inputs(folder: Path, subject: str, count: int, camera: Camera | None = None) -> Inputs:
    """Keypoints alone: none in the first frame, `count` landmarks at rest in the next, as a camera 2.5 m away sees
    them; with a camera file if there is a camera."""
    body = body_of(subject)
    pixels = standing(2.5, 0.1, 0.3).project(body.landmarks(body.at(body.neutral)))
    confidence = np.zeros((2, len(pixels)))
    confidence[1, :count] = 1.0
    track = KeypointTrack(
        "landmarks", body.landmark_names, np.where(confidence[..., None] > 0.0, pixels, np.nan), confidence, SIZE, 25.0
    )
    path = folder / "cam01.json"
    write_keypoints(path, track)
    cameras = None
    if camera is not None:
        cameras = folder / "cameras.json"
        write_cameras(cameras, [camera])
    return load_inputs(body, FileOptions(keypoints=path, cameras=cameras))


def test_a_guessed_camera_is_placed_before_a_fixed_subject(tmp_path: Path) -> None:
    """All keypoints are then in front of it at about the right size, and a note gives its position."""
    made = inputs(tmp_path, "upper13", len(body_of("upper13").landmark_names))
    (camera,) = made.observations[0].cameras
    body = body_of("upper13")
    assert camera.depths(body.landmarks(body.at(body.neutral))).mean() == pytest.approx(2.5 * PHONES / 1.2, rel=0.05)
    assert any("cam01 is assumed to stand level before upper13" in note for note in made.notes)


@pytest.mark.parametrize(
    ("subject", "count", "given"), [("upper13", 2, False), ("upper13", 9, True), ("human34", 9, False)]
)
def test_other_cameras_stay_where_they_are(subject: str, count: int, given: bool, tmp_path: Path) -> None:
    """Too few keypoints to decide; a camera file; a subject that is moved before the camera instead."""
    made = inputs(tmp_path, subject, count, standing(4.0, 0.0, 0.0) if given else None)
    (camera,) = made.observations[0].cameras
    assert camera.t_camera_world == pytest.approx([0.0, 0.0, 4.0] if given else [0.0, 0.0, 0.0])
    assert not any("assumed to stand" in note for note in made.notes)
