"""The source of a motion is shown beside the subject that follows it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import kinemode as km
from estimator.data.media.clip import Clip
from tests.builders import body_of
from tests.made_motion import FRAMES, made_motion
from tests.made_runs import made_run
from tests.test_viz import commands
from viz import palette
from viz.pictures.painter import camera_view
from viz.preview.page import page
from viz.scene import as_scene, pictured_scene
from viz.source_figure import ASIDE, source_figure


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> km.Run:
    return made_motion(tmp_path_factory.mktemp("made"))


def test_the_source_stands_to_the_left_of_what_the_body_followed(run: km.Run) -> None:
    figure = as_scene(run).source
    assert figure is not None
    knee, own = figure.names.index("right_knee"), run.body.landmark_names.index("right_knee")
    apart = figure.points[:, knee] - run.landmarks[:, own]
    np.testing.assert_allclose(apart, np.tile([0.0, ASIDE, 0.0], (FRAMES, 1)), atol=0.15)
    ends = {frozenset(figure.names[i] for i in pair) for pair in figure.segments.tolist()}
    limbs = [("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"), ("ankle", "heel")]
    assert {frozenset((f"left_{a}", f"left_{b}")) for a, b in limbs} <= ends
    assert {frozenset(("neck", "mid_hip")), frozenset(("neck", "head_top"))} <= ends
    assert figure.level == 0.0
    np.testing.assert_array_equal(figure.floor_lines[..., 2], 0.0)


def test_landmarks_of_feet_without_a_heel_stand_at_the_ankle(run: km.Run) -> None:
    figure = source_figure(run)
    assert figure is not None
    names = ("left_ankle", "left_big_toe", "right_wrist")
    of_feet = {figure.standing_names[k]: names[i] for k, i in figure.feet_among(names)}
    assert of_feet == {"left_heel": "left_ankle", "left_big_toe": "left_big_toe"}


def test_tracked_runs_have_no_source(tmp_path: Path) -> None:
    body = body_of("human34")
    made = made_run(tmp_path / "a.run", body.subject, np.tile(body.neutral, (2, 1, 1)))
    assert as_scene(made).source is None


def test_the_camera_holds_both(run: km.Run) -> None:
    scene = pictured_scene(run)
    assert scene.source is not None
    view = camera_view(scene.cameras[0], 960)
    known = scene.source.points[np.isfinite(scene.source.points).all(axis=2)]
    for points in (known, run.landmarks.reshape(-1, 3)):
        pixels, _ = view.project(points)
        assert (pixels > 0.0).all()
        assert (pixels < np.array(view.size)).all()


def test_the_film_has_sticks_a_body_and_what_stands(run: km.Run, tmp_path: Path) -> None:
    path = km.overlay(run, tmp_path / "both.mp4")
    scene = pictured_scene(run)
    assert scene.source is not None
    clip = Clip.open(path)
    try:
        frames = list(clip.frames())
    finally:
        clip.close()
    assert len(frames) == FRAMES
    view = camera_view(scene.cameras[0], 960)
    for side in ("left", "right"):
        ends = [scene.source.names.index(f"{side}_{name}") for name in ("knee", "ankle")]
        x, y = view.project(scene.source.points[5, ends].mean(axis=0))[0].round().astype(int)
        colour = frames[5][y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).mean(axis=0)
        np.testing.assert_allclose(colour, palette.bgr(palette.SIDES[side]), atol=40.0)  # type: ignore[index]
    hsv = cv2.cvtColor(frames[5], cv2.COLOR_BGR2HSV)
    assert ((np.abs(hsv[..., 0].astype(int) - 67) < 8) & (hsv[..., 1] > 60)).sum() > 50  # the discs' green


def test_the_page_has_the_source_and_a_legend(run: km.Run) -> None:
    text = page(run)
    assert '"source: sticks"' in text
    assert '"subject: solid"' in text
    paths = {command["path"] for command in commands(text) if "path" in command}
    assert any("/source/bone_0" in path for path in paths)
    assert any("/standing/source_right_heel" in path for path in paths)
    assert any("/standing/subject_right_heel" in path for path in paths)


def test_rerun_has_the_source_beside_the_body(run: km.Run, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    content = km.export(run, tmp_path / "a.rrd").read_bytes()
    for path in (b"/world/source", b"/world/source/standing", b"/world/standing", b"/world/floor"):
        assert path in content
