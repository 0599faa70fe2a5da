"""A tracker with a state of its own, no keypoints and no energy goes wherever the others go."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinemode as km
from benchmarks.resume import differences
from estimator.imaging.observation import Observation
from estimator.results.run_file import Run
from estimator.tracking.runner import run as run_tracker
from estimator.tracking.runner import stored_state
from humanoid.support.errors import InputError
from humanoid.support.plugins import VARIABLE
from kinemode import explain, jobs
from kinemode.commands import results as commands
from kinemode.notices import FindingWarning, InputWarning
from kinemode.pictures import CUES
from kinemode.rendering.files import RenderedClip
from kinemode.terminal import report
from tests.builders import body_of, camera_at, observe
from tests.toy_tracker import NOISE, Middle, ToyTracker

FRAMES = 5
NAME = "css"  # the name that it goes by here


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for module in (explain, jobs):
        monkeypatch.setattr(module, "make_tracker", lambda name, body, settings: ToyTracker(body))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        yield


def track(clip: RenderedClip, **changes: Any) -> Run:
    given: dict[str, Any] = {"clips": clip.videos, "cameras": clip.cameras, "masks": clip.masks, "tracker": NAME}
    return km.track("human34", **{**given, "settings": {"cues": {"working_size": 160}}, **changes})


def test_it_runs_on_pictures_alone_and_every_command_takes_its_run(
    clip: RenderedClip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = track(clip, out=tmp_path / "a.run")
    assert run.complete
    assert run.header.cues == tuple(CUES)
    assert run.status.tolist() == ["tracked"] * FRAMES
    assert not run.confidence.any()
    for note in (f"keypoints in 0 of {FRAMES} frames", "the subject is not fitted"):
        assert any(note in each for each in run.header.notes)
    assert np.array_equal(run.q, run.filtered_q)  # it is not smoothed, which nobody asked for
    direction, widths = run.extra["direction"], run.extra["widths"]
    camera = run.header.cameras[0]
    assert np.allclose(camera.directions(camera.project(run.q[:, :3]))[:, :2], direction, atol=1e-6)
    for t, result in enumerate(run):
        own = result.extra["widths"]
        assert np.array_equal(widths[t, : len(own)], own)
        assert np.isnan(widths[t, len(own) :]).all()
    truth = np.load(clip.truth)["landmarks"].mean(axis=1)
    assert (
        np.linalg.norm(direction[-1] - camera.directions(camera.project(truth[-1]))[:2]) < 0.03
    )  # of one at 4 m: 12 cm
    commands.export(run.file, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as stored:
        assert np.array_equal(stored["extra_widths"], widths, equal_nan=True)
        assert np.array_equal(stored["extra_direction"], direction)
    commands.export(run.file, tmp_path / "a.csv")
    commands.view(run.file, html=tmp_path / "a.html")
    commands.overlay(run.file, out=tmp_path / "a.gif")
    commands.explain(run.file, frame=2, out=tmp_path / "pictures")
    said = capsys.readouterr().out
    assert f"the hypotheses of {NAME} have no energy that could be taken apart" in said
    assert f"direction: {np.array2string(direction[2], precision=4, separator=', ')}" in said
    assert len(list((tmp_path / "pictures").iterdir())) >= 1
    report.print_run(run)


def test_it_is_stopped_and_goes_on_to_the_same_bits(
    clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, out, original = track(clip, seed=3), tmp_path / "a.run", jobs.run_into

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(jobs, "run_into", lambda *args, **how: original(*args, **{**how, "progress": stop}))
    with pytest.raises(KeyboardInterrupt):
        track(clip, seed=3, out=out)
    monkeypatch.setattr(jobs, "run_into", original)
    assert len(km.open_run(out)) == 2
    assert differences(whole, track(clip, seed=3, out=out, resume=True)) == []
    assert differences(whole, track(clip, seed=4)) != []


def test_what_it_cannot_do_is_said_in_one_line(clip: RenderedClip, tmp_path: Path) -> None:
    refused: list[tuple[dict[str, Any], str]] = [
        ({"cues": "off", "masks": None}, f"{NAME} can begin in no frame.*--cues"),
        ({"settings": {"smooth": {"enabled": True}}}, f"hypotheses of {NAME} have no energy that could be smoothed"),
        ({"workers": 2}, f"workers: {NAME} works in one process"),
        ({"clips": None, "masks": None}, "keypoints: are needed"),
    ]
    for changes, told in refused:
        with pytest.raises(InputError, match=told):
            track(clip, out=tmp_path / "a.run", **changes)
    assert not (tmp_path / "a.run").exists()


def test_a_clip_on_which_it_never_begins_is_a_run_all_the_same(clip: RenderedClip, tmp_path: Path) -> None:
    with pytest.warns(FindingWarning, match=f"{NAME} could begin in no frame"):
        run = track(clip, cues="edges", masks=None, out=tmp_path / "a.run")
    assert run.complete
    assert run.status.tolist() == ["unobserved"] * FRAMES
    assert run.mode_q.shape[1] == 0
    assert dict(run.extra) == {}
    commands.export(run.file, tmp_path / "a.npz")
    report.print_run(run)
    with pytest.raises(InputError, match="holds no tracked frame"):
        commands.view(run.file, html=tmp_path / "a.html")
    with pytest.raises(InputError, match="nothing was observed"):
        commands.explain(run.file, frame=1)


def test_trackers_that_need_keypoints_still_do(
    clip: RenderedClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    with pytest.raises(InputError, match=r"keypoints: are needed, of one frame at least.*annotate"):
        track(clip, out=tmp_path / "a.run")


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
    """Keeps what it is shown of the frames that follow."""

    frames_ahead = 2

    def __init__(self) -> None:
        super().__init__(body_of("human34"))
        self.shown: list[tuple[int, ...]] = []

    def can_start(self, observation: Observation) -> bool:
        return True

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
    assert toy.shown == [(0,), (1, 2, 3), (2, 3, 4), (3, 4), (4,)]  # its init asks step
    assert cues.asked == [0, 1, 2, 3, 4]
    toy, cues = Ahead(), Numbers()
    list(run_tracker(toy, seen, 0, cues=cues, state=frames[1][1], first=2))
    assert toy.shown == [(2, 3, 4), (3, 4), (4,)]
    assert cues.asked == [2, 3, 4]
    plain = list(run_tracker(ToyTracker(body), seen, 0, cues=Numbers(), state=frames[0][1], first=1))
    assert [r.q.tobytes() for r, _ in plain] == [r.q.tobytes() for r, _ in frames[1:]]
    moved = np.array([s.direction for _, s in frames if s is not None])
    assert 0.0 < np.abs(np.diff(moved, axis=0)).max() < 6.0 * NOISE


PLUGIN = """
from estimator.trackers.spec import Spec
from estimator.tracking.registry import register
from tests.toy_tracker import ToyTracker

register(Spec("toy", "follows the middle of the silhouette", lambda body, settings: ToyTracker(body)))
"""


def test_the_command_line_takes_it_as_it_is_registered(clip: RenderedClip, tmp_path: Path) -> None:
    """Named by its plugin alone, on a clip without keypoints: tracked, explained, exported, viewed, refused."""
    (tmp_path / "registers_the_toy.py").write_text(PLUGIN)
    paths = [str(Path(__file__).parent.parent), str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), VARIABLE: "registers_the_toy"}
    out, masks = tmp_path / "a.run", [f"{name}={path}" for name, path in clip.masks.items()]
    (tmp_path / "small.toml").write_text("[cues]\nworking_size = 160\n")
    how = [*map(str, clip.videos.values()), "--cameras", str(clip.cameras), "--mask", *masks, "--tracker", "toy"]
    how += ["--settings", str(tmp_path / "small.toml"), "--out", str(out)]
    commands = [
        ["track", *how],
        ["explain", str(out), "--frame", "2"],
        ["export", str(out), str(tmp_path / "a.npz")],
        ["view", str(out), "--html", str(tmp_path / "a.html")],
        ["track", *how, "--overwrite", "--workers", "2"],
    ]
    said = [
        subprocess.run([sys.executable, "-m", "kinemode", *c], env=environment, capture_output=True, text=True)
        for c in commands
    ]
    assert [s.returncode for s in said] == [0, 0, 0, 0, 2], [s.stderr for s in said]
    assert "the hypotheses of toy have no energy that could be taken apart" in said[1].stdout
    with np.load(tmp_path / "a.npz") as stored:
        assert np.isfinite(stored["extra_direction"]).all()
    assert "workers: toy works in one process" in said[4].stderr
