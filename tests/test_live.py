"""`kinemode live`: pictures as they come, dropped rather than late, shown as they are tracked, and kept as a run."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builders import bent, body_of, camera_at
from tiny_clip import QUICK, tiny_clip

import kinemode as km
from estimator.media.clip import Clip
from estimator.results.run_file import RunWriter
from estimator.trackers.frame_result import FrameResult
from kinemode.detection.detectors import Wanted
from kinemode.detection.people import Asked, People
from kinemode.rendering.files import RenderedClip
from kinemode.streams import detecting
from kinemode.streams.capture import FileCamera, Newest, Shot
from kinemode.streams.session import run_session
from viz.preview.moving import Moment, MovingPreview

pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning", "ignore::kinemode.FindingWarning")
ROOT = Path(__file__).resolve().parent.parent
PICTURE = np.zeros((4, 6, 3), np.uint8)
FRAMES, FPS = 5, 5.0


def shots(count: int, pause: float = 0.0) -> Iterator[Shot]:
    for i in range(count):
        time.sleep(pause)
        yield Shot(i, 0.1 * i, PICTURE)


class Slow:
    """In place of a stepper: takes its time."""

    cues = ()

    def __init__(self, seconds: float, fails_at: int | None = None) -> None:
        self.seconds, self.fails_at, self.times = seconds, fails_at, list[float]()

    def step(self, keypoints: Any, picture: Any, time_: float) -> Any:
        time.sleep(self.seconds)
        self.times.append(time_)
        if len(self.times) == self.fails_at:
            raise KeyboardInterrupt
        return SimpleNamespace(index=len(self.times) - 1, status="tracked")

    def finish(self) -> list[Any]:
        return []


def session_of(stepper: Any, pictures: Any, *, every: bool) -> Any:
    seen: list[tuple[int, int]] = []

    def show(step: Any, shot: Shot, dropped: int) -> None:
        seen.append((step.index, shot.number))

    session = run_session(pictures, lambda picture, time: None, stepper, show, every=every)
    assert seen == list(enumerate(session.pictures))[: len(seen)]
    return session


def test_a_slow_tracker_gets_the_newest_picture_and_the_others_are_counted() -> None:
    session = session_of(Slow(0.05), shots(40, 0.01), every=False)
    assert len(session.pictures) + session.dropped == 40
    assert 5 <= len(session.pictures) <= 15  # 0.4 s of pictures, a twentieth each
    assert session.pictures[-1] == 39  # never more than one behind
    assert (np.diff(session.pictures) > 0).all()
    assert f"{session.dropped} dropped: {session.frames} tracked" in session.summary()


def test_a_fast_tracker_gets_all_and_so_does_one_that_is_waited_for() -> None:
    assert session_of(Slow(0.0), shots(10, 0.02), every=False).dropped == 0
    session = session_of(Slow(0.01), shots(10), every=True)
    assert (session.pictures, session.dropped) == (list(range(10)), 0)


def test_ctrl_c_ends_it_and_what_was_tracked_stays() -> None:
    session = session_of(Slow(0.0, fails_at=3), shots(10), every=True)
    assert session.interrupted
    assert session.frames == 2


def test_what_goes_wrong_in_the_camera_is_told() -> None:
    def broken() -> Iterator[Shot]:
        yield from shots(2)
        raise km.InputError("camera 0", "was unplugged")

    with pytest.raises(km.InputError, match="unplugged"):
        session_of(Slow(0.0), broken(), every=False)
    with Newest(shots(10**9)) as newest:  # one that never ends is left
        next(iter(newest))
    assert not newest._thread.is_alive()


def test_a_file_is_played_at_its_own_rate(clip: RenderedClip) -> None:
    (video,) = clip.videos.values()
    now = iter(np.arange(100) * 0.0)  # a clock that stands still, so that all waiting is asked for
    waited: list[float] = []
    camera = FileCamera(video, paced=True, clock=lambda: float(next(now)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("kinemode.streams.capture.time.sleep", waited.append)
        taken = list(camera.shots())
    np.testing.assert_allclose(waited, np.arange(len(taken)) / camera.rate)
    assert [shot.time for shot in taken] == waited
    assert np.array_equal(taken[1].picture, Clip.open(video).frame(1))


@pytest.fixture(scope="module")
def live_clip(tmp_path_factory: pytest.TempPathFactory) -> RenderedClip:
    return tiny_clip(tmp_path_factory.mktemp("live"), frames=FRAMES, fps=FPS)


def test_every_picture_of_a_file_gives_the_run_of_a_tracker(live_clip: RenderedClip, tmp_path: Path) -> None:
    ((name, video),) = live_clip.videos.items()
    out = tmp_path / "live.run"
    given: dict[str, Any] = {"cameras": live_clip.cameras, "cues": "edges,flow", "settings": QUICK}
    keypoints = live_clip.keypoints[name]
    session = km.live(
        video, keypoints=keypoints, subject=live_clip.subject, realtime=False, show=False, out=out, **given
    )
    assert session.pictures == list(range(FRAMES))
    run, seen = km.open_run(out), km.load_keypoints(keypoints)
    tracker = km.Tracker(live_clip.subject, layout=seen.layout, **given)
    assert (run.complete, run.planned_count) == (True, FRAMES)
    for i, picture in enumerate(Clip.open(video).frames()):
        points = np.concatenate([seen.pixels[i], seen.confidence[i][:, None]], axis=1)
        step = tracker.step(points, picture, time=i / FPS)
        assert step is not None
        assert np.array_equal(run.result(i).q, step.hypotheses)
    assert np.array_equal(run.q, run.filtered_q)
    km.overlay(run, tmp_path / "o.gif")
    with pytest.raises(km.InputError, match="exists already"):
        km.live(video, keypoints=keypoints, out=out)


def test_a_run_of_some_pictures_knows_which(live_clip: RenderedClip, tmp_path: Path) -> None:
    """With keypoints from a function, which finds nobody at first."""
    ((name, video),) = live_clip.videos.items()
    seen = km.load_keypoints(live_clip.keypoints[name])
    asked: list[float] = []

    def finder(picture: np.ndarray, at: float) -> np.ndarray | None:
        asked.append(at)
        time.sleep(0.5)  # longer than the pictures are apart
        frame = round(at * FPS)
        return (
            None if len(asked) == 1 else np.concatenate([seen.pixels[frame], seen.confidence[frame][:, None]], axis=1)
        )

    session = km.live(
        video, keypoints=finder, layout=seen.layout, subject=live_clip.subject, cameras=live_clip.cameras, show=False,
        settings=QUICK, out=tmp_path / "some.run",
    )  # fmt: skip
    run = km.open_run(tmp_path / "some.run")
    assert session.dropped > 0
    assert run.header.frames_of(name).tolist() == session.pictures
    assert run.time.tolist() == asked == pytest.approx(np.array(session.pictures) / FPS)
    assert run.status[0] == "unobserved"
    assert callable(km.live)  # no module has taken its name


def test_a_terminal_that_interrupts_leaves_a_whole_run(live_clip: RenderedClip, tmp_path: Path) -> None:
    ((name, video),) = live_clip.videos.items()
    pictures, out = tmp_path / name, tmp_path / "cut.run"
    pictures.mkdir()
    for i, picture in enumerate(list(Clip.open(video).frames()) * 400):
        if i < FRAMES:
            km_write(pictures / f"{i}.png", picture)
        else:
            os.link(pictures / f"{i % FRAMES}.png", pictures / f"{i}.png")
    line = ["live", pictures, "--keypoints", live_clip.keypoints[name], "--cameras", live_clip.cameras, "--no-browser",
            "--no-realtime", "--out", out]  # fmt: skip
    process = subprocess.Popen(
        [sys.executable, "-m", "kinemode", *map(str, line)], env=os.environ | {"PYTHONPATH": str(ROOT)}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout is not None
    assert "Ctrl-C ends it" in process.stdout.readline()
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    printed, told = process.communicate(timeout=60)
    assert process.returncode == 0, told
    assert "0 dropped" in printed
    run = km.open_run(out)
    assert run.complete
    assert len(run) == run.planned_count
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "cut.run"])


@pytest.mark.parametrize("half", [False, True])
def test_an_interruption_while_a_frame_is_stored_leaves_a_whole_run(
    live_clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half: bool
) -> None:
    """When it is stored and not yet counted, or half stored."""
    ((name, video),) = live_clip.videos.items()
    append = RunWriter.append

    def interrupted(writer: RunWriter, result: FrameResult, state: Any) -> None:
        before = writer._position
        if half and before == 2:
            writer._connection.execute("BEGIN IMMEDIATE")
            writer._connection.execute("INSERT INTO frame VALUES (2, x'00')")
            raise KeyboardInterrupt
        append(writer, result, state)
        if before == 2:
            writer._position = before
            raise KeyboardInterrupt

    monkeypatch.setattr(RunWriter, "append", interrupted)
    session = km.live(
        video, keypoints=live_clip.keypoints[name], subject=live_clip.subject, cameras=live_clip.cameras, show=False,
        realtime=False, settings=QUICK, out=tmp_path / "cut.run",
    )  # fmt: skip
    assert session.interrupted
    run = km.open_run(tmp_path / "cut.run")
    assert (len(run), run.planned_count, run.complete) == (2 if half else 3, 2 if half else 3, True)
    assert np.isfinite(run.q).all()


def km_write(path: Path, picture: np.ndarray) -> None:
    import cv2

    assert cv2.imwrite(str(path), picture)


@pytest.mark.parametrize(
    ("source", "given", "message"),
    [
        (Path(__file__), {"keypoints": "absent.json"}, "absent.json: there is no such file"),
        ("absent.mp4", {"keypoints": len}, "absent.mp4: there is no such file"),
        (0, {"detect": "absent"}, "detector: .absent. is unknown"),
        (-1, {"keypoints": len}, "source: -1 is negative"),
        (0.5, {"keypoints": len}, "source: cannot be of type float"),
        (97, {"keypoints": len}, "camera 97: gives no picture"),
    ],
)
def test_what_is_not_there_is_said(source: Any, given: Any, message: str) -> None:
    with pytest.raises(km.InputError, match=message):
        km.live(source, **given)


@pytest.fixture
def preview() -> Iterator[MovingPreview]:
    with MovingPreview(body_of("human34"), (camera_at(0.0),), 3) as preview:
        yield preview


def moment(index: int, q: np.ndarray, other: np.ndarray) -> Moment:
    colour = np.full((480, 640, 3), 40 * index, np.uint8)
    modes = np.stack([q, other])
    return Moment(index, 0.1 * index, "tracked", q, modes, np.array([0.75, 0.25]), (colour,), "2 dropped")


def test_a_page_is_sent_every_frame_or_the_newest_and_the_end(preview: MovingPreview) -> None:
    body, sent = body_of("human34"), list[tuple[str, str]]()
    assert b"waiting for a person" in urllib.request.urlopen(preview.address).read()
    follower = threading.Thread(target=preview.follow, args=(lambda kind, text: sent.append((kind, text)),))
    follower.start()
    for i in range(3):
        preview.show(moment(i, body.neutral, body.neutral))
        time.sleep(0.1)
    preview.end("ended")
    follower.join(timeout=5.0)
    frames = [json.loads(text) for kind, text in sent if kind == "message"]
    assert frames[-1]["index"] == 2
    assert [f["index"] for f in frames] == sorted({f["index"] for f in frames})
    assert sent[-1] == ("end", "ended")
    assert frames[-1]["weight"] == [0.75, 0.25, None]
    assert b"<title>human34" in urllib.request.urlopen(preview.address).read()


def test_the_page_moves_with_what_it_is_sent(browser: Any, preview: MovingPreview) -> None:
    """The joints of the body and of the hypothesis lie where they are, and the picture is the frame's."""
    body = body_of("human34")
    first, second = body.neutral.copy(), bent(body, left_knee_flexion=0.5)
    second[:3] += (0.3, 0.2, 0.1)
    preview.show(moment(1, first, second))
    browser.get(preview.address)
    preview.show(moment(2, second, first))
    for _ in range(200):
        if browser.execute_script("return typeof data === 'object' && data.index[0] === 2"):
            break
        time.sleep(0.05)
    script = """const places = {}; for (const name of ["body", "hypothesis_1"])
      places[name] = Object.fromEntries(node(name).children.map(c => [c.name, c.position.toArray()]));
      const pixel = document.createElement("canvas").getContext("2d");
      pixel.drawImage(data.cameras[0].textures[0].image, 0, 0);
      const colour = pixel.getImageData(9, 9, 1, 1).data[0];
      openPanel(true);
      const knee = data.joints.find(joint => joint.name === "left_knee_flexion").readout.textContent;
      return {places, colour, knee, clock: $("clock").textContent, index: data.index[0]};
    """
    shown = browser.execute_script(script)
    assert shown["index"] == 2
    for name, q in (("body", second), ("hypothesis_1", first)):
        posed = body.at(q)
        for node, place in shown["places"][name].items():
            np.testing.assert_allclose(place, posed.translations[int(node.split("_")[0])], atol=1e-4)
    assert shown["colour"] == pytest.approx(80, abs=3)
    assert shown["knee"].startswith("28.6")  # degrees
    assert "frame 2" in shown["clock"]
    assert "2 dropped" in shown["clock"]
    preview.end("ended")
    time.sleep(0.3)
    assert "ended" in browser.execute_script("return $('clock').textContent")
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    browser.get("about:blank")


def test_the_person_who_was_largest_stays_the_one(monkeypatch: pytest.MonkeyPatch) -> None:
    small, large = (size * np.array([[0.0, 0.0, 1.0], [1.0, 2.0, 1.0]]) for size in (1.0, 3.0))
    pictures = iter([{0: small, 1: large}, {0: large, 1: small}, {0: large}, {0: large}])
    lost = iter([{}, {}, {1: ([], 0)}, {}])  # 1 is remembered for a while, then forgotten

    class Seen(People):
        def see(self, detector: Asked, picture: np.ndarray) -> dict[int, np.ndarray]:
            self.lost = next(lost)
            return next(pictures)

    monkeypatch.setattr(detecting, "DetectorProcess", lambda wanted: None)
    monkeypatch.setattr(detecting, "People", Seen)
    finds = detecting.Detecting(Wanted())
    answers = [finds(np.zeros((2, 2, 3), np.uint8), 0.1 * t) for t in range(4)]
    assert [None if a is None else a is large for a in answers] == [True, False, None, True]
