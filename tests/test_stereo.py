"""Depth from two cameras, against scenes of known depth."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.data.cameras.camera import Camera
from estimator.vision.stereo import StereoPair
from humanoid.support.errors import InputError

SIZE = (640, 480)
K = np.array([[600.0, 0.0, 317.0], [0.0, 605.0, 241.0], [0.0, 0.0, 1.0]])
STRAIGHT = np.zeros(5)
BENT = np.array([-0.12, 0.05, 0.001, -0.002, 0.0])
BASELINE = 0.12


def camera(name: str, x: float, turn: float = 0.0, distortion: np.ndarray = STRAIGHT, y: float = 0.0) -> Camera:
    """A camera at (x, y, 0), facing along z, turned about y [degrees]."""
    R = Rotation.from_euler("y", turn, degrees=True).as_matrix()
    return Camera(name, SIZE, K, distortion, R, -R @ np.array([x, y, 0.0]))


def wall(seen_by: Camera, normal: np.ndarray, offset: float) -> tuple[np.ndarray, np.ndarray]:
    """Picture (H, W, 3) of a wall with a random pattern, normal . x = offset, and points of its pixels (H, W, 3)."""
    pattern = np.random.default_rng(0).integers(0, 256, (2000, 2000), np.uint8)
    pattern = cv2.GaussianBlur(pattern, (0, 0), 1.0)
    pattern = cv2.normalize(pattern, None, 0, 255, cv2.NORM_MINMAX)
    pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).astype(float)
    ray = seen_by.directions(pixels) @ seen_by.R_camera_world
    centre = seen_by.centre_world
    points = centre + ray * ((offset - normal @ centre) / (ray @ normal))[..., None]
    at = (1000.0 + 200.0 * points[..., :2]).astype(np.float32)  # 5 mm a pixel of the pattern
    grey = cv2.remap(pattern, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), points


NORMAL = np.array([0.2, 0.1, 1.0]) / np.linalg.norm([0.2, 0.1, 1.0])


RATIONAL = np.array([0.3, -0.1, 0.001, -0.002, 0.04, 0.45, -0.1, 0.02])
TILTED = np.array([*BENT, 0.0, 0.0, 0.0, 0.004, -0.002, 0.003, 0.001, 0.02, -0.03])
FISHEYE = np.array([0.05, -0.02, 0.008, -0.002])


@pytest.mark.parametrize(
    ("turn", "distortion"), [(0.0, STRAIGHT), (4.0, BENT), (4.0, RATIONAL), (4.0, TILTED), (4.0, FISHEYE)]
)
def test_a_slanting_wall_is_where_it_is(turn: float, distortion: np.ndarray) -> None:
    left, right = (
        replace(camera(name, x, angle, distortion), fisheye=distortion is FISHEYE)
        for name, x, angle in (("left", 0.0, 0.5 * turn), ("right", BASELINE, -turn))
    )
    pair = StereoPair(left, right)
    assert pair.baseline == pytest.approx(BASELINE)
    depth = pair.depth(wall(left, NORMAL, 2.5)[0], wall(right, NORMAL, 2.5)[0])
    inner = np.s_[40:-40, 60:-40]  # seen by both: all but 30 px at the left
    assert np.isfinite(depth[inner]).mean() > 0.9
    assert np.isfinite(depth[40:-40, 60:140]).mean() > 0.9  # the left columns have depth too
    pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).astype(float)
    in_camera = pair.camera.directions(pixels) * depth[..., None]
    world = (in_camera - pair.camera.t_camera_world) @ pair.camera.R_camera_world
    off = (world @ NORMAL - 2.5)[inner]
    off = off[np.isfinite(off)]
    assert abs(np.median(off)) < 0.01
    stated = float(np.median(pair.std(depth[inner][np.isfinite(depth[inner])])))
    assert 0.3 < np.sqrt(np.mean(np.square(off))) / stated < 1.5


def test_the_rectified_camera_projects_to_the_rectified_picture() -> None:
    left, right = camera("left", 0.0, 2.0, BENT), camera("right", BASELINE, -2.0, BENT)
    pair = StereoPair(left, right)
    picture, _ = wall(left, NORMAL, 2.5)
    turned, _ = pair.rectified(picture, picture)
    drawn, _ = wall(pair.camera, NORMAL, 2.5)
    inner = np.s_[40:-40, 40:-40]
    assert np.corrcoef(turned[inner].ravel(), drawn[inner].ravel())[0, 1] > 0.95


def test_what_only_one_camera_sees_has_no_depth() -> None:
    """A board before the wall: the strip of wall left of it is hidden from the right camera."""
    left, right = camera("left", 0.0), camera("right", BASELINE)
    facing, near, far = np.array([0.0, 0.0, 1.0]), 1.5, 3.0
    pictures = []
    for seen_by in (left, right):
        front, points = wall(seen_by, facing, near)
        on_board = (np.abs(points[..., 0] - 0.05) < 0.25) & (np.abs(points[..., 1]) < 0.4)
        pictures.append(np.where(on_board[..., None], front, wall(seen_by, facing, far)[0]))
    depth = StereoPair(left, right).depth(*pictures)
    edge = int(left.project(np.array([-0.2, 0.0, near]))[0])
    hidden = int(K[0, 0] * BASELINE * (1.0 / near - 1.0 / far))  # px of wall beside the board's left edge
    assert hidden == 24
    assert np.nanmedian(depth[200:280, edge + 20 : edge + 120]) == pytest.approx(near, abs=0.03)
    assert np.nanmedian(depth[200:280, edge - 80 : edge - hidden - 10]) == pytest.approx(far, abs=0.1)
    strip = depth[200:280, edge - hidden + 5 : edge - 5]
    assert np.isfinite(strip).mean() < 0.3


@pytest.mark.parametrize(
    ("right", "message"),
    [
        (replace(camera("right", BASELINE), image_size=(320, 240)), "640 x 480 and 320 x 240"),
        (camera("right", 0.0), "0.0 mm apart"),
        (camera("right", -BASELINE), "right stands to the left"),
        (camera("right", BASELINE, 60.0), "60 degrees apart"),
        (camera("right", 0.0, y=0.3), "one above the other"),
        (replace(camera("right", 0.0), t_camera_world=np.array([0.0, 0.0, 0.5])), "behind the other"),
    ],
)
def test_cameras_that_see_no_depth_together_are_refused(right: Camera, message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        StereoPair(camera("left", 0.0), right)
    assert "left=right" in str(refused.value)
