"""`calibrate` on pictures of boards from known cameras: lenses, placements, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import pytest

import kinemode as km
from estimator.data.boards.board import Board
from estimator.data.boards.placement import R_WORLD_BOARD
from estimator.data.cameras.camera import Camera
from kinemode import __main__ as front
from tests.boards import held_before, rays_of, seen_by
from tests.builders import BROWN, camera_at
from tests.test_lens import lens_camera

CHESS, CHARUCO = Board("chessboard", (9, 6), 0.03), Board("charuco", (8, 6), 0.03)
VIEWS = 7
Pose: TypeAlias = tuple[np.ndarray, np.ndarray]  # of a board in the world


def without_skew(camera: Camera) -> Camera:
    return replace(camera, K=camera.K * np.array([[1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]))


def half_size(camera: Camera) -> Camera:
    """The camera with half as many pixels each way, for what needs no accuracy."""
    return replace(camera, K=camera.K * np.array([[0.5], [0.5], [1.0]]), image_size=(320, 240))


def write_views(folder: Path, camera: Camera, board: Board, poses: Sequence[Pose | None]) -> Path:
    """Pictures of the board in these poses, None where it is not visible."""
    folder.mkdir()
    rays = rays_of(camera)
    nothing = np.full((*camera.image_size[::-1], 3), 128, np.uint8)
    for i, pose in enumerate(poses):
        picture = nothing if pose is None else seen_by(camera, rays, board, *pose)
        cv2.imwrite(str(folder / f"{i}.png"), picture)
    return folder


def tilted(camera: Camera, board: Board, count: int = VIEWS) -> list[Pose]:
    rng = np.random.default_rng(1)
    return [held_before(camera, rng, board, 0.42) for _ in range(count)]


@pytest.fixture(scope="module")
def chess(tmp_path_factory: pytest.TempPathFactory) -> tuple[Camera, Path]:
    """A camera with Brown's distortion, and a folder of its pictures of a chessboard."""
    camera = without_skew(lens_camera("brown5"))
    return camera, write_views(tmp_path_factory.mktemp("chess") / "one", camera, CHESS, tilted(camera, CHESS))


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Camera, Path]:
    """The same of a camera with small pictures."""
    camera = half_size(without_skew(lens_camera("brown5")))
    return camera, write_views(tmp_path_factory.mktemp("small") / "one", camera, CHESS, tilted(camera, CHESS))


def check_lens(calibrated: Camera, camera: Camera, *, within: float = 0.005) -> None:
    """Focal lengths, the principal point, and where the lens puts rays in the middle half of the picture."""
    np.testing.assert_allclose(np.diag(calibrated.K)[:2], np.diag(camera.K)[:2], rtol=within)
    np.testing.assert_allclose(calibrated.K[:2, 2], camera.K[:2, 2], atol=3.0)
    x, y = np.meshgrid(np.linspace(160, 480, 9), np.linspace(120, 360, 7))
    rays = [c.directions(np.stack([x, y], axis=-1)) for c in (calibrated, camera)]
    away = np.abs(rays[0] - rays[1])
    away -= np.median(rays[0] - rays[1], axis=(0, 1))  # a shifted principal point is a turned camera
    assert away.max() * camera.K[0, 0] < 4.0


def test_a_chessboard_shows_the_lens(chess: tuple[Camera, Path], tmp_path: Path) -> None:
    camera, folder = chess
    out = tmp_path / "cameras.json"
    calibration = km.calibrate(folder, size="9x6", square=0.03, out=out, picture=tmp_path / "board.png")
    assert calibration.lens_errors["one"] < 0.2
    assert len(calibration.views) == VIEWS
    assert not calibration.notes
    check_lens(calibration.cameras["one"], camera)
    again = km.load_cameras(out)["one"]
    np.testing.assert_array_equal(again.K, calibration.cameras["one"].K)
    drawn = cv2.imread(str(tmp_path / "board.png"))
    assert drawn is not None
    assert drawn.std() > 20.0
    assert calibration.of("one")[0].error == max(v.error for v in calibration.views)


@pytest.mark.parametrize(("board", "blurred"), [(CHESS, False), (CHESS, True), (CHARUCO, False)])
def test_corners_have_their_order_however_the_board_is_held(
    board: Board, blurred: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Upside down and on its side too, to a quarter of a pixel: several cameras name the same corner. Blurred: the
    first of OpenCV's detectors fails."""
    if blurred:
        monkeypatch.setattr(cv2, "findChessboardCorners", lambda *_, **__: (False, None))
    camera = without_skew(camera_at(20.0, distance=2.0, focal=500.0))
    rays, rng = rays_of(camera), np.random.default_rng(2)
    for spin in (0.0, 90.0, 180.0, 270.0):
        R, t = held_before(camera, rng, board, 0.6)
        middle = R @ board.points.mean(axis=0) + t
        R = R @ cv2.Rodrigues(np.radians([0.0, 0.0, spin]))[0]
        t = middle - R @ board.points.mean(axis=0)
        pixels = board.corners(seen_by(camera, rays, board, R, t))
        assert pixels is not None
        np.testing.assert_allclose(pixels, camera.project(board.points @ R.T + t), atol=0.25)


@pytest.mark.parametrize(("model", "lens"), [("fisheye", "fisheye"), ("brown5", "brown")])
def test_a_charuco_board_shows_the_lens(model: str, lens: str, tmp_path: Path) -> None:
    """Picture files of one camera, some with a part of the board."""
    camera = without_skew(lens_camera(model))
    folder = write_views(tmp_path / "cam", camera, CHARUCO, tilted(camera, CHARUCO))
    for i in (0, 1):
        picture = cv2.imread(str(folder / f"{i}.png"))
        picture[:, :300] = 128
        cv2.imwrite(str(folder / f"{i}.png"), picture)
    files = sorted(folder.iterdir())
    calibration = km.calibrate(files, board="charuco", size=(8, 6), square=0.03, lens=lens)
    assert calibration.lens_errors["cam"] < 0.2
    assert any(v.view.seen.sum() < len(CHARUCO.points) for v in calibration.views)
    calibrated = calibration.cameras["cam"]
    assert calibrated.fisheye == (model == "fisheye")
    check_lens(calibrated, camera)


def test_several_cameras_stand_in_the_boards_world(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Three in a chain: a and c never see the board at the same time, but both see it with b. In picture 2 it lies on
    the floor before a and b, and defines the world. Their clips go through the command."""
    aim = (0.13, -0.08, 0.0)
    cameras = {
        "a": camera_at(0.0, distance=0.6, focal=600.0, height=0.5, aim=aim, distortion=BROWN),
        "b": camera_at(55.0, distance=0.6, focal=640.0, height=0.45, aim=aim),
        "c": camera_at(110.0, distance=0.6, focal=600.0, height=0.5, aim=aim, distortion=BROWN),
    }
    cameras = {name: without_skew(replace(camera, name=name)) for name, camera in cameras.items()}
    rng = np.random.default_rng(5)
    floor = R_WORLD_BOARD, np.zeros(3)
    poses = [floor]
    while len(poses) < 15:
        R = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0] @ R_WORLD_BOARD
        middle = np.array([*(aim[:2] + rng.uniform(-0.05, 0.05, 2)), rng.uniform(0.0, 0.15)])
        poses.append((R, middle - R @ CHESS.points.mean(axis=0)))
    poses[0], poses[2] = poses[2], poses[0]
    for name, camera in cameras.items():
        hidden = {"a": range(5, 15), "b": (), "c": range(5)}[name]
        write_views(tmp_path / name, camera, CHESS, [None if i in hidden else pose for i, pose in enumerate(poses)])
    line = ["calibrate", *(f"{name}={tmp_path / name}" for name in cameras), "--square", "0.03", "--origin", "2"]
    assert front.main([*line, "--out", str(tmp_path / "cameras.json"), "--picture", str(tmp_path / "all.png")]) == 0
    printed = capsys.readouterr().out
    assert "error across cameras" in printed
    assert "the board in picture 2" in printed
    placed = km.load_cameras(tmp_path / "cameras.json")
    for name, camera in cameras.items():
        np.testing.assert_allclose(placed[name].centre_world, camera.centre_world, atol=0.006)
        angle = np.linalg.norm(cv2.Rodrigues(placed[name].R_camera_world @ camera.R_camera_world.T)[0])
        assert np.degrees(angle) < 0.6
        floor_points = R_WORLD_BOARD @ CHESS.points.T
        assert np.abs(placed[name].project(floor_points.T) - camera.project(floor_points.T)).max() < 0.6


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"size": "8x6"},
            r"8 x 6 inner corners is in none of 2 pictures .*\.png shows.*9 x 6 inner corners: --size 9x6",
        ),
        ({"size": "10x7"}, r"--size 9x6"),
        ({"board": "charuco", "size": "8x6"}, "ChArUco board of 8 x 6 squares.* is in none of 2 pictures"),
        ({"size": "nine"}, "size: 'nine' cannot be used"),
        ({"size": "1x6"}, "inner corners a side, got 1x6"),
        ({"square": 0.0}, "square: must be above 0 and below 10 m, got 0"),
        ({"board": "charuco", "marker": 0.04}, "marker: 0.04 m does not fit as a marker in a square of 0.03 m"),
        ({"board": "charuco", "dictionary": "9X9"}, "dictionary: '9X9' is unknown"),
        ({"lens": "wide"}, "lens: 'wide' is unknown"),
        ({"board": "dots"}, "board: 'dots' is unknown"),
        ({"origin": 90}, "origin: there is no picture 90 .*0 to 6"),
        ({"picture": "a.txt"}, "not a .png file"),
    ],
)
def test_invalid_input_is_refused(changed: dict[str, object], message: str, small: tuple[Camera, Path]) -> None:
    pictures = sorted(small[1].iterdir())  # no board is found in these few, as in all of them
    given = pictures[:2] if "8x6" in changed.values() or "10x7" in changed.values() else pictures
    with pytest.raises(km.InputError, match=message):
        km.calibrate(given, **({"size": "9x6", "square": 0.03} | changed))  # type: ignore[arg-type]


def test_markers_of_another_dictionary_are_reported(small: tuple[Camera, Path], tmp_path: Path) -> None:
    camera = small[0]
    folder = write_views(tmp_path / "cam", camera, CHARUCO, tilted(camera, CHARUCO, 2))
    with pytest.raises(km.InputError, match="markers of 4X4_1000: --dictionary 4X4_1000"):
        km.calibrate(folder, board="charuco", dictionary="6X6_250", size="8x6", square=0.03)


def test_too_few_or_too_similar_views_are_refused(small: tuple[Camera, Path], tmp_path: Path) -> None:
    files = sorted(small[1].iterdir())
    with pytest.raises(km.InputError, match=r"one: 3 pictures show a chessboard .* at least 5 are needed"):
        km.calibrate(files[:3], square=0.03)
    camera = small[0]
    R = camera.R_camera_world.T
    level = [
        (R, R @ (np.array([x, 0.0, z]) - CHESS.points.mean(axis=0) - camera.t_camera_world))
        for x, z in ((0.0, 0.4), (0.02, 0.5), (-0.02, 0.45), (0.03, 0.55), (0.0, 0.6))
    ]
    folder = write_views(tmp_path / "level", camera, CHESS, level)
    with pytest.raises(km.InputError, match="level: the board has one tilt in all 5 views"):
        km.calibrate(folder, square=0.03)


def test_cameras_that_share_no_board_are_refused(small: tuple[Camera, Path], tmp_path: Path) -> None:
    camera = small[0]
    views = tilted(camera, CHESS, 5)
    away = [None] * 5
    for name, poses in (("a", views + away), ("b", away + views)):
        write_views(tmp_path / name, camera, CHESS, poses)
    both = {"a": tmp_path / "a", "b": tmp_path / "b"}
    with pytest.raises(km.InputError, match="no frame in which b and a see the board"):
        km.calibrate(both, square=0.03)
    with pytest.raises(km.InputError, match="9 x 7 inner corners looks the same upside down"):
        km.calibrate(both, square=0.03, size=(9, 7))
