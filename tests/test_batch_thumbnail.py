"""Thumbnails of runs: the skeleton lies on the person, and a missing clip does not prevent them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pinocchio as pin
import pytest

from humanoid import InputError, load_subject
from tests.made_runs import made_run
from tests.test_viz import moving_scene
from viz.report.thumbnail import BYTES, HEIGHT, WIDTH, shown_row, thumbnail, write_thumbnail
from viz.scene import Scene


def coordinates_picture(width: int = 640, height: int = 480) -> np.ndarray:
    """Blue encodes a pixel's column, green its row; no red."""
    x, y = np.meshgrid(np.arange(width) * 255.0 / width, np.arange(height) * 255.0 / height)
    return np.round(np.stack([x, y, 0.0 * x], axis=2)).astype(np.uint8)


def of_pictures(picture: np.ndarray, scene: Scene) -> Scene:
    return replace(scene, frames=(lambda start=0: iter([picture] * (len(scene) - start)),))


def test_the_thumbnail_has_the_skeleton_where_the_picture_has_the_person() -> None:
    """The colours give the source pixel of every place: the projected joints are drawn there, and all are inside."""
    scene = of_pictures(coordinates_picture(), moving_scene(5))
    small = thumbnail(scene).astype(float)
    assert small.shape == (HEIGHT, WIDTH, 3)
    rows, columns = np.nonzero(small[..., 2] < 1.0)  # not drawn on
    shown = small[rows, columns, :2] * [640.0 / 255.0, 480.0 / 255.0]
    lines = [np.polyfit(places, values, 1) for places, values in zip((columns, rows), shown.T, strict=True)]
    slope, start = np.array(lines).T
    posed = scene.body.at(scene.q[2])
    joints = (scene.cameras[0].project(posed.translations[2:]) - start) / slope
    assert (joints > 0.0).all()
    assert (joints < [WIDTH, HEIGHT]).all()
    assert np.ptp(joints[:, 1]) > 0.5 * HEIGHT  # the person fills it
    for x, y in np.round(joints).astype(int):
        assert small[y - 1 : y + 2, x - 1 : x + 2, 2].max() > 60.0, (x, y)


def test_the_thumbnail_is_of_the_middle_frame_that_is_tracked() -> None:
    scene = moving_scene(9)
    assert shown_row(scene) == 4
    assert shown_row(replace(scene, status=("hard",) * 6 + ("tracked",) * 3)) == 7
    q = scene.q.copy()
    q[:6] = np.nan
    assert shown_row(replace(scene, status=("hard",) * 9, q=q)) == 7


def test_a_thumbnail_without_its_clip_is_plain_and_all_are_small(tmp_path: Path) -> None:
    scene = moving_scene(3, with_frames=False)
    plain = write_thumbnail(scene, tmp_path / "plain.jpg").read_bytes()

    def damaged(start: int = 0) -> Iterator[np.ndarray]:
        raise InputError("a.mp4", "is damaged")
        yield

    for opener in (damaged, lambda start=0: iter(())):
        assert write_thumbnail(scene, tmp_path / "b.jpg", {"front": opener}).read_bytes() == plain
    noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    noisy = write_thumbnail(scene, tmp_path / "c.jpg", {"front": lambda start=0: iter([noise] * 3)}).read_bytes()
    assert noisy != plain
    assert max(len(plain), len(noisy)) <= BYTES
    for data in (plain, noisy):
        assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape == (HEIGHT, WIDTH, 3)


def test_a_run_file_has_a_thumbnail_wherever_the_person_is(tmp_path: Path) -> None:
    """Also behind the camera or outside its picture; without a pose there is no skeleton."""
    subject = load_subject("human34")
    q = np.tile(pin.neutral(subject.model), (3, 1, 1))
    for k, place in enumerate(([3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 50.0, 0.0])):
        q[:, :, :3] = place
        run = made_run(tmp_path / f"{k}.run", subject, q)
        assert 0 < write_thumbnail(run, tmp_path / f"{k}.jpg").stat().st_size <= BYTES
    q[:] = np.nan
    with pytest.raises(InputError, match="contains no tracked frame"):
        write_thumbnail(made_run(tmp_path / "no.run", subject, q), tmp_path / "no.jpg")
    assert not (tmp_path / "no.jpg").exists()
