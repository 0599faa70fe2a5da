"""A cue of another package does all that built-in ones do, from the command line, and nothing else names it."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

import kinemode
from benchmarks.robustness.resume import differences
from benchmarks.support.common import ROOT
from estimator.data.formats.cameras import load_cameras
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.settings import CUES, register
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from humanoid.support.plugins import VARIABLE
from kinemode.explain import explain
from kinemode.shot import RenderedClip
from kinemode.testing import check_cue
from tests.command_lines import (
    check_written,
    interrupt_after,
    output_of_readers,
    printed_by,
    run_with_plugins,
    track_line,
)
from tests.tiny_clip import tiny_clip

with CUES.restored():  # other tests must not see it
    from tests.toy_cue import Toy

FRAMES = 5
SETTINGS = """
[css]
modes = 2
samples = 2
jumps = 0
budget.searches = 8
[cues]
working_size = 160
use_silhouette = false
[cues.toy]
noise = 0.25
[smooth]
enabled = false
"""


@dataclass(frozen=True)
class Runs:
    """The same track of a clip: uninterrupted; interrupted after two frames, with a worker that found the cue by
    itself, and resumed; without the cue. And the output of the commands that read the first, by name."""

    clip: RenderedClip
    whole: Path
    stopped: Path
    without: Path
    output: Mapping[str, str]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    folder = tmp_path_factory.mktemp("toy")
    clip = tiny_clip(folder / "clip", frames=FRAMES)
    settings, plain = folder / "settings.toml", folder / "plain.toml"
    settings.write_text(SETTINGS)
    plain.write_text(SETTINGS.replace("[cues.toy]\nnoise = 0.25\n", ""))
    (video,), (keypoints,) = clip.videos.values(), clip.keypoints.values()
    files = [video, "--keypoints", keypoints, "--cameras", clip.cameras, "--fit", "off"]
    how = [*files, "--settings", settings, "--cues", "toy,edges"]
    plainly = ["track", *files, "--settings", plain, "--cues", "edges"]
    whole, stopped, without = (folder / f"{name}.run" for name in ("whole", "stopped", "without"))
    with pytest.MonkeyPatch.context() as patch, CUES.restored():
        patch.setenv(VARIABLE, "tests.toy_cue")
        register(Toy())
        interrupt_after(2, track_line(how, stopped), stopped)
        for path in (whole, stopped):
            printed_by(track_line(how, path))
        printed_by([*plainly, "--out", without])
        return Runs(clip, whole, stopped, without, output_of_readers(whole, frame=2))


def test_it_moves_the_body_whenever_it_was_stopped(runs: Runs) -> None:
    whole, stopped, without = (kinemode.open_run(path) for path in (runs.whole, runs.stopped, runs.without))
    assert whole.complete
    assert whole.header.cues == ("edges", "toy")
    assert whole.header.settings["cues"]["toy"]["noise"] == 0.25
    assert differences(whole, stopped) == []
    assert np.abs(whole.mode_q[:, 0] - without.mode_q[:, 0]).max() > 1e-3


def test_every_command_takes_its_run(runs: Runs) -> None:
    check_written(runs.whole, FRAMES)
    with np.load(runs.whole.with_suffix(".npz")) as stored:
        assert np.array_equal(stored["mode_q"], kinemode.open_run(runs.whole).mode_q, equal_nan=True)


def test_it_is_explained(runs: Runs) -> None:
    with pytest.raises(InputError, match=f"whole.run: .*the cue 'toy'.*{VARIABLE}"):
        explain(kinemode.open_run(runs.whole), 2)  # this process has not registered it
    table = runs.output["explain"]
    energy = {name: energy_of(name, table) for name in ("cam01: bright middle", "sum", "as the run has it")}
    assert energy["cam01: bright middle"] > 0.0
    assert energy["sum"] == pytest.approx(energy["as the run has it"], abs=2e-3)
    (picture,) = (runs.whole.parent / "pictures").glob("*_toy.png")
    assert cv2.imread(str(picture)) is not None


def test_it_keeps_the_contract(runs: Runs) -> None:
    ((name, camera),) = load_cameras(runs.clip.cameras).items()
    pictures = partial(CameraPictures, runs.clip.videos[name], camera, 160)
    check_cue(Toy(), Body(load_subject(runs.clip.subject)), pictures, np.load(runs.clip.truth)["q"])


def energy_of(name: str, table: str) -> float:
    """A row's energy."""
    (row,) = (line.strip() for line in table.splitlines() if line.strip().startswith(name))
    return float(row.removeprefix(name).split()[0])


def test_it_is_listed_with_its_settings() -> None:
    listed = printed_by(["cues"])
    assert "silhouette" in listed
    assert "toy" not in listed
    wrong = ["track", "--keypoints", __file__, "--cues", "taste", "--out", "none.run"]
    cues, settings, refused = run_with_plugins(["cues"], ["settings"], wrong, names="tests.toy_cue")
    assert "where the picture is bright" in cues.out
    assert "[cues.toy]\n# landmark: its number\nlandmark = 1" in settings.out
    assert "use_toy = true" in settings.out
    assert refused.code == 2
    assert "edges, flow, silhouette, depth, colour, anchors, toy" in refused.error


def test_nothing_else_names_it() -> None:
    """One file of at most 60 lines, registered by being imported; importing this module does not leave it
    registered."""
    assert len((ROOT / "tests/toy_cue.py").read_text(encoding="utf-8").splitlines()) <= 60
    patterns = ["-e", "toy_cue", "-e", "ToySettings", "-e", "ToyMatcher", "-e", "bright middle"]
    listed = subprocess.run(["git", "grep", "-lw", *patterns], cwd=ROOT, capture_output=True, text=True, check=True)
    assert set(listed.stdout.split()) <= {"tests/test_toy_cue.py", "tests/toy_cue.py", "CONTRIBUTING.md"}
    assert "toy" not in CUES
