"""A run killed without warning and resumed is the undisturbed run, to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.resume import command, differences, finish, frames_in, kill_at
from estimator.fitting import fit_proportions
from estimator.runner import run
from estimator.trackers.registry import make_tracker
from estimator.trackers.tracker import TrackState
from humanoid.body import Body
from humanoid.subject import load_subject
from kinemode import api, demo
from kinemode.inputs import load_inputs
from kinemode.progress import unreported

FRAMES = 32
KILLS = ((3, 0.0), (12, 0.01))  # frames after which it is due, seconds beyond; far from the end: machines stall


@pytest.mark.filterwarnings("ignore::kinemode.api.InputWarning")
def test_killed_twice(tmp_path: Path) -> None:
    clip = demo.make_clip(tmp_path, frames=FRAMES, videos=False, progress=unreported)
    keypoints, out = clip.keypoints[demo.CAMERA], tmp_path / "killed.run"
    arguments = command(["--keypoints", keypoints, "--cameras", clip.cameras, "--fit", "off"], out)
    kept = 0
    for wanted, delay in KILLS:
        killed = kill_at(arguments, out, wanted, delay)
        assert killed.resumed_from == kept
        assert killed.lost == 0
        assert not killed.too_late
        assert wanted <= killed.after < FRAMES
        assert not api.open_run(out).complete
        kept = killed.after
    finish(arguments)
    assert frames_in(out) == FRAMES
    undisturbed = api.track(
        "human34", None, cameras=clip.cameras, keypoints=keypoints, fit="off", out=tmp_path / "undisturbed.run"
    )
    resumed = api.open_run(out)
    assert differences(undisturbed, resumed) == []
    resumed.mode_q[-1, 0, 7] = np.nextafter(resumed.mode_q[-1, 0, 7], np.inf)
    assert differences(undisturbed, resumed) == ["mode_q"]  # the comparison can tell


def test_a_frame_depends_on_the_state_before_it_alone(tmp_path: Path) -> None:
    """A new tracker goes on from the stored state of any frame as the old one did: nothing else is remembered."""
    clip = demo.make_clip(tmp_path, videos=False, progress=unreported)
    subject = load_subject("human34")
    keypoints = {demo.CAMERA: clip.keypoints[demo.CAMERA]}
    observations = load_inputs(Body(subject), None, keypoints, clip.cameras, person="auto").observations
    body = Body(fit_proportions(subject, observations).subject)
    states = [state for _, state in run(make_tracker("css", body), observations, 0)]
    for first in range(1, len(observations)):
        before = states[first - 1]
        assert before is not None
        copied = TrackState.from_arrays({name: array.copy() for name, array in before.arrays().items()})
        _, after = next(run(make_tracker("css", body), observations, 0, state=copied, first=first))
        expected = states[first]
        assert after is not None
        assert expected is not None
        for name, array in expected.arrays().items():
            assert array.tobytes() == after.arrays()[name].tobytes(), (first, name)
