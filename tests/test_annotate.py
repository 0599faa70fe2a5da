"""Clicking landmarks: the server refuses what it should, and what is clicked in a real browser is what is saved."""

from __future__ import annotations

import http.client
import itertools
import json
import queue
import signal
import threading
import webbrowser
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import kinemode as km
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, write_keypoints
from humanoid.subject.landmarks import COCO17, mirror_index
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from kinemode.annotation.annotate import serve_annotation
from kinemode.annotation.server import AnnotationServer
from kinemode.annotation.session import landmark_guide
from kinemode.inputs.load import load_inputs
from kinemode.making_requests import AnnotateRequest
from kinemode.request import FileOptions
from tests.builders import body_of
from tests.waiting import DEADLINE, ended, kinemode_process, until

pytestmark = pytest.mark.filterwarnings("ignore:a folder of images has no frame rate")

WIDTH, HEIGHT, FRAMES = 320, 240, 3
ARM = body_of("arm8").landmark_names
MARKS = {  # BGR colour of a square on a frame, by which it is found in a picture of the page, and its middle
    0: {(0, 0, 255): (40, 30), (0, 255, 0): (250, 60), (255, 0, 255): (161, 123), (0, 255, 255): (90, 201)},
    1: {(255, 255, 0): (205, 177)},
    2: {},
}


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Grey noise with small squares of one colour each."""
    folder: Path = tmp_path_factory.mktemp("walk")
    rng = np.random.default_rng(0)
    for index, marks in MARKS.items():
        image = np.repeat(rng.integers(60, 200, (HEIGHT, WIDTH, 1), dtype=np.uint8), 3, axis=2)
        for colour, (x, y) in marks.items():
            image[y - 3 : y + 4, x - 3 : x + 4] = colour
        assert cv2.imwrite(str(folder / f"{index}.png"), image)
    return folder


@dataclass
class Served:
    """A server running in a thread."""

    server: AnnotationServer
    thread: threading.Thread
    out: Path
    result: list[str]

    def ask(self, method: str, route: str, body: bytes | None = None, **headers: str) -> tuple[int, bytes]:
        host, path = self.server.address.removeprefix("http://").split("/", 1)
        connection = http.client.HTTPConnection(host, timeout=DEADLINE)
        path = route if route.startswith("/") else f"/{path}{route}"
        connection.request(method, path, body, {k.replace("_", "-"): v for k, v in headers.items()})
        answer = connection.getresponse()
        return answer.status, answer.read()

    def post(self, value: Any, **headers: str) -> tuple[int, dict[str, Any]]:
        body = value if isinstance(value, bytes) else json.dumps(value).encode()
        status, answer = self.ask("POST", "save", body, **{"Content_Type": "application/json", **headers})
        return status, json.loads(answer)


Serve = Callable[..., Served]


@pytest.fixture
def serve(clip: Path, tmp_path: Path) -> Iterator[Serve]:
    started: list[Served] = []

    def start(**options: Any) -> Served:
        ready: queue.Queue[AnnotationServer] = queue.Queue()
        out, result = tmp_path / "clicks.json", []
        asked = AnnotateRequest(clip, **{"subject": "arm8", "out": out, "browser": False, **options})
        thread = threading.Thread(target=lambda: result.append(serve_annotation(asked, ready.put)), daemon=True)
        thread.start()
        started.append(Served(ready.get(timeout=DEADLINE), thread, out, result))
        return started[-1]

    yield start
    for running in started:
        running.server.shutdown()
        running.thread.join(DEADLINE)
        assert not running.thread.is_alive()


def test_the_page_and_its_frames(serve: Serve, clip: Path) -> None:
    served = serve(frame=1)
    assert served.server.server_address[0] == "127.0.0.1"
    status, page = served.ask("GET", "")
    assert status == 200
    assert b"__NONCE__" not in page
    assert b"://" not in page  # works offline
    state = json.loads(served.ask("GET", "state.json")[1])
    assert [landmark["name"] for landmark in state["landmarks"]] == list(ARM)
    assert (state["frame"], state["frame_count"], state["image_size"]) == (1, FRAMES, [WIDTH, HEIGHT])
    for index in (2, 0):
        status, png = served.ask("GET", f"frame/{index}.png")
        sent = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
        np.testing.assert_array_equal(sent, cv2.imread(str(clip / f"{index}.png")))
    assert [served.ask("GET", f"frame/{i}.png")[0] for i in ("3", "-1", "999999999", "x")] == [404] * 4


def test_strangers_are_refused(serve: Serve) -> None:
    served = serve()
    token, port = served.server.token, served.server.server_address[1]
    good = {"frames": {"0": {"neck": [1.0, 2.0, 1.0]}}}
    for route in ("/", "/state.json", f"/{token[:-1]}/state.json", f"/{token}x/", f"/{token}"):
        assert served.ask("GET", route)[0] == 403, route
    for host in ("elsewhere.example", f"elsewhere.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", ""):
        assert served.ask("GET", "state.json", Host=host)[0] == 403, host
        assert served.post(good, Host=host)[0] == 403, host
    assert served.post(good, Origin="http://elsewhere.example")[0] == 403
    assert served.post(good, Origin="null")[0] == 403
    assert served.post(good, Content_Type="text/plain")[0] == 415  # what a page may send to any server
    assert served.ask("POST", "/save", b"{}", Content_Type="application/json")[0] == 403
    assert not served.out.exists()
    assert served.post(good, Host=f"localhost:{port}", Origin=f"http://localhost:{port}")[0] == 200


def point(*values: float, name: str = "neck", frame: str = "0") -> dict[str, Any]:
    return {"frames": {frame: {name: values}}}


BAD: dict[str, tuple[Any, str]] = {
    "no JSON": (b"{", "not JSON"),
    "no text": (b"\xff\xfe{}", "not JSON"),
    "too deep": (b"[" * 3000, "not JSON"),
    "a list": ([], "an object"),
    "no frames": ({}, "frames: is missing"),
    "frames in a list": ({"frames": []}, "an object"),
    "points in a list": ({"frames": {"0": []}}, "an object"),
    "no such landmark": (point(1, 2, 1, name="tail"), "no landmark 'tail'"),
    "no such frame": (point(1, 2, 1, frame="3"), "0 to 2"),
    "a frame before the first": (point(1, 2, 1, frame="-1"), "0 to 2"),
    "no frame number": (point(1, 2, 1, frame="²"), "0 to 2"),
    "not a number": (point(float("nan"), 2, 1), "not finite"),
    "infinite": (point(1, float("inf"), 1), "not finite"),
    "text": ({"frames": {"0": {"neck": ["1", 2, 1]}}}, "numbers are needed"),
    "no confidence": (point(1, 2), "3 numbers"),
    "no confidence in it": (point(1, 2, 0), "confidence"),
    "too sure": (point(1, 2, 1.01), "confidence"),
    "left of the image": (point(-0.51, 2, 1), "outside the image of 320 x 240"),
    "below the image": (point(1, HEIGHT - 0.49, 1), "outside the image of 320 x 240"),
}


def test_invalid_posts_are_answered_with_an_error_and_change_nothing(serve: Serve) -> None:
    served = serve()
    edge = {"frames": {"0": {"neck": [-0.5, HEIGHT - 0.5, 1e-3]}}}
    assert served.post(edge)[0] == 200
    before = served.out.read_bytes()
    for case, (value, expected) in BAD.items():
        status, answer = served.post(value)
        assert status == 400, case
        assert expected in answer["error"], case
    limit = served.server.session.largest_post
    for length, status in ((str(limit + 1), 413), ("9" * 30, 413), ("-5", 411), ("x", 411)):
        assert served.ask("POST", "save", b"", Content_Type="application/json", Content_Length=length)[0] == status
    assert served.out.read_bytes() == before
    assert [p.name for p in served.out.parent.iterdir()] == [served.out.name]


def test_every_landmark_of_every_frame_fits_a_post(serve: Serve) -> None:
    served = serve()
    long = [0.1 + 0.2, 1.0 / 3.0, 0.123456789012345678]
    assert served.post({"frames": {str(t): dict.fromkeys(ARM, long) for t in range(FRAMES)}, "close": False})[0] == 200


def test_the_file_is_what_was_posted(serve: Serve, clip: Path) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.uniform((-0.5, -0.5), (WIDTH - 0.5, HEIGHT - 0.5), (len(ARM) - 1, 2))
    clicked = {name: [*p, 1.0] for name, p in zip(ARM[1:], pixels.tolist(), strict=True)}
    served = serve(camera="front")
    assert served.post({"frames": {"2": {"neck": [5.0, 6.0, 1.0]}}})[0] == 200
    status, reply = served.post({"frames": {"0": clicked}, "close": True})
    assert (status, reply["points"], reply["frames"]) == (200, len(clicked), 1)
    served.thread.join(DEADLINE)
    assert served.server.closed
    assert served.result == [reply["command"]]
    assert f"front={clip} --subject arm8 --keypoints front={served.out} --out" in reply["command"]

    track = load_keypoints(served.out)
    assert (track.layout, track.names, track.image_size, track.fps) == ("landmarks", ARM, (WIDTH, HEIGHT), None)
    expected = np.full((FRAMES, len(ARM), 2), np.nan)
    expected[0, 1:] = pixels
    np.testing.assert_array_equal(track.pixels, expected)
    np.testing.assert_array_equal(track.confidence, np.where(np.isnan(expected[..., 0]), 0.0, 1.0))
    inputs = load_inputs(body_of("arm8"), FileOptions({"front": clip}, keypoints={"front": served.out}))
    np.testing.assert_array_equal(np.stack([o.pixels[0] for o in inputs.observations]), expected)

    clicked = {"2": {"neck": [7.25, 8.5, 1.0]}}  # edited again, also in a frame with a single point
    again = serve()
    assert json.loads(again.ask("GET", "state.json")[1])["frames"]["0"]["left_elbow"] == [*pixels[0].tolist(), 1.0]
    assert again.post({"frames": clicked})[0] == 200
    assert json.loads(again.ask("GET", "state.json")[1])["frames"] == clicked
    assert json.loads(serve().ask("GET", "state.json")[1])["frames"] == clicked


def test_a_subjects_own_names_come_back(tmp_path: Path) -> None:
    """Detectors call the top of the head `head`; a subject may call another point so."""
    names, pixels = ("head", "hip", "LElbow"), np.arange(6.0).reshape(1, 3, 2)
    write_keypoints(tmp_path / "k.json", KeypointTrack("landmarks", names, pixels, np.ones((1, 3))))
    assert load_keypoints(tmp_path / "k.json").names == names
    write_keypoints(tmp_path / "k.json", KeypointTrack("someone's", names, pixels, np.ones((1, 3))))
    assert load_keypoints(tmp_path / "k.json").names == ("head_top", "mid_hip", "left_elbow")


def test_a_detectors_points_fill_only_frames_without_clicks(serve: Serve, tmp_path: Path) -> None:
    pixels = np.random.default_rng(2).uniform(10.0, 200.0, (FRAMES, len(COCO17), 2))
    confidence = np.full((FRAMES, len(COCO17)), 0.75)
    elbow, wrist = COCO17.index("left_elbow"), COCO17.index("left_wrist")
    pixels[1, elbow] = -3.0, 5.0  # outside the picture
    detected = KeypointTrack("coco17", COCO17, pixels, confidence, (WIDTH, HEIGHT), 30.0)
    write_keypoints(tmp_path / "detected.json", detected, names=COCO17)
    with pytest.raises(InputError, match="has 3 of the subject's landmarks, at least 4"):
        km.annotate(
            served_clip(tmp_path), subject="arm8", keypoints=tmp_path / "detected.json", out=tmp_path / "x.json"
        )

    served = serve(subject="upper13")
    assert served.post({"frames": {"0": {"neck": [5.0, 6.0, 1.0]}}, "close": True})[0] == 200
    served.thread.join(DEADLINE)
    with pytest.warns(UserWarning, match=r"points outside the image left out \(1 times\)"):
        served = serve(subject="upper13", keypoints=tmp_path / "detected.json")
    frames = json.loads(served.ask("GET", "state.json")[1])["frames"]
    assert frames["0"] == {"neck": [5.0, 6.0, 1.0]}
    assert frames["1"]["left_wrist"] == [*pixels[1, wrist].tolist(), 0.75]
    assert frames["2"].keys() == set(COCO17) & set(body_of("upper13").landmark_names)
    assert frames["1"].keys() == frames["2"].keys() - {"left_elbow"}
    assert served.post({"frames": frames})[0] == 200
    np.testing.assert_array_equal(load_keypoints(served.out).confidence[2].max(), 0.75)


def served_clip(folder: Path) -> Path:
    """A folder of as many frames as `clip` has."""
    images = folder / "images"
    images.mkdir()
    for i in range(FRAMES):
        assert cv2.imwrite(str(images / f"{i}.png"), np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    return images


def test_input_errors_come_before_the_page(serve: Serve, clip: Path, tmp_path: Path) -> None:
    def written(name: str, layout: str, names: tuple[str, ...], count: int, size: tuple[int, int]) -> Path:
        shape = (count, len(names))
        pixels = np.arange(2.0 * count * len(names)).reshape(*shape, 2)
        track = KeypointTrack(layout, names, pixels, np.ones(shape), size, 30.0)
        write_keypoints(tmp_path / name, track, names=names)
        return tmp_path / name

    size = (WIDTH, HEIGHT)
    cases: list[tuple[dict[str, Any], str]] = [
        ({"frame": FRAMES}, r"has no frame 3 \(--frame 0 to 2\)"),
        ({"frame": -1}, "has no frame -1"),
        ({"camera": " "}, "the name is empty"),
        ({"subject": "arm9"}, "arm8"),
        ({"out": tmp_path}, "is a folder"),
        ({"out": tmp_path / "none" / "clicks.json"}, "does not exist"),
        ({"out": written("d.json", "coco17", COCO17, FRAMES, size)}, "coco17 keypoints, not clicks: they are not re"),
        ({"out": written("t.json", "landmarks", ("neck", "tail"), FRAMES, size)}, "the subject lacks: tail"),
        ({"out": written("n.json", "landmarks", ARM, 2, size)}, "with 2 frames, this one has 3"),
        ({"out": written("s.json", "landmarks", ARM, FRAMES, (640, 480))}, "640 x 480 pixels, the clip has 320 x 240"),
        ({"keypoints": tmp_path / "s.json"}, r"s\.json: is of images of 640 x 480 pixels, the clip has 320 x 240"),
        ({"keypoints": tmp_path / "none.json"}, "no such file"),
        ({"port": 99999}, "port: must be 0 to 65535, got 99999"),
    ]
    for options, expected in cases:
        with pytest.raises(InputError, match=expected):
            km.annotate(clip, **{"subject": "arm8", "out": tmp_path / "c.json", "browser": False, **options})
    with pytest.raises(InputError, match="in use"):
        km.annotate(clip, subject="arm8", out=tmp_path / "c.json", port=serve().server.server_address[1])


def test_landmarks_make_a_stick_figure() -> None:
    guide = landmark_guide(body_of("human34"))
    edges = {(guide.names[a], guide.names[b]) for a, b in guide.edges}
    assert {b for _, b in edges} == set(guide.names) - {"mid_hip"}  # a tree: every node but its root has a parent
    assert len(guide.edges) == len(guide.names) - 1
    chain = ("mid_hip", "left_hip", "left_knee", "left_ankle", "left_big_toe")
    assert set(itertools.pairwise(chain)) <= edges
    assert {("mid_hip", "neck"), ("neck", "right_shoulder"), ("right_elbow", "right_wrist"), ("neck", "nose")} <= edges
    mirror = mirror_index(guide.names)
    assert {(int(mirror[a]), int(mirror[b])) for a, b in guide.edges} == set(guide.edges)
    assert not any("link" in about for about in guide.about)


def test_ctrl_c_ends_it_with_one_line(clip: Path, tmp_path: Path) -> None:
    process = kinemode_process(["annotate", clip, "--out", tmp_path / "c.json", "--no-browser"], cwd=tmp_path)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("http://127.0.0.1:")
    process.send_signal(signal.SIGINT)
    code, out, errors = ended(process)
    assert code == front.INTERRUPTED
    assert out == ""
    lines = [line for line in errors.splitlines() if not line.startswith("note:")]
    assert lines == ["interrupted; nothing was saved"]


def test_the_command_prints_the_next_step(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def browser(address: str, new: int) -> bool:
        threading.Thread(target=post, args=(address,), daemon=True).start()
        return True

    def post(address: str) -> None:
        host, path = address.removeprefix("http://").split("/", 1)
        connection = http.client.HTTPConnection(host, timeout=DEADLINE)
        connection.request(
            "POST", f"/{path}save", '{"frames": {}, "close": true}', {"Content-Type": "application/json"}
        )
        connection.getresponse()

    monkeypatch.setattr(webbrowser, "open", browser)
    out = tmp_path / "c.json"
    assert front.main(["annotate", str(clip), "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2:] == [str(out), f"next: kinemode track {clip} --keypoints {clip.name}={out} --out {clip.name}.run"]
    assert out.exists()
    assert front.main(["annotate", str(clip), "--out", str(out), "--frame", "3"]) == front.BAD_INPUT


# ---- in a browser ----


class Person:
    """Operates the page by what is visible: positions are found in screenshots of the window, by colour."""

    def __init__(self, driver: Any) -> None:
        from selenium.webdriver.common.action_chains import ActionChains
        from selenium.webdriver.common.actions.action_builder import ActionBuilder

        self.driver, self._chain, self._builder = driver, ActionChains, ActionBuilder

    def find(self, colour: tuple[int, int, int]) -> tuple[int, int]:
        """Middle of the square of one colour in the window, once it appears."""
        place: list[np.ndarray] = []

        def look() -> bool:
            picture = cv2.imdecode(np.frombuffer(self.driver.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)
            place[:] = np.nonzero((picture == colour).all(axis=2))
            return bool(place[0].size)

        until(look, f"a place of the colour {colour} in the window")
        y, x = (round(float(places.min() + places.max()) / 2.0) for places in place)
        return x, y

    def pointer(self, *steps: tuple[str, Any]) -> None:
        actions = self._builder(self.driver, duration=20)
        for what, argument in steps:
            if what == "to":
                actions.pointer_action.move_to_location(*argument)
            elif what == "press":
                actions.pointer_action.pointer_down(button=argument)
            else:
                actions.pointer_action.pointer_up(button=argument)
        actions.perform()

    def click(self, colour: tuple[int, int, int], button: int = 0) -> None:
        self.pointer(("to", self.find(colour)), ("press", button), ("release", button))

    def keys(self, keys: str) -> None:
        self._chain(self.driver, duration=0).send_keys(keys).perform()

    def wheel(self, colour: tuple[int, int, int], delta: int) -> None:
        actions = self._builder(self.driver, duration=20)
        actions.wheel_action.scroll(*self.find(colour), 0, delta, 0, "viewport")
        actions.perform()

    def expect_text(self, text: str) -> None:
        until(lambda: text in self.driver.find_element("tag name", "body").text, f"{text!r} on the page")


@pytest.fixture(scope="module")
def person(browser: Any) -> Person:
    return Person(browser)


RED, GREEN, PINK, YELLOW = MARKS[0]
(CYAN,) = MARKS[1]


def test_clicks_in_a_browser_are_the_pixels_in_the_file(serve: Serve, person: Person) -> None:
    served = serve()
    person.driver.get(served.server.address)
    person.click(RED)  # shoulder
    person.click(GREEN)  # elbow
    person.expect_text("2 of 7 placed here")
    person.keys("u")  # no elbow
    person.expect_text("1 of 7 placed here")
    person.keys("s")  # the elbow cannot be seen
    person.expect_text("centre of the wrist joint")
    before = person.find(YELLOW)
    person.wheel(PINK, -900)
    person.click(PINK)  # wrist, enlarged
    person.keys("0")
    until(lambda: person.find(YELLOW) == before, "the whole frame again")
    person.click(GREEN)  # index
    person.expect_text("3 of 7 placed here")
    person.click(GREEN, button=2)  # no index
    person.expect_text("2 of 7 placed here")
    red, yellow = person.find(RED), person.find(YELLOW)
    person.pointer(("to", red), ("press", 0), ("to", (red[0] + 20, red[1] + 20)), ("to", yellow), ("release", 0))
    person.pointer(("to", (red[0] + 60, red[1])), ("press", 0), ("to", red), ("release", 0))  # moves the picture only
    person.keys("\ue014")  # right arrow: frame 1
    person.click(CYAN)  # shoulder
    person.expect_text("2 frames with points")
    person.driver.find_element("id", "save").click()
    person.expect_text("3 points in 2 frames saved to")
    check_clicks(served.out, {(0, "left_shoulder"): YELLOW, (0, "left_wrist"): PINK, (1, "left_shoulder"): CYAN})

    person.keys("p\ue017")  # back to the shoulder, and delete it
    person.driver.find_element("id", "close").click()
    person.expect_text("kinemode track")
    served.thread.join(DEADLINE)
    assert served.server.closed
    check_clicks(served.out, {(0, "left_shoulder"): YELLOW, (0, "left_wrist"): PINK})
    assert person.driver.get_log("browser") == []  # no request failed and no script raised


def check_clicks(path: Path, expected: dict[tuple[int, str], tuple[int, int, int]]) -> None:
    """The mouse goes to whole pixels of the window, where a frame's pixel is more than two wide: 0.2 px of rounding."""
    frames = [frame["keypoints"] or [[0.0, 0.0, 0.0]] * len(ARM) for frame in json.loads(path.read_text())["frames"]]
    points = ((t, name, *p) for t, frame in enumerate(frames) for name, p in zip(ARM, frame, strict=True))
    marked = {(t, name): (x, y) for t, name, x, y, confidence in points if confidence > 0.0}
    assert marked.keys() == expected.keys()
    for (t, name), colour in expected.items():
        np.testing.assert_allclose(marked[t, name], MARKS[t][colour], atol=0.3, err_msg=f"{t} {name}")


def test_a_page_from_elsewhere_cannot_save(serve: Serve, person: Person, tmp_path: Path) -> None:
    """Even one that knows the address: the browser sends the origin of each request."""
    served = serve()
    page = tmp_path / "elsewhere.html"
    page.write_text("<title>elsewhere</title>")
    person.driver.get(page.as_uri())
    script = """
        const done = arguments[1], frames = {"0": {"neck": [1, 2, 1]}};
        fetch(arguments[0] + "save", {method: "POST", mode: "no-cors", body: JSON.stringify({frames})})
          .then(() => done("sent"), () => done("stopped"));
    """
    assert person.driver.execute_async_script(script, served.server.address) in ("sent", "stopped")
    assert not served.out.exists()
