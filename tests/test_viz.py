"""Pictures: drawings lie where the camera projects them, and the files are complete."""

from __future__ import annotations

import base64
import json
import os
import re
import socket
import subprocess
import threading
import urllib.request
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pinocchio as pin
import pytest
import umsgpack

from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.observation import Observation
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import FrameResult
from humanoid import Body, InputError, load_subject
from viz.local_server import LocalServer
from viz.pictures.overlay import write_overlay
from viz.pictures.painter import BodyPainter, camera_view
from viz.pictures.sheet import write_sheet
from viz.preview.live import serve
from viz.preview.page import page, write_html
from viz.scene import Scene, as_scene, evenly
from viz.solids.body_solids import body_solids, skeleton
from viz.solids.solid import merged, side_of


def looking_camera(name: str, eye: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    """A camera of 640 x 480 px with some distortion, level, facing a point."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[620.0, 0.0, 322.0], [0.0, 618.0, 238.0], [0.0, 0.0, 1.0]])
    return Camera(name, (640, 480), K, np.array([-0.05, 0.1, 0.001, -0.001, 0.0]), R, -R @ np.array(eye))


def moving_scene(instants: int = 12, modes: int = 3, with_frames: bool = True) -> Scene:
    """human34 swinging smoothly within its limits, 3.5 m from a camera, with perturbed hypotheses beside it."""
    body = Body(load_subject("human34"))
    rng = np.random.default_rng(1)
    camera = looking_camera("front", (3.5, 0.6, 1.2), (0.0, 0.0, 0.95))
    time = np.arange(instants) / 30.0
    amplitude, phase = rng.uniform(0.2, 0.6, body.nv), rng.uniform(0.0, 6.28, body.nv)
    amplitude[:6] = 0.05
    start = pin.neutral(body.model)
    start[2] = 0.92
    q = np.array([body.integrate(start, amplitude * np.sin(3.0 * t + phase)) for t in time])
    mode_q = np.full((instants, modes, body.nq), np.nan)
    mode_weight = np.full((instants, modes), np.nan)
    bend = rng.normal(0.0, 0.35, (modes, body.nv))
    bend[:, :6] *= 0.3
    bend[0] = 0.0
    for t in range(instants):
        for k in range(modes if t % 5 else modes - 1):
            mode_q[t, k] = body.integrate(q[t], bend[k])
            mode_weight[t, k] = 0.6**k
        mode_weight[t] /= np.nansum(mode_weight[t])
    landmarks = np.array([body.landmarks(body.at(x)) for x in q])
    pixels = camera.project(landmarks)[:, None] + rng.normal(0.0, 3.0, (instants, 1, len(body.landmark_names), 2))
    confidence = rng.uniform(0.1, 1.0, pixels.shape[:3])
    pictures = [np.full((480, 640, 3), 90 + t, dtype=np.uint8) for t in range(instants)]
    return Scene(
        body, (camera,), ((lambda: iter(pictures)) if with_frames else None,), np.arange(instants), time,
        ("tracked",) * instants, q, mode_q, mode_weight, np.zeros(instants, dtype=int), pixels, confidence,
    )  # fmt: skip


def test_the_silhouette_lands_where_the_camera_projects_the_surface() -> None:
    scene = moving_scene(4)
    painter = BodyPainter(scene.body)
    for longest in (640, 320):
        view = camera_view(scene.cameras[0], longest)
        posed = scene.body.at(scene.q[3])
        canvas = np.zeros((view.size[1], view.size[0], 3), dtype=np.uint8)
        painter.solid(canvas, view, posed, 1.0)
        drawn = canvas.max(axis=2) > 40
        full = scene.cameras[0].project(painter.vertices(posed))
        expected = (full + 0.5) * longest / 640.0 - 0.5
        rows, columns = np.nonzero(drawn)
        assert np.abs([columns.min(), rows.min()] - expected.min(axis=0)).max() < 1.2
        assert np.abs([columns.max(), rows.max()] - expected.max(axis=0)).max() < 1.2
        inside = np.round(expected).astype(int)
        kernel = np.ones((3, 3), np.uint8)
        assert cv2.dilate(drawn.astype(np.uint8), kernel)[inside[:, 1], inside[:, 0]].all()


def test_nearer_parts_cover_farther_ones() -> None:
    body = Body(load_subject("human34"))
    q = pin.neutral(body.model)
    centre = body.landmarks(body.at(q))[body.landmark_names.index("left_knee")]
    for side, eye in (("left", 3.0), ("right", -3.0)):  # level with the knees, the near one hides the other
        camera = looking_camera("side", (centre[0], eye, centre[2]), (centre[0], 0.0, centre[2]))
        canvas = np.zeros((480, 640, 3), dtype=np.uint8)
        BodyPainter(body).solid(canvas, camera_view(camera, 640), body.at(q), 1.0)
        blue, _, red = canvas[238, 322].astype(int)
        assert (blue > red + 40) if side == "left" else (red > blue + 40)


def test_solids_are_closed_and_face_outwards() -> None:
    for name in ("human34", "arm8", "upper13"):
        for solid in (*body_solids(Body(load_subject(name))), *merged(body_solids(Body(load_subject(name))))):
            corners = solid.vertices[solid.faces]
            volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
            edges = np.sort(np.concatenate([solid.faces[:, [0, 1]], solid.faces[:, [1, 2]], solid.faces[:, [2, 0]]]), 1)
            assert volume > 1e-5
            assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_a_subject_without_flesh_and_landmarks_is_drawn_as_its_joint_tree() -> None:
    subject = load_subject("human34")
    bare = Body(replace(subject, flesh=(), landmarks=()))
    solids, bones = body_solids(bare), skeleton(bare)
    assert {"left", "right", "trunk"} == {solid.side for solid in solids}
    posed = bare.at(pin.neutral(bare.model))
    knee = posed.translations[bare.model.getJointId("left_knee_flexion")]
    assert np.linalg.norm(bones.at(posed)[bones.segments].reshape(-1, 3) - knee, axis=1).min() < 1e-9


@pytest.mark.parametrize(
    ("name", "side"),
    [("left_hip", "left"), ("l_elbow", "left"), ("arm_R_1", "right"), ("RightFoot", "right"), ("skull", "trunk")],
)
def test_sides_are_read_from_names(name: str, side: str) -> None:
    assert side_of(name) == side


def test_overlay_has_every_frame_at_the_reduced_size(tmp_path: Path) -> None:
    scene = moving_scene(3)
    wide = replace(scene.cameras[0], name="wide", image_size=(1280, 960))
    two = replace(
        scene, cameras=(scene.cameras[0], wide), frames=(scene.frames[0], None),
        pixels=np.repeat(scene.pixels, 2, axis=1), confidence=np.repeat(scene.confidence, 2, axis=1),
    )  # fmt: skip
    done: list[tuple[int, int]] = []
    path = write_overlay(two, tmp_path / "o.mp4", progress=lambda *count: done.append(count))
    capture = cv2.VideoCapture(str(path))
    sizes = []
    while True:
        read, image = capture.read()
        if not read:
            break
        sizes.append(image.shape)
    assert sizes == [(720, 640 + 960, 3)] * len(scene)
    assert done[-1] == (len(scene), len(scene))
    with pytest.raises(InputError, match="front, wide"):
        write_overlay(two, tmp_path / "o.mp4", camera="side")
    with pytest.raises(InputError, match="cannot be written"):
        write_overlay(scene, tmp_path / "missing" / "o.mp4")


def test_pictures_follow_the_instants_even_where_the_clip_ends_early() -> None:
    scene = moving_scene()
    pictures = [np.full((4, 4, 3), value, dtype=np.uint8) for value in range(9)]
    sparse = replace(scene, frames=(lambda: iter(pictures),), index=2 * np.arange(12))
    seen = [None if image is None else int(image[0, 0, 0]) for image in sparse.images(0, range(12))]
    assert seen == [0, 2, 4, 6, 8, *[None] * 7]


def test_sheet_is_written(tmp_path: Path) -> None:
    scene = moving_scene(4, with_frames=False)
    image = cv2.imread(str(write_sheet(scene, tmp_path / "sheet.png", frames=3)))
    assert image is not None
    assert image.shape[1] > image.shape[0]
    assert image.std() > 10.0
    with pytest.raises(InputError):
        write_sheet(scene, tmp_path / "missing" / "sheet.png")


def commands(html: str) -> list[dict[str, Any]]:
    packed = re.search(r"for \(const command of (\[.*?\])\)", html)
    assert packed is not None
    return [umsgpack.unpackb(base64.b64decode(text)) for text in json.loads(packed.group(1))]


def test_page_is_whole_in_itself_and_holds_the_run() -> None:
    scene = moving_scene(instants=12, modes=3)
    html = page(scene)
    assert not re.search(r"<(script|img|link|iframe)[^>]*(src|href)=[\"']?(https?:)?//", html)
    sent = commands(html)
    objects = {c["path"] for c in sent if c["type"] == "set_object"}
    nodes = {path.split("/")[2] for path in objects if path.startswith("/meshcat/hypothesis_")}
    assert nodes == {"hypothesis_0", "hypothesis_1", "hypothesis_2"}
    (animation,) = [c for c in sent if c["type"] == "set_animation"]
    tracks = {clip["path"]: clip["clip"]["tracks"] for clip in animation["animations"]}
    assert {len(array(track["times"])) for clip in tracks.values() for track in clip} == {len(scene)}
    joint = scene.body.model.getJointId("left_knee_flexion")
    (knee,) = [clip for path, clip in tracks.items() if "/body/" in path and path.endswith("left_shank")]
    for t in (0, 7):
        expected = scene.body.at(scene.q[t]).translations[joint]
        assert np.allclose(array(knee[0]["values"]).reshape(-1, 3)[t], expected, atol=1e-6)


def array(packed: umsgpack.Ext) -> np.ndarray:
    return np.frombuffer(packed.data, dtype=np.float32)


def test_long_runs_are_thinned() -> None:
    assert evenly(5, 9) == [0, 1, 2, 3, 4]
    assert evenly(1000, 3) == [0, 500, 999]


def test_preview_starts_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And no server, unlike MeshCat's own viewer."""

    def never(*_: Any, **__: Any) -> None:
        pytest.fail("started something")

    monkeypatch.setattr(subprocess.Popen, "__init__", never)
    monkeypatch.setattr(socket.socket, "bind", never)
    monkeypatch.setattr(os, "fork", never)
    target = write_html(moving_scene(4), tmp_path / "p.html")
    assert target.stat().st_size > 500_000


def saved(scene: Scene, folder: Path, instants: int) -> Path:
    """A run file with the first `instants` of a scene, its clip a folder of images."""
    clip, path = folder / "front", folder / "a.run"
    clip.mkdir()
    for t in range(len(scene)):
        cv2.imwrite(str(clip / f"{t:03d}.png"), np.full((480, 640, 3), 90 + t, dtype=np.uint8))
    subject, camera = scene.body.subject, scene.cameras[0]
    header = RunHeader(
        subject.urdf, subject.source, subject.base, (camera,), {"front": str(clip)}, {"front": camera.image_size},
        scene.time, "css", {}, 0, "0",
    )  # fmt: skip
    with RunWriter.create(path, header) as writer:
        writer.put_observations([
            Observation(t, float(scene.time[t]), scene.cameras, scene.pixels[t], scene.confidence[t])
            for t in range(len(scene))
        ])  # fmt: skip
        for t in range(instants):
            writer.append(result(scene, t), {})
    return path


def result(scene: Scene, t: int) -> FrameResult:
    """A tracker's result for one instant of the scene; the fourth has no hypotheses."""
    k = 0 if t == 3 else int(np.isfinite(scene.mode_weight[t]).sum())
    nv = scene.body.nv
    return FrameResult(
        t, float(scene.time[t]), "lost" if k == 0 else "tracked", scene.mode_q[t, :k], scene.mode_weight[t, :k],
        np.zeros(k), np.zeros((k, nv, nv)), np.full(k, 0 if t not in (0, 4) else -1), np.zeros(k), np.zeros(k),
        ("as_detected",) * k,
    )  # fmt: skip


def test_pictures_are_made_from_an_unfinished_run_file(tmp_path: Path) -> None:
    scene = moving_scene(6)
    run = Run.open(saved(scene, tmp_path, 5))
    read = as_scene(run)
    assert len(read) == 5
    assert not read.has_body(3)
    assert np.allclose(read.q[4], scene.q[4])
    assert np.allclose(read.pixels, scene.pixels[:5])
    (first,) = read.images(0, [0])
    assert first is not None
    assert (first == 90).all()
    for path in (write_overlay(run, tmp_path / "o.mp4"), write_sheet(run, tmp_path / "s.png", frames=5)):
        assert path.stat().st_size > 10_000
    assert '"best": [0, 0, 0, -1, 0]' in page(run)


def test_a_run_without_frames_is_refused(tmp_path: Path) -> None:
    run = Run.open(saved(moving_scene(1), tmp_path, 0))
    with pytest.raises(InputError, match="no tracked frame"):
        page(run)


def test_served_page_follows_the_run_and_the_server_ends(tmp_path: Path) -> None:
    scene = moving_scene(2)
    path = saved(scene, tmp_path, 1)
    run = Run.open(path)
    counts: list[int] = []

    def visit(server: LocalServer, address: str) -> None:
        def load() -> None:
            with urllib.request.urlopen(address) as response:
                statuses = re.search(r'"status": (\[.*?\])', response.read().decode())
            counts.append(len(json.loads(statuses.group(1))) if statuses else -1)

        def run_through() -> None:
            try:
                load()
                writer, _, _ = RunWriter.resume(path, run.header)
                with writer:
                    writer.append(result(scene, 1), {})
                load()
            finally:
                server.shutdown()

        threading.Thread(target=run_through).start()

    serve(run, open_browser=False, ready=visit)
    assert counts == [1, 2]


def test_pixels_that_are_not_square_are_shown_square() -> None:
    """A disc facing the camera is round in the view, and keypoints coincide with their points."""
    camera = guessed_camera("a", (720, 576), 64.0 / 45.0)
    view = camera_view(camera, 800)
    assert view.size == (800, 450)
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    disc = np.stack([np.full(60, 3.0), np.cos(angle), np.sin(angle)], axis=1)  # the camera faces along x
    pixels = view.project(disc)[0]
    wide, high = np.ptp(pixels, axis=0)
    assert wide == pytest.approx(high, rel=2e-3)
    np.testing.assert_allclose(view.pixels(camera.project(disc)), pixels)
    square = camera_view(guessed_camera("a", (720, 576)), 800)
    assert square.size == (720, 576)
    np.testing.assert_array_equal(square.pixels(np.array([3.0, 4.0])), [3.0, 4.0])
