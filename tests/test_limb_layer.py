"""The overlay of limbs: it draws the beliefs of the run in place, and reports what it cannot draw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pinocchio as pin
import pytest

import kinemode as km
from estimator.inference.beliefs.space import points_of
from estimator.runs.run_file import RunWriter
from estimator.runs.run_reader import Run
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import limb_placements
from humanoid.subject.subject import load_subject
from kinemode import __main__ as front
from tests.made_runs import made_run
from viz.pictures.limb_layer import draw_beliefs, limb_layer
from viz.pictures.painter import camera_view

SAMPLES = 6


@pytest.fixture
def loose(tmp_path: Path) -> Any:
    """Makes a run of two frames, the first with limb estimates, with some of its extra arrays changed."""
    subject = load_subject("human34")
    body = km.Body(subject)
    q = pin.neutral(body.model)
    q[2] = 0.9
    plain = made_run(tmp_path / "plain.run", subject, np.tile(q, (2, 1, 1)))
    graph = limb_graph(body)
    points = np.repeat(points_of(*limb_placements(graph, body, q))[:, None], SAMPLES, axis=1)
    arrays = {
        "limb_names": np.array(graph.names),
        "limb_points": points,
        "limb_weights": np.full(points.shape[:2], 1.0 / SAMPLES),
    }

    def make(**changed: np.ndarray) -> Run:
        header = replace(plain.header, tracker="loose-limbed", settings={"loose_limbed": {"detail": "paper"}})
        file = tmp_path / f"loose{len(list(tmp_path.iterdir()))}.run"
        with RunWriter.create(file, header) as writer:
            for k in range(2):
                extra = arrays | changed if k == 0 else {}
                writer.append(replace(plain.result(k), extra=extra), {"q": q[None]})
            writer.finish()
        return Run.open(file)

    return make


def test_samples_are_drawn_where_the_limbs_are(loose: Any) -> None:
    """All samples at the true place: the drawing covers the projected joint of each limb, and little else."""
    run = loose()
    layer = limb_layer(run)
    assert layer.beliefs[1] is None
    drawn = layer.beliefs[0]
    assert drawn is not None
    points = drawn[0]
    camera = replace(
        run.header.cameras[0],
        R_camera_world=np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
        t_camera_world=np.array([0.0, 0.9, 4.0]),
    )
    view = camera_view(camera, 640)
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    layer.draw(image, view, 1)
    assert not image.any()
    layer.draw(image, view, 0)
    for point in points[:, 0]:
        x, y = np.round(view.project(point[:3])[0]).astype(int)
        assert image[y - 2 : y + 3, x - 2 : x + 3].any()
    assert 0.01 < (image.max(axis=2) > 0).mean() < 0.2
    aside, moved = np.zeros_like(image), points.copy()
    moved[:, 0, :2] += [0.0, 0.8]  # a sample of little weight hardly moves the mean, and is drawn faintly
    draw_beliefs(aside, view, layer.graph, moved, np.tile([0.001, *[0.999 / (SAMPLES - 1)] * (SAMPLES - 1)], (10, 1)))
    new = (aside.max(axis=2) > 0) & ~cv2.dilate((image.max(axis=2) > 0).astype(np.uint8), np.ones((9, 9))).astype(bool)
    assert 0 < aside[new].max() < 0.3 * image.max()


def test_the_command_writes_what_the_function_writes(loose: Any, tmp_path: Path) -> None:
    run = loose()
    film, plain = km.overlay(run, tmp_path / "a.gif", limbs=True), km.overlay(run, tmp_path / "b.gif")
    assert film.read_bytes() != plain.read_bytes()
    assert front.main(["overlay", str(run.file), "--limbs", "--out", str(tmp_path / "c.gif")]) == 0
    assert (tmp_path / "c.gif").read_bytes() == film.read_bytes()


def test_what_cannot_be_drawn_is_refused(loose: Any, tmp_path: Path) -> None:
    with pytest.raises(km.InputError, match=r"has no limb estimates, its tracker is css .*track with loose-limbed"):
        km.overlay(tmp_path / "plain.run", tmp_path / "a.gif", limbs=True)
    arrays = loose().result(0).extra
    names = arrays["limb_names"].copy()
    names[0] = "tail"
    for name, value, problem in (
        ("limb_names", names, "frame 0: has the limbs tail, "),
        ("limb_points", arrays["limb_points"][:, :, :6], "has limb_points of the shape"),
        ("limb_weights", 2.0 * arrays["limb_weights"], "limb_weights that are not shares"),
    ):
        with pytest.raises(km.InputError, match=problem):
            km.overlay(loose(**{name: value}), tmp_path / "a.gif", limbs=True)
    assert not (tmp_path / "a.gif").exists()
