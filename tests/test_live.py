"""`kinemode live`: pictures in real time, dropped rather than late, shown as they are tracked, and stored as a run."""

from __future__ import annotations

import json
import signal
import threading
import urllib.request
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from queue import Queue
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builders import bent, body_of, camera_at
from tiny_clip import QUICK

import kinemode as km
from estimator.data.media.clip import Clip
from estimator.data.media.film import write_film
from estimator.runs.run_file import RunWriter
from estimator.trackers.frame_result import FrameResult
from kinemode.detection.detectors import DetectorChoice
from kinemode.detection.people import Asked, People
from kinemode.shot import RenderedClip
from kinemode.streams import job as sources
from kinemode.streams.capture import CapturedPicture, FileCamera, LatestFrameQueue
from kinemode.streams.session import run_session
from tests.waiting import DEADLINE, ended, kinemode_process, until
from viz.preview.moving import Moment, MovingPreview

pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning", "ignore::kinemode.FindingWarning")
PICTURE = np.zeros((4, 6, 3), np.uint8)
FRAMES, FPS = 5, 5.0  # of the fixture `clip`


def shots(count: int) -> Iterator[CapturedPicture]:
    for i in range(count):
        yield CapturedPicture(i, 0.1 * i, PICTURE)


class Steps:
    """In place of a stepper: records the times of its pictures, or is interrupted at one of them."""

    cues = ()

    def __init__(self, fails_at: int | None = None) -> None:
        self.fails_at, self.times = fails_at, list[float]()

    def step(self, keypoints: Any, picture: Any, time_: float) -> Any:
        self.times.append(time_)
        if len(self.times) == self.fails_at:
            raise KeyboardInterrupt
        return SimpleNamespace(index=len(self.times) - 1, status="tracked")

    def finish(self) -> list[Any]:
        return []


class Turns(Steps):
    """A stepper with its camera, which takes pictures on command.

    during: how many pictures are taken in the course of each step. waits: a step ends once these exist; otherwise it
    ends at once, and the next picture may or may not find the tracker waiting.
    """

    def __init__(self, during: Sequence[int], *, waits: bool = True) -> None:
        super().__init__()
        self.during, self.waits = iter(during), waits
        self.allowed, self.there = threading.Semaphore(1), threading.Semaphore(0)

    def shots(self, count: int) -> Iterator[CapturedPicture]:
        for shot in shots(count):
            assert self.allowed.acquire(timeout=DEADLINE)
            yield shot
            if shot.number:  # the producer has stored it; the first is awaited by its receiver
                self.there.release()

    def step(self, keypoints: Any, picture: Any, time_: float) -> Any:
        for _ in range(next(self.during)):
            self.allowed.release()
            assert not self.waits or self.there.acquire(timeout=DEADLINE)
        return super().step(keypoints, picture, time_)


def session_of(stepper: Any, pictures: Any, *, every: bool) -> tuple[Any, list[int]]:
    """The session, and how many pictures were dropped by each step."""
    seen, lost = list[tuple[int, int]](), list[int]()

    def show(step: Any, shot: CapturedPicture, dropped: int) -> None:
        seen.append((step.index, shot.number))
        lost.append(dropped)

    session = run_session(pictures, lambda picture, time: None, stepper, show, every=every)
    assert seen == list(enumerate(session.pictures))[: len(seen)]
    return session, lost


def test_a_slow_tracker_gets_the_newest_picture_and_the_others_are_counted() -> None:
    slow = Turns([4, 3, 1, 5, 0])
    session, lost = session_of(slow, slow.shots(14), every=False)
    assert session.pictures == [0, 4, 7, 8, 13]
    assert lost == [0, 3, 5, 5, 9]
    assert session.dropped == 9
    assert slow.times == pytest.approx(0.1 * np.array(session.pictures))
    assert "9 dropped: 5 tracked" in session.summary()


@pytest.mark.parametrize("waits", [False, True])
def test_a_fast_tracker_gets_all(waits: bool) -> None:
    """Whether the next picture comes before the step has ended or after that."""
    fast = Turns([*[1] * 9, 0], waits=waits)
    session, _ = session_of(fast, fast.shots(10), every=False)
    assert (session.pictures, session.dropped) == (list(range(10)), 0)


def test_a_tracker_that_is_waited_for_gets_all() -> None:
    """No picture is taken before the step of the one before has ended."""
    steps = Steps()

    def taken() -> Iterator[CapturedPicture]:
        for shot in shots(4):
            assert len(steps.times) == shot.number
            yield shot

    session, _ = session_of(steps, taken(), every=True)
    assert (session.pictures, session.dropped) == (list(range(4)), 0)


def test_ctrl_c_ends_it_and_what_was_tracked_stays() -> None:
    session, _ = session_of(Steps(fails_at=3), shots(10), every=True)
    assert session.interrupted
    assert session.frames == 2


def test_camera_errors_are_reported() -> None:
    def broken() -> Iterator[CapturedPicture]:
        yield from shots(2)
        raise km.InputError("camera 0", "was unplugged")

    with pytest.raises(km.InputError, match="unplugged"):
        session_of(Steps(), broken(), every=False)


def test_a_camera_is_left_at_its_next_picture_or_when_it_gives_none() -> None:
    with LatestFrameQueue(shots(10**9), patience=DEADLINE) as newest:
        next(iter(newest))
    assert not newest._thread.is_alive()
    goes_on = threading.Event()

    def hanging() -> Iterator[CapturedPicture]:
        yield from shots(1)
        goes_on.wait(DEADLINE)

    with LatestFrameQueue(hanging(), patience=0.0) as newest:
        next(iter(newest))
    assert newest._thread.is_alive()
    goes_on.set()
    newest._thread.join(DEADLINE)
    assert not newest._thread.is_alive()


def test_a_file_is_played_at_its_own_rate(clip: RenderedClip) -> None:
    (video,) = clip.videos.values()
    now = iter(np.arange(100) * 0.0)  # a clock that stands still, so that all waiting is explicit
    waited: list[float] = []
    taken = list(FileCamera(video, paced=True, clock=lambda: float(next(now)), pause=waited.append).shots())
    np.testing.assert_allclose(waited, np.arange(len(taken)) / FPS)
    assert [shot.time for shot in taken] == waited
    assert np.array_equal(taken[1].picture, Clip.open(video).frame(1))


def test_every_picture_of_a_file_gives_the_run_of_a_tracker(clip: RenderedClip, tmp_path: Path) -> None:
    ((name, video),) = clip.videos.items()
    out = tmp_path / "live.run"
    given: dict[str, Any] = {"cameras": clip.cameras, "cues": "edges,flow", "settings": QUICK}
    keypoints = clip.keypoints[name]
    session = km.live(video, keypoints=keypoints, subject=clip.subject, realtime=False, show=False, out=out, **given)
    assert session.pictures == list(range(FRAMES))
    run, seen = km.open_run(out), km.load_keypoints(keypoints)
    tracker = km.Tracker(clip.subject, layout=seen.layout, **given)
    assert (run.complete, run.planned_count) == (True, FRAMES)
    for i, picture in zip(range(3), Clip.open(video).frames(), strict=False):
        points = np.concatenate([seen.pixels[i], seen.confidence[i][:, None]], axis=1)
        step = tracker.step(points, picture, time=i / FPS)
        assert step is not None
        assert np.array_equal(run.result(i).q, step.hypotheses)
    assert np.array_equal(run.q, run.filtered_q)
    km.overlay(run, tmp_path / "o.gif")
    with pytest.raises(km.InputError, match="exists already"):
        km.live(video, keypoints=keypoints, out=out)


def test_a_run_of_some_pictures_knows_which(
    clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With keypoints from a function, which finds no person at first; meanwhile two pictures are taken."""
    ((name, video),) = clip.videos.items()
    seen = km.load_keypoints(clip.keypoints[name])
    asked: list[float] = []
    allowed, waits = threading.Semaphore(1), threading.Semaphore(0)

    def pause(seconds: float) -> None:
        """The camera's delay before each picture, while earlier ones are processed."""
        waits.release()
        assert allowed.acquire(timeout=DEADLINE)

    def finder(picture: np.ndarray, at: float) -> np.ndarray | None:
        asked.append(at)
        frame = round(at * FPS)
        allowed.release(2 if frame == 0 else 1)
        if frame == 0:  # when the camera waits for the fourth, the third is the newest
            assert all(waits.acquire(timeout=DEADLINE) for _ in range(4))
        points = np.concatenate([seen.pixels[frame], seen.confidence[frame][:, None]], axis=1)
        return None if len(asked) == 1 else points

    monkeypatch.setattr("kinemode.streams.job.FileCamera", partial(FileCamera, pause=pause))
    session = km.live(
        video, keypoints=finder, layout=seen.layout, subject=clip.subject, cameras=clip.cameras, show=False,
        settings=QUICK, out=tmp_path / "some.run",
    )  # fmt: skip
    run = km.open_run(tmp_path / "some.run")
    assert (session.pictures, session.dropped) == ([0, 2, 3, 4], 1)
    assert run.header.frames_of(name).tolist() == session.pictures
    assert run.time.tolist() == asked == pytest.approx(np.array(session.pictures) / FPS)
    assert run.status[0] == "unobserved"
    assert callable(km.live)  # not hidden by a module of that name


def test_a_terminal_that_interrupts_leaves_a_whole_run(clip: RenderedClip, tmp_path: Path) -> None:
    """A still film that lasts longer than any wait."""
    ((name, video),) = clip.videos.items()
    fps = 0.5  # the lowest allowed
    count = round(fps * (DEADLINE + 60))
    slow, out = tmp_path / f"{name}.mp4", tmp_path / "cut.run"
    write_film(slow, [Clip.open(video).frame(0)] * count, fps)
    still = json.loads(clip.keypoints[name].read_text()) | {"fps": fps}
    still["frames"] = still["frames"][:1] * count
    keypoints = tmp_path / "still.json"
    keypoints.write_text(json.dumps(still))
    process = kinemode_process(
        ["live", slow, "--keypoints", keypoints, "--cameras", clip.cameras, "--no-browser", "--out", out]
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    assert "Ctrl-C ends it" in line, ended(process)
    address = line.split()[0]
    with urllib.request.urlopen(f"{address}frames", timeout=DEADLINE) as sent:
        event = next(json.loads(line[6:]) for line in sent if line.startswith(b"data: {"))
    assert event["status"] == "tracked"
    process.send_signal(signal.SIGINT)
    code, printed, errors = ended(process)
    assert code == 0, errors
    assert " tracked" in printed
    run = km.open_run(out)
    assert run.complete
    assert 0 < len(run) == run.planned_count < count
    assert set(tmp_path.iterdir()) == {slow, keypoints, out}


@pytest.mark.parametrize("half", [False, True])
def test_an_interruption_while_a_frame_is_stored_leaves_a_whole_run(
    clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half: bool
) -> None:
    """When it is stored but not yet counted, or half stored."""
    ((name, video),) = clip.videos.items()
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
        video, keypoints=clip.keypoints[name], subject=clip.subject, cameras=clip.cameras, show=False,
        realtime=False, settings=QUICK, out=tmp_path / "cut.run",
    )  # fmt: skip
    assert session.interrupted
    run = km.open_run(tmp_path / "cut.run")
    assert (len(run), run.planned_count, run.complete) == (2 if half else 3, 2 if half else 3, True)
    assert np.isfinite(run.q).all()


@pytest.mark.parametrize(
    ("source", "given", "message"),
    [
        (Path(__file__), {"keypoints": "absent.json"}, "absent.json: there is no such file"),
        ("absent.mp4", {"keypoints": len}, "absent.mp4: there is no such file"),
        (0, {"detector": "absent"}, "detector: .absent. is unknown"),
        (-1, {"keypoints": len}, "source: -1 is negative"),
        (0.5, {"keypoints": len}, "source: cannot be of type float"),
        (97, {"keypoints": len}, "camera 97: gives no picture"),
    ],
)
def test_missing_input_is_reported(source: Any, given: Any, message: str) -> None:
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


def followed(preview: MovingPreview, send: Any) -> threading.Thread:
    thread = threading.Thread(target=preview.follow, args=(send,), daemon=True)
    thread.start()
    return thread


def test_a_page_receives_every_frame_and_the_end() -> None:
    body, sent = body_of("human34"), Queue[tuple[str, str]]()
    with MovingPreview(body, (camera_at(0.0),), 3, patience=DEADLINE, farewell=DEADLINE) as preview:
        assert b"waiting for a person" in urllib.request.urlopen(preview.address).read()
        page = followed(preview, lambda kind, text: sent.put((kind, text)))
        for i in range(3):
            preview.show(moment(i, body.neutral, body.neutral))
            kind, text = sent.get(timeout=DEADLINE)
            frame = json.loads(text)
            assert (kind, frame["index"], frame["weight"]) == ("message", i, [0.75, 0.25, None])
        preview.end("ended")
        assert sent.get_nowait() == ("end", "ended")
        page.join(DEADLINE)
        assert b"<title>human34" in urllib.request.urlopen(preview.address).read()


def test_a_waiting_page_is_pinged() -> None:
    messages, left = list[str](), list[int]()
    with MovingPreview(body_of("arm8"), (camera_at(0.0),), 3, patience=0.0, farewell=0.0) as preview:

        def send(kind: str, text: str) -> None:
            messages.append(kind)
            if len(messages) == 2:
                raise BrokenPipeError
            if len(messages) == 4:
                preview.end("ended")

        def two() -> None:
            with pytest.raises(BrokenPipeError):  # it is not
                preview.follow(send)
            left.append(preview._listeners)
            preview.follow(send)

        pages = threading.Thread(target=two, daemon=True)
        pages.start()
        pages.join(DEADLINE)
    assert messages == ["still"] * 4 + ["end"]
    assert left == [0]


def test_a_page_that_is_too_slow_is_sent_the_newest_frame(preview: MovingPreview) -> None:
    body, sent = body_of("human34"), list[tuple[str, str]]()
    begun, two_more = threading.Semaphore(0), threading.Event()

    def send(kind: str, text: str) -> None:
        sent.append((kind, text))
        if kind == "message":
            begun.release()
            assert two_more.wait(DEADLINE)

    page = followed(preview, send)
    preview.show(moment(0, body.neutral, body.neutral))
    assert begun.acquire(timeout=DEADLINE)
    for i in (1, 2):
        preview.show(moment(i, body.neutral, body.neutral))
    two_more.set()
    assert begun.acquire(timeout=DEADLINE)
    preview.end("ended")
    page.join(DEADLINE)
    assert [json.loads(text)["index"] for kind, text in sent if kind == "message"] == [0, 2]
    assert sent[-1] == ("end", "ended")


def test_the_page_moves_with_what_it_is_sent(browser: Any, preview: MovingPreview) -> None:
    """The joints of the body and of the hypothesis are in their true places, and the picture is the frame's."""
    body = body_of("human34")
    first, second = body.neutral.copy(), bent(body, left_knee_flexion=0.5)
    second[:3] += (0.3, 0.2, 0.1)
    preview.show(moment(1, first, second))
    browser.set_window_size(500, 400)  # fewer pixels draw faster
    browser.get(preview.address)
    preview.show(moment(2, second, first))
    until(lambda: browser.execute_script("return typeof data === 'object' && data.index[0] === 2"), "the second frame")
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
    until(lambda: "ended" in browser.execute_script("return $('clock').textContent"), "the end on the page")
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    browser.get("about:blank")
    browser.set_window_size(1200, 800)


def test_the_largest_person_at_the_start_stays_the_subject(monkeypatch: pytest.MonkeyPatch) -> None:
    small, large = (size * np.array([[0.0, 0.0, 1.0], [1.0, 2.0, 1.0]]) for size in (1.0, 3.0))
    pictures = iter([{0: small, 1: large}, {0: large, 1: small}, {0: large}, {0: large}])
    lost = iter([{}, {}, {1: ([], 0)}, {}])  # 1 is remembered for a while, then forgotten

    class Seen(People):
        def see(self, detector: Asked, picture: np.ndarray) -> dict[int, dict[str, np.ndarray]]:
            self.lost = next(lost)
            return {number: {"keypoints": points} for number, points in next(pictures).items()}

    monkeypatch.setattr(sources, "DetectorProcess", lambda wanted: None)
    monkeypatch.setattr(sources, "People", Seen)
    finds = sources.Detecting(DetectorChoice())
    answers = [finds(np.zeros((2, 2, 3), np.uint8), 0.1 * t) for t in range(4)]
    assert [None if a is None else a is large for a in answers] == [True, False, None, True]
