"""A tracker with its own state, no keypoints and no energy works wherever the others do, and nothing else names it."""

from __future__ import annotations

import subprocess
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinemode as km
from benchmarks.robustness.resume import differences
from benchmarks.support.common import ROOT
from estimator.data.formats.cameras import load_cameras
from estimator.data.observation import Observation
from estimator.runs.run_reader import Run
from estimator.trackers.base import Capabilities
from estimator.tracking.registry import TRACKERS, make_tracker, register
from estimator.tracking.runner import run as run_tracker, stored_state
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.support.errors import InputError
from humanoid.support.plugins import VARIABLE
from kinemode.explain import explain
from kinemode.notices import FindingWarning, InputWarning
from kinemode.pictures import CUES
from kinemode.shot import RenderedClip
from kinemode.terminal import report
from kinemode.testing import check_tracker
from tests.builders import body_of, camera_at, observe
from tests.command_lines import check_written, interrupt_after, output_of_readers, printed_by, track_line
from tests.tiny_clip import tiny_clip

with TRACKERS.restored():  # other tests must not see it
    from tests.toy_tracker import NOISE, SPEC, Middle, ToyTracker

NAME, FRAMES, SHORT = "toy", 8, 5


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> RenderedClip:
    return tiny_clip(tmp_path_factory.mktemp("tiny"), frames=SHORT)


@pytest.fixture
def toy() -> Iterator[None]:
    with TRACKERS.restored(), warnings.catch_warnings():
        register(SPEC)
        warnings.simplefilter("ignore", InputWarning)
        yield


@dataclass(frozen=True)
class Tracked:
    """Runs of the command line on a clip without keypoints: uninterrupted, and interrupted and resumed; and the output
    of the commands that read the first, by name."""

    clip: RenderedClip
    whole: Path
    stopped: Path
    output: Mapping[str, str]


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Tracked:
    folder = tmp_path_factory.mktemp("toy")
    clip = tiny_clip(folder / "clip", frames=FRAMES, fps=20.0)
    (camera, video), (masks,) = *clip.videos.items(), clip.masks.values()
    how = [video, "--cameras", clip.cameras, "--mask", f"{camera}={masks}", "--tracker", NAME, "--seed", "3"]
    whole, stopped = folder / "whole.run", folder / "stopped.run"
    with pytest.MonkeyPatch.context() as patch, TRACKERS.restored():
        patch.setenv(VARIABLE, "tests.toy_tracker")
        register(SPEC)
        interrupt_after(3, track_line(how, stopped), stopped)
        for path in (whole, stopped):
            printed_by(track_line(how, path))
        return Tracked(clip, whole, stopped, output_of_readers(whole, frame=2))


def test_it_runs_on_pictures_alone(tracked: Tracked) -> None:
    run = km.open_run(tracked.whole)
    assert run.complete
    assert run.header.tracker == NAME
    assert run.header.cues == tuple(name for name, cue in CUES.items() if not (cue.needs_depth or cue.learns))
    assert run.status.tolist() == ["tracked"] * FRAMES
    assert not run.confidence.any()
    for note in (f"keypoints in 0 of {FRAMES} frames", "the subject is not fitted"):
        assert any(note in each for each in run.header.notes)
    assert np.array_equal(run.q, run.filtered_q)  # not smoothed, as not requested
    direction, widths, camera = run.extra["direction"], run.extra["widths"], run.header.cameras[0]
    assert np.allclose(camera.directions(camera.project(run.q[:, :3]))[:, :2], direction, atol=1e-6)
    for t, result in enumerate(run):
        own = result.extra["widths"]
        assert np.array_equal(widths[t, : len(own)], own)
        assert np.isnan(widths[t, len(own) :]).all()
    middle = camera.project(np.load(tracked.clip.truth)["landmarks"].mean(axis=1)[-1])
    assert np.linalg.norm(direction[-1] - camera.directions(middle)[:2]) < 0.03  # 12 cm at a distance of 4 m


def test_an_interrupted_run_resumes_to_the_same_bits(tracked: Tracked) -> None:
    assert differences(km.open_run(tracked.whole), km.open_run(tracked.stopped)) == []


def test_every_command_takes_its_run(tracked: Tracked) -> None:
    run = km.open_run(tracked.whole)
    check_written(tracked.whole, FRAMES)
    with np.load(tracked.whole.with_suffix(".npz")) as stored:
        for name in ("widths", "direction"):
            assert np.array_equal(stored[f"extra_{name}"], run.extra[name], equal_nan=True)
    assert f"the hypotheses of {NAME} have no energy that could be taken apart" in tracked.output["explain"]
    direction = np.array2string(run.extra["direction"][2], precision=4, separator=", ")
    assert f"direction: {direction}" in tracked.output["explain"]


def test_it_keeps_the_contract(toy: None, clip: RenderedClip) -> None:
    body, ((name, camera),) = body_of("human34"), load_cameras(clip.cameras).items()
    reader = CueReader([clip.videos[name]], [camera], cue_settings(["silhouette"]), masks=[clip.masks[name]])
    seen = [observe(body, body.neutral, [camera], index=i, time=i / 5.0) for i in range(SHORT)]
    seen = [replace(o, confidence=0.0 * o.confidence, cues=reader.at(o.index)) for o in seen]
    reader.close()
    check_tracker(lambda: make_tracker(NAME, body), seen)


def test_it_is_refused_with_a_start_by_index(toy: None, clip: RenderedClip) -> None:
    with pytest.raises(InputError, match="start: toy does not start by an index"):
        track(clip, start="index")


def test_nothing_else_names_it() -> None:
    """One file of at most 60 lines, registered by being imported; importing this module does not leave it
    registered."""
    assert len((ROOT / "tests/toy_tracker.py").read_text(encoding="utf-8").splitlines()) <= 60
    listed = subprocess.run(
        ["git", "grep", "-lwE", "toy_tracker|ToyTracker"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert set(listed.stdout.split()) <= {"tests/test_toy_tracker.py", "tests/toy_tracker.py", "CONTRIBUTING.md"}
    assert NAME not in TRACKERS


def track(clip: RenderedClip, **changes: Any) -> Run:
    given: dict[str, Any] = {"clips": clip.videos, "cameras": clip.cameras, "mask": clip.masks, "tracker": NAME}
    return km.track("human34", **{**given, "settings": {"cues": {"working_size": 160}}, **changes})


def test_unsupported_features_are_reported_in_one_line(toy: None, clip: RenderedClip, tmp_path: Path) -> None:
    refused: list[tuple[dict[str, Any], str]] = [
        ({"cues": "off", "mask": None}, f"{NAME} cannot start in any frame.*--cues"),
        ({"settings": {"smooth": {"enabled": True}}}, f"hypotheses of {NAME} have no energy that could be smoothed"),
        ({"clips": None, "mask": None}, "keypoints: are needed"),
    ]
    for changes, message in refused:
        with pytest.raises(InputError, match=message):
            track(clip, out=tmp_path / "a.run", **changes)
    assert not (tmp_path / "a.run").exists()


def test_a_clip_on_which_it_never_begins_is_a_run_all_the_same(
    toy: None, clip: RenderedClip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.warns(FindingWarning, match=f"{NAME} could not start in any frame"):
        run = track(clip, cues="edges", mask=None, out=tmp_path / "a.run")
    assert run.complete
    assert run.status.tolist() == ["unobserved"] * SHORT
    assert run.mode_q.shape[1] == 0
    assert dict(run.extra) == {}
    km.export(run, tmp_path / "a.npz")
    report.print_run(run)
    assert f"check: {NAME} could not start in any frame" in capsys.readouterr().out
    with pytest.raises(InputError, match="contains no tracked frame"):
        km.view(run, html=tmp_path / "a.html")
    with pytest.raises(InputError, match="nothing was observed"):
        explain(run, 1)


def test_trackers_that_need_keypoints_still_do(clip: RenderedClip, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"keypoints: are needed, of one frame at least.*annotate"):
        track(clip, tracker="css", out=tmp_path / "a.run")


def test_a_stored_state_that_is_not_its_own_is_refused(clip: RenderedClip, tmp_path: Path) -> None:
    state = Middle(0.1, np.array([0.2, 0.3]))
    toy = ToyTracker(body_of("human34"))
    again, last = stored_state(toy, state.arrays(), tmp_path / "a.run")
    assert last is None
    assert again is not None
    assert {n: a.tobytes() for n, a in again.arrays().items()} == {n: a.tobytes() for n, a in state.arrays().items()}
    for damaged in ({"time": np.array(0.1)}, {**state.arrays(), "direction": np.zeros(3)}):
        with pytest.raises(InputError, match=r"a.run: state: is damaged: .*--overwrite"):
            stored_state(toy, damaged, tmp_path / "a.run")


class Ahead(ToyTracker):
    """Records the following frames that it receives."""

    capabilities = Capabilities(frames_ahead=2)

    def __init__(self) -> None:
        super().__init__(body_of("human34"))
        self.shown: list[tuple[int, ...]] = []

    def can_start(self, observation: Observation) -> bool:
        return True

    def init(self, rng: Any, observation: Observation, following: Sequence[Observation] = ()) -> Any:
        return super().init(rng, observation)

    def step(self, rng: Any, state: Middle, observation: Observation, following: Sequence[Observation] = ()) -> Any:
        assert all(o.cues == (o.index,) for o in following)
        self.shown.append((observation.index, *(o.index for o in following)))
        return super().step(rng, state, observation)


class Numbers:
    """Cues that are the number of their frame."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def at(self, index: int) -> tuple[Any, ...]:
        self.asked.append(index)
        return (index,)


def test_frames_ahead_are_shown_with_their_cues_each_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    body, camera = body_of("human34"), camera_at(0.0)
    seen = [observe(body, body.neutral, [camera], index=i, time=i / 10.0) for i in range(5)]
    monkeypatch.setattr("tests.toy_tracker._mask", lambda observation: np.zeros((1, 1), dtype=bool))
    toy, cues = Ahead(), Numbers()
    frames = list(run_tracker(toy, seen, 0, cues=cues))
    assert toy.shown == [(0,), (1, 2, 3), (2, 3, 4), (3, 4), (4,)]  # its init calls step
    assert cues.asked == [0, 1, 2, 3, 4]
    toy, cues = Ahead(), Numbers()
    list(run_tracker(toy, seen, 0, cues=cues, state=frames[1][1], first=2))
    assert toy.shown == [(2, 3, 4), (3, 4), (4,)]
    assert cues.asked == [2, 3, 4]
    plain = list(run_tracker(ToyTracker(body), seen, 0, cues=Numbers(), state=frames[0][1], first=1))
    assert [r.q.tobytes() for r, _ in plain] == [r.q.tobytes() for r, _ in frames[1:]]
    moved = np.array([s.direction for _, s in frames if s is not None])
    assert 0.0 < np.abs(np.diff(moved, axis=0)).max() < 6.0 * NOISE
