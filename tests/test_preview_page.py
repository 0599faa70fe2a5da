"""The preview's page in a browser: its initial view, what it marks and hides, and that bodies lie on their pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.data.cameras.camera import Camera
from humanoid import Body, load_subject
from tests.test_viz import commands, moving_scene
from tests.waiting import until
from viz.pictures.painter import BodyPainter
from viz.preview.page import page, write_html
from viz.scene import Scene

Open = Callable[..., None]


@pytest.fixture
def show(browser: Any, tmp_path: Path) -> Iterator[Open]:
    """Opens a scene's page, paused, in a window of a given size; the browser is restored afterwards."""
    before = browser.get_window_size()

    def open_page(scene: Scene, place: str = "t=0", size: tuple[int, int] = (600, 450)) -> None:
        browser.set_window_size(*size)
        browser.get("about:blank")  # otherwise a change after # would load nothing
        browser.get(f"{write_html(scene, tmp_path / 'p.html').as_uri()}#{place}")
        until_drawn(browser)

    yield open_page
    browser.get("about:blank")
    browser.get_log("browser")
    browser.set_window_size(before["width"], before["height"])


def until_drawn(browser: Any) -> None:
    drawn = "return viewer.renderer.info.render.frame > 1 && !viewer.needs_render"
    until(lambda: browser.execute_script(drawn), "the scene drawn in the page")


def odd_camera(scene: Scene) -> Camera:
    """The scene's camera with an eccentric principal point, oblong pixels and a tilted head."""
    camera = scene.cameras[0]
    turn = np.radians(12.0)
    R = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    K = np.array([[560.0, 0.0, 250.0], [0.0, 700.0, 300.0], [0.0, 0.0, 1.0]])
    return replace(camera, K=K, R_camera_world=R @ camera.R_camera_world, t_camera_world=R @ camera.t_camera_world)


# Where the window shows the centre of every joint of a body and the corners of the picture, in window pixels.
PLACES = """
const size = viewer.renderer.getSize(new MeshCat.THREE.Vector2());
const seen = point => { const p = point.clone().project(viewer.camera);
                        return [(p.x + 1) / 2 * size.x - 0.5, (1 - p.y) / 2 * size.y - 0.5]; };
viewer.controls.update(); viewer.render(); viewer.scene.updateMatrixWorld(true);
const joints = {};
for (const child of node("body").children)
  joints[child.name] = seen(new MeshCat.THREE.Vector3().setFromMatrixPosition(child.matrixWorld));
let plane = null;
node("cameras", data.cameras[0].node, "picture").traverse(part => { if (part.isMesh) plane = part; });
const corners = plane.geometry.attributes.position, found = [];
for (let i = 0; i < 4; i++)
  found.push(seen(new MeshCat.THREE.Vector3().fromBufferAttribute(corners, i).applyMatrix4(plane.matrixWorld)));
return {joints, corners: found, size: [size.x, size.y], view, visible: plane.visible,
        pictured: plane.material.map !== null};
"""


@pytest.mark.parametrize(
    ("size", "parallel"),
    [
        ((600, 400), False),
        ((300, 600), True),
        pytest.param((300, 600), False, marks=pytest.mark.browser),
        pytest.param((600, 400), True, marks=pytest.mark.browser),
    ],
)
def test_it_opens_with_body_and_picture_in_any_window(
    browser: Any, show: Open, size: tuple[int, int], parallel: bool
) -> None:
    scene = moving_scene(3)
    camera = odd_camera(scene)
    if parallel:
        K = camera.K * [[0.3, 1.0, 1.0], [1.0, 0.3, 1.0], [1.0, 1.0, 1.0]]  # px/m
        camera = replace(camera, K=K, distortion=np.zeros(5), parallel=True)
    scene = replace(scene, cameras=(camera,))
    show(scene, "t=2", size)
    places = browser.execute_script(PLACES)
    assert (places["view"], places["visible"], places["pictured"]) == (0, True, True)
    # (0, 0) is the middle of the picture's first pixel; its corners give its place in the window
    corners, (width, height) = np.array(places["corners"]), camera.image_size
    scale = (corners[2] - corners[0]) / [width, height]
    assert np.abs(corners[[1, 3]] - [[corners[2, 0], corners[0, 1]], [corners[0, 0], corners[2, 1]]]).max() < 0.1
    assert (corners.min(axis=0) > -1.0).all()  # all of the picture is in the window
    assert (corners.max(axis=0) < np.array(places["size"]) + 1.0).all()
    placements = scene.body.at(scene.q[2]).translations
    flat = replace(camera, distortion=np.zeros(5))  # as the picture is shown
    assert len(places["joints"]) > 10
    for name, place in places["joints"].items():
        pixel = flat.project(placements[int(name.split("_")[0])])
        assert np.abs(corners[0] + (pixel + 0.5) * scale - place).max() < 0.05, name


def screenshot(browser: Any) -> np.ndarray:
    """A screenshot of the window (H, W, 3) BGR."""
    return cv2.imdecode(np.frombuffer(browser.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)


def sides(image: np.ndarray) -> np.ndarray:
    """Pixels with the colour of a side of the body (2, H, W): left, right; without the page's panels."""
    blue, red = image[..., 0].astype(int), image[..., 2].astype(int)
    coloured = np.array([blue - red > 70, red - blue > 70])
    coloured[:, :150, :250] = coloured[:, -100:] = False
    return coloured


# The number of pixels of each brightness when the body alone is drawn, white on black.
LAYERS = """
for (const path of [["Background"], ["cameras"]]) node(...path).visible = false;
viewer.scene.background = new MeshCat.THREE.Color(0);
node("body").traverse(part => { if (part.userData.twin) {
  part.material.emissive.set(0xffffff); part.material.color.set(0); part.material.specular.set(0); } });
viewer.render();
const gl = viewer.renderer.getContext(), w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
const pixels = new Uint8Array(4 * w * h);
gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
const counts = {};
for (let i = 0; i < pixels.length; i += 4) counts[pixels[i]] = (counts[pixels[i]] || 0) + 1;
return counts;
"""


def test_the_page_draws_the_body(browser: Any, show: Open) -> None:
    """In the free view both sides have their colours and the body moves. Through a camera it covers its projection, and
    overlapping limbs do not shine through: the overlay has no bands."""
    scene = moving_scene(9, modes=1)
    show(scene, "t=0&view=free", (800, 700))
    assert browser.execute_script("return view") == -1
    shots = [screenshot(browser)]
    for do in ("go(8)", "look(0)"):
        browser.execute_script(do)
        until_drawn(browser)
        shots.append(screenshot(browser))
    assert (sides(shots[0]).sum(axis=(1, 2)) > 500).all()
    assert np.abs(shots[0].astype(int) - shots[1]).mean() > 0.3
    height, width = shots[2].shape[:2]
    assert width > height * 4 / 3  # the page is as high as the picture
    K = scene.cameras[0].K
    surface = scene.cameras[0].project(BodyPainter(scene.body).vertices(scene.body.at(scene.q[8])))
    expected = (surface - [K[0, 2], K[1, 2]]) * height / 480.0 + [(width - 1) / 2, (height - 1) / 2]
    rows, columns = np.nonzero(sides(shots[2]).any(axis=0))
    low, high = expected.min(axis=0), expected.max(axis=0)
    assert np.abs([columns.min() - low[0], columns.max() - high[0], rows.max() - high[1]]).max() < 5.0
    counts = {int(value): number for value, number in browser.execute_script(LAYERS).items()}
    one_layer = round(255 * 0.72)
    body = sum(number for value, number in counts.items() if value > 0)
    assert body > 3000
    assert sum(number for value, number in counts.items() if value > one_layer + 3) < 0.01 * body


def rows(browser: Any) -> list[tuple[str, bool, bool]]:
    """Text, mark and visibility of every hypothesis' row."""
    drawn = browser.execute_script(
        "return bars.map(b => [b.number.textContent, b.row.classList.contains('drawn'), b.row.offsetHeight > 0])"
    )
    return [(text, marked, seen) for text, marked, seen in drawn]


def shown(browser: Any) -> list[bool]:
    return list(browser.execute_script("return bars.map((_, k) => node('hypothesis_' + k).visible)"))


def test_the_drawn_hypothesis_is_marked_what_weighs_nothing_is_hidden_and_each_can_be_switched_off(
    browser: Any, show: Open
) -> None:
    """On a page with nothing but its own controls."""
    scene = moving_scene(3, modes=4)
    weight = np.array([[0.6, 0.397, 0.003, 2e-5], [0.9, 0.1, np.nan, np.nan], [0.2, 0.8, 0.0, 0.0]])
    scene = replace(scene, mode_weight=weight, path=np.array([3, 0, -1]))
    show(scene, "t=0")
    check_controls(browser)
    tiny = "< 0.01 % ◀ drawn, on the best path"
    assert rows(browser) == [
        ("60 %", False, True), ("40 %", False, True), ("0.3 %", False, False), (tiny, True, True),
    ]  # fmt: skip
    assert shown(browser) == [True, True, False, False]  # the drawn hypothesis is the body itself
    assert browser.execute_script("return node('body').visible")
    browser.execute_script("go(1)")
    assert [seen for _, _, seen in rows(browser)] == [True, True, False, False]
    assert rows(browser)[0] == ("90 % ◀ drawn, on the best path", True, True)
    browser.execute_script("go(2)")
    assert not any(marked for _, marked, _ in rows(browser))
    assert not browser.execute_script("return node('body').visible")
    browser.find_element("id", "others").click()
    assert shown(browser) == [False] * 4
    browser.find_element("id", "others").click()
    browser.execute_script("go(0)")
    browser.execute_script("bars[1].box.click()")
    assert shown(browser) == [True, False, False, False]
    browser.execute_script("bars[data.best[0]].box.click()")
    assert not browser.execute_script("return node('body').visible")


def check_controls(browser: Any) -> None:
    text = browser.find_element("tag name", "body").text
    assert "Open Controls" not in text  # MeshCat's own
    assert browser.execute_script("return document.querySelectorAll('.dg').length") == 0
    assert text.startswith("human34")
    names = [item.text for item in browser.find_elements("css selector", "#legend span")]
    assert names == ["left", "right", "trunk", "other hypotheses"]
    assert not [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def test_without_pictures_it_opens_on_the_free_view(browser: Any, show: Open) -> None:
    show(moving_scene(1, modes=1, with_frames=False))
    assert browser.execute_script("return view") == -1


@cache
def page_of(subject: str) -> tuple[Body, str]:
    """A body at rest for two instants, and its page."""
    body, scene = Body(load_subject(subject)), moving_scene(2)
    q = np.tile(body.neutral, (2, 1))
    modes = {"q": q, "mode_q": q[:, None], "mode_weight": np.ones((2, 1)), "path": np.zeros(2, dtype=int)}
    return body, page(replace(scene, body=body, frames=(None,), **modes))


def test_the_legend_matches_the_shown_bodies() -> None:
    def legend(subject: str) -> str:
        return page_of(subject)[1].split('"legend": ')[1].split(', "nothing')[0]

    assert legend("example-robot-data:panda") == '[["body in its own colours", null]]'
    assert [name in legend("arm8") for name in ("left", "right", "trunk", "body")] == [True, False, True, False]


def test_a_hypothesis_has_a_node_per_joint_whatever_its_colours(tmp_path: Path) -> None:
    body, html = page_of("example-robot-data:panda")
    (animation,) = [c for c in commands(html) if c["type"] == "set_animation"]
    moved = [clip["path"] for clip in animation["animations"] if clip["path"].startswith("/meshcat/body/")]
    assert len(moved) == body.njoints  # the base included
    assert len(html) < 3_000_000


def test_the_panel_of_curves_follows_the_instant_and_leads_to_others(browser: Any, show: Open) -> None:
    scene = moving_scene(5)
    at = scene.body.q_names.index("left_elbow_flexion")
    q = scene.q.copy()
    q[:, at] = np.radians([10.0, 20.0, 30.0, 45.0, 60.0])
    interval = np.full((5, 2, scene.body.nq), np.nan)
    interval[:, 0, at], interval[:, 1, at] = q[:, at] - 0.1, q[:, at] + 0.1
    show(replace(scene, q=q, interval=interval), "t=1&joints=left_elbow_flexion")
    charts = "return [...document.querySelectorAll('.chart .head')].map(head => head.innerText.replace(/\\s+/g, ' '))"
    assert browser.execute_script(charts) == ["left elbow flexion 20.0 ° ± 5.7"]
    browser.execute_script("go(4)")
    assert browser.execute_script(charts) == ["left elbow flexion 60.0 ° ± 5.7"]
    pane, panel = browser.execute_script(
        "return ['meshcat-pane', 'panel'].map(id => $(id).getBoundingClientRect().toJSON())"
    )
    assert pane["right"] <= panel["left"] + 1.0  # it covers no part of the scene
    from selenium.webdriver.common.action_chains import ActionChains  # installed with the browser

    chart = browser.find_element("css selector", ".chart svg")
    ActionChains(browser).move_to_element(chart).click().perform()
    assert browser.execute_script("return now") == 2
    listed = "return data.joints.filter(joint => !joint.row.hidden).map(joint => joint.name)"
    names = browser.execute_script(listed)
    assert names == [n for n in scene.body.q_names if not n.startswith("root")]
    browser.find_element("id", "filter").send_keys("left knee")
    assert browser.execute_script(listed) == ["left_knee_flexion"]
