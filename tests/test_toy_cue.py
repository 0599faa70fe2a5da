"""A cue of another package does all that the built-in ones do, from the command line, and nothing else names it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import kinemode
from benchmarks.resume import differences
from benchmarks.resume_kills import Moment, kill_at
from humanoid.support.errors import InputError
from humanoid.support.plugins import VARIABLE
from kinemode.explain import explain
from kinemode.rendering.files import RenderedClip

ROOT = Path(__file__).resolve().parent.parent
SETTINGS = """
[css]
modes = 2
samples = 2
flips = 0
[cues]
working_size = 160
use_silhouette = false
[cues.toy]
noise = 0.25
[smooth]
enabled = false
"""


def command(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "kinemode", *map(str, arguments)], capture_output=True, text=True)


@pytest.fixture(scope="module")
def runs(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same track: at one go; with a helper, killed after two frames, and resumed; without the cue."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, "tests.toy_cue")
        patch.setenv("PYTHONPATH", str(ROOT))
        folder = tmp_path_factory.mktemp("toy")
        (folder / "settings.toml").write_text(SETTINGS)
        (video,), (keypoints,) = clip.videos.values(), clip.keypoints.values()
        files = [video, "--keypoints", keypoints, "--cameras", clip.cameras, "--fit", "off"]
        how = ["--settings", folder / "settings.toml", "--cues", "toy,edges"]
        made = {name: folder / f"{name}.run" for name in ("whole", "killed", "without")}
        whole = command("track", *files, *how, "--out", made["whole"])
        assert whole.returncode == 0, whole.stderr
        again = ["track", *map(str, [*files, *how]), "--workers", "2", "--out", str(made["killed"])]
        killed = kill_at([sys.executable, "-m", "kinemode", *again, "--resume"], made["killed"], Moment(2))
        assert killed.code == -9, killed.said
        assert killed.left == ()
        resumed = command(*again, "--resume")
        assert resumed.returncode == 0, resumed.stderr
        plain = folder / "plain.toml"
        plain.write_text(SETTINGS.replace("[cues.toy]\nnoise = 0.25\n", ""))
        without = command("track", *files, "--settings", plain, "--cues", "edges", "--out", made["without"])
        assert without.returncode == 0, without.stderr
    return made


def test_it_moves_the_body_whoever_does_the_work_and_whenever_it_was_killed(runs: dict[str, Path]) -> None:
    whole, killed, without = (kinemode.open_run(path) for path in runs.values())
    assert whole.complete
    assert whole.header.cues == ("edges", "toy")
    assert whole.header.settings["cues"]["toy"]["noise"] == 0.25
    assert differences(whole, killed) == []
    assert np.abs(whole.mode_q[:, 0] - without.mode_q[:, 0]).max() > 1e-3


def test_it_is_explained(runs: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=f"whole.run: .*the cue 'toy'.*{VARIABLE}"):
        explain(kinemode.open_run(runs["whole"]), 2)  # this process does not have it
    monkeypatch.setenv(VARIABLE, "tests.toy_cue")
    done = command("explain", runs["whole"], "--frame", 2, "--hypothesis", 0, "--out", tmp_path / "pictures")
    assert done.returncode == 0, done.stderr
    energy = {name: energy_of(name, done.stdout) for name in ("cam01: bright middle", "sum", "as the run has it")}
    assert energy["cam01: bright middle"] > 0.0
    assert energy["sum"] == pytest.approx(energy["as the run has it"], abs=2e-3)
    (picture,) = (tmp_path / "pictures").glob("*_toy.png")
    assert cv2.imread(str(picture)) is not None


def energy_of(name: str, table: str) -> float:
    """A row's energy."""
    (row,) = (line.strip() for line in table.splitlines() if line.strip().startswith(name))
    return float(row.removeprefix(name).split()[0])


def test_it_is_listed_and_its_settings_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = command("cues").stdout
    assert "silhouette" in listed
    assert "toy" not in listed
    monkeypatch.setenv(VARIABLE, "tests.toy_cue")
    assert "where the picture is bright" in command("cues").stdout
    told = command("settings").stdout
    assert "[cues.toy]\n# landmark: its number\nlandmark = 1" in told
    assert "use_toy = true" in told
    refused = command("track", "--keypoints", __file__, "--cues", "taste", "--out", "none.run").stderr
    assert "edges, flow, silhouette, toy" in refused


def test_nothing_else_names_it() -> None:
    listed = subprocess.run(["git", "grep", "-lE", "toy_cue|Toy\\b.*Cue"], cwd=ROOT, capture_output=True, text=True)
    assert set(listed.stdout.split()) <= {"tests/test_toy_cue.py", "tests/toy_cue.py"}
    for file in ("estimator", "kinemode", "viz", "humanoid"):
        for path in (ROOT / file).rglob("*.py"):
            assert "bright middle" not in path.read_text(encoding="utf-8")
