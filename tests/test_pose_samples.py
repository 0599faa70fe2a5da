"""Samples of a posterior drawn from the front and from the side."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from builders import body_of
from made_runs import made_run

import kinemode as km
from estimator.data.cameras.camera import guessed_camera
from humanoid.support.errors import InputError
from kinemode.__main__ import main
from viz.pictures.painter import BodyPainter, camera_view
from viz.pictures.pose_samples import draw_samples, samples_tile

CAMERA = guessed_camera("a", (640, 480))


def poses(count: int, std: float, seed: int = 0) -> np.ndarray:
    """Of human34, four metres before the camera, joints but not the root about their neutral."""
    body = body_of("human34")
    steps = np.random.default_rng(seed).normal(0.0, std, (count, body.nv))
    steps[:, :6] = [4.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    q = np.array([body.integrate(body.neutral, step) for step in steps])
    return np.clip(q, body.lower, body.upper)


def touched(q: np.ndarray) -> tuple[int, int]:
    """How many pixels are drawn on, and how bright the brightest of them is."""
    view = camera_view(CAMERA, 640)
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    draw_samples(image, view, BodyPainter(body_of("human34")), q)
    return int((image.max(axis=2) > 0).sum()), int(image.max())


def test_what_agrees_is_bright_and_what_is_open_is_wide() -> None:
    alone, same, apart = touched(poses(1, 0.0)), touched(poses(40, 0.0)), touched(poses(40, 0.3))
    assert alone[0] > 200
    assert same[0] == pytest.approx(alone[0], rel=0.02)
    assert same[1] > 1.5 * alone[1]
    assert apart[0] > 3 * same[0]
    assert touched(poses(1, 0.0)[:0]) == (0, 0)


def test_both_views_show_the_body() -> None:
    tile = samples_tile(None, CAMERA, BodyPainter(body_of("human34")), poses(5, 0.1), longest=320)
    assert tile.shape == (480, 320, 3)
    plain = samples_tile(None, CAMERA, BodyPainter(body_of("human34")), poses(5, 0.1)[:0], longest=320)
    assert (tile[:240] != plain[:240]).any()
    assert (tile[240:] != plain[240:]).any()


def test_a_run_is_drawn_and_unusable_input_is_refused(tmp_path: Path) -> None:
    q = np.repeat(poses(1, 0.1)[None], 5, axis=0)
    q[2] = np.nan
    run = made_run(tmp_path / "a.run", body_of("human34").subject, q)
    path = km.samples(run, tmp_path / "a.png", frames=9, count=3)
    picture = cv2.imread(str(path))
    assert picture.shape[1] == 4 * 320
    assert main(["samples", str(run.file), "--out", str(tmp_path / "b.png"), "--frames", "9", "--count", "3"]) == 0
    assert (tmp_path / "b.png").read_bytes() == path.read_bytes()
    with pytest.raises(InputError, match=r"end in \.png"):
        km.samples(run, tmp_path / "a.jpg")
    with pytest.raises(InputError, match="count: must be 1 or more"):
        km.samples(run, tmp_path / "a.png", count=0)
    with pytest.raises(InputError, match="zenith"):
        km.samples(run, tmp_path / "a.png", camera="zenith")
    nothing = made_run(tmp_path / "n.run", body_of("human34").subject, np.full_like(q, np.nan))
    with pytest.raises(InputError, match="contains no poses"):
        km.samples(nothing, tmp_path / "a.png")
