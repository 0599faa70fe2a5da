"""A run ended at any moment and resumed is the undisturbed run, to the last bit, and leaves nothing behind."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import kinemode as km
from benchmarks.robustness.resume import Pace, differences, moments
from benchmarks.robustness.resume_kills import BEFORE_THE_FILE, Moment, frames_in
from estimator.tracking.registry import make_tracker, settings_for
from estimator.tracking.runner import run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode import demo
from kinemode.inputs.load import load_inputs
from kinemode.progress import unreported
from kinemode.request import FileOptions
from tests.command_lines import killed_at, printed_by, track_line
from tests.tiny_clip import QUICK, QUICK_BY_KEYPOINTS

FRAMES = 6
KILLS = ((Moment(2), -9), (Moment(4, number=signal.SIGTERM, to_all=True), 143))
"""The runs and the exit codes."""


@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
def test_killed_twice(tmp_path: Path) -> None:
    """Without warning, and by a request to end."""
    clip = demo.make_clip(tmp_path, frames=FRAMES, videos=False, progress=unreported)
    keypoints, out, settings = clip.keypoints[demo.CAMERA], tmp_path / "killed.run", tmp_path / "quick.toml"
    settings.write_text(tomli_w.dumps(QUICK))
    how = ["--keypoints", keypoints, "--cameras", clip.cameras, "--fit", "off", "--settings", settings]
    kept = 0
    for moment, code in KILLS:
        killed = killed_at(moment, track_line(how, out), out)
        assert killed.resumed_from == kept
        assert killed.code == code
        assert killed.lost == 0
        assert killed.left == ()
        assert killed.after == moment.wanted
        assert not km.open_run(out).complete
        kept = killed.after
    printed_by(track_line(how, out))
    assert frames_in(out) == FRAMES
    undisturbed = km.track(
        "human34", None, cameras=clip.cameras, keypoints=keypoints, fit="off", out=tmp_path / "undisturbed.run",
        settings=QUICK,
    )  # fmt: skip
    resumed = km.open_run(out)
    assert differences(undisturbed, resumed) == []
    resumed.mode_q[-1, 0, 7] = np.nextafter(resumed.mode_q[-1, 0, 7], np.inf)
    assert differences(undisturbed, resumed) == ["mode_q"]  # the comparison finds it


def test_kills_are_spread_over_the_whole_life_of_a_run() -> None:
    pace = Pace(fit=10.0, first=2.0, period=0.5, after=4.0)
    for count in (1, 2, 3, 7, 8, 30):
        chosen = moments(np.random.default_rng(0), count, 20, pace)
        assert len(chosen) == count
        assert sorted(m.wanted for m in chosen) == [m.wanted for m in chosen]
        assert chosen[-1].wanted == 20
    assert len({m.number for m in chosen}) == 3
    assert {m.wanted for m in chosen} >= {BEFORE_THE_FILE, 0, 20}


def test_a_frame_depends_on_the_state_before_it_alone(tmp_path: Path) -> None:
    """A new tracker continues from the stored state of any frame as the old one did: there is no other state."""
    clip = demo.make_clip(tmp_path, frames=FRAMES, videos=False, progress=unreported)
    body = Body(load_subject("human34"))
    keypoints = {demo.CAMERA: clip.keypoints[demo.CAMERA]}
    observations = load_inputs(body, FileOptions(None, keypoints=keypoints, cameras=clip.cameras)).observations
    settings = settings_for("css", changes=QUICK_BY_KEYPOINTS)
    states = [state for _, state in run(make_tracker("css", body, settings), observations, 0)]
    for first in range(1, len(observations)):
        before = states[first - 1]
        assert before is not None
        tracker = make_tracker("css", body, settings)
        copied = tracker.state_from({name: array.copy() for name, array in before.arrays().items()})
        _, after = next(run(tracker, observations, 0, state=copied, first=first))
        expected = states[first]
        assert after is not None
        assert expected is not None
        for name, array in expected.arrays().items():
            assert array.tobytes() == after.arrays()[name].tobytes(), (first, name)
