"""A run of a part of a clip, or of cameras with clocks of their own, shows and reads the right frame of each clip."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import kinemode
from estimator.data.media.clip import Clip
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from kinemode.explain import cue_reader, explain, run_settings
from kinemode.rendering import RenderedClip
from tests.command_lines import interrupted_after
from tests.test_api_cues import ARRAYS
from tests.tiny_clip import QUICK
from viz.pictures.overlay import write_overlay
from viz.scene import as_scene

FRAMES, FIRST = 5, 2
START = FIRST / 5.0  # the clip has 5 frames a second
pytestmark = pytest.mark.filterwarnings("ignore::kinemode.InputWarning")


def track(clip: RenderedClip, out: Path, *, resume: bool = False, start: float = START) -> Run:
    few = {**QUICK, "smooth": {"enabled": False}}
    return kinemode.track(
        "human34", clip.videos, cameras=clip.cameras, keypoints=clip.keypoints, mask=clip.masks, fit="off", out=out,
        cues="edges,silhouette", settings=few, resume=resume, start=start,
    )  # fmt: skip


@pytest.fixture(scope="module")
def late(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run from the third frame on."""
    return track(clip, tmp_path_factory.mktemp("run") / "late.run")


def name_of(clip: RenderedClip) -> str:
    (name,) = clip.videos
    return name


def test_the_run_knows_its_frames(clip: RenderedClip, late: Run) -> None:
    np.testing.assert_array_equal(late.header.frames_of(name_of(clip)), np.arange(FIRST, FRAMES))
    np.testing.assert_allclose(late.time, np.arange(FIRST, FRAMES) / 5.0, atol=1e-6)
    np.testing.assert_array_equal(late.index, np.arange(FRAMES - FIRST))


def test_cues_are_read_from_the_right_frames(clip: RenderedClip, late: Run) -> None:
    reader = cue_reader(late, run_settings(late))
    for t in (0, 2):
        mask = cv2.imread(str(clip.masks[name_of(clip)] / f"{FIRST + t:05d}.png"), cv2.IMREAD_GRAYSCALE) > 127
        np.testing.assert_array_equal(reader.at(t)[0]["silhouette"].mask, mask)  # type: ignore[index]
    reader.close()


def test_pictures_are_those_of_the_right_frames(clip: RenderedClip, late: Run, tmp_path: Path) -> None:
    video = Clip.open(clip.videos[name_of(clip)])
    scene = as_scene(late)
    for t, image in zip((1, 2), scene.images(0, [1, 2]), strict=True):
        np.testing.assert_array_equal(image, video.frame(FIRST + t))
        np.testing.assert_array_equal(explain(late, t).views[0].image, video.frame(FIRST + t))
    assert scene.label(0, 1) == f"frame 1 (clip {FIRST + 1})"
    assert Clip.open(write_overlay(late, tmp_path / "o.mp4")).report.read == FRAMES - FIRST


def test_a_stopped_run_of_a_part_resumes_to_the_same_bits(clip: RenderedClip, late: Run, tmp_path: Path) -> None:
    out = tmp_path / "a.run"
    with pytest.raises(KeyboardInterrupt), interrupted_after(2):
        track(clip, out)
    resumed = track(clip, out, resume=True)
    for name in ARRAYS:
        assert getattr(resumed, name).tobytes() == getattr(late, name).tobytes(), name
    with pytest.raises(InputError, match="frames of the clips"):
        track(clip, out, resume=True, start=START - 0.2)


def test_headers_without_clip_frames(late: Run) -> None:
    old = json.loads(late.header.to_json())
    del old["frames of the clips"]
    header = RunHeader.from_json(json.dumps(old), "old.run")
    np.testing.assert_array_equal(header.frames_of("any"), np.arange(FRAMES - FIRST))


def test_the_command_line_takes_them_all(
    clip: RenderedClip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, settings = name_of(clip), tmp_path / "s.toml"
    settings.write_text("[css]\nsamples = 2\njumps = 0\nmodes = 2\n")
    content = json.loads(clip.keypoints[name].read_text())
    del content["fps"], content["image_size"]
    keypoints = tmp_path / "k.json"
    keypoints.write_text(json.dumps(content))
    arguments = [
        "track", f"{name}={clip.videos[name]}", "--cameras", str(clip.cameras), "--keypoints", f"{name}={keypoints}",
        "--fit", "off", "--settings", str(settings), "--keypoint-size", "160x120", "--fps", f"{name}=5",
        "--offset", f"{name}=-0.2", "--start", "0", "--end", "0.41", "--out", str(tmp_path / "a.run"),
    ]  # fmt: skip
    assert front.main(arguments) == 0
    np.testing.assert_allclose(kinemode.open_run(tmp_path / "a.run").time, [0.0, 0.2, 0.4], atol=1e-6)
    capsys.readouterr()
    assert front.main([*arguments, "--overwrite", "--fps", "0"]) == front.BAD_INPUT
    assert "--fps" in capsys.readouterr().err
