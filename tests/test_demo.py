"""The demonstration, on its first frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.runs.reference_motion import Reference
from humanoid.support.errors import InputError
from kinemode import demo
from kinemode.progress import unreported

FRAMES = 3


@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
def test_demo_writes_and_measures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = demo.run_demo(tmp_path / "new" / "out", frames=FRAMES, progress=unreported)
    assert result.frames_compared == FRAMES
    assert result.mpjpe < 0.15
    assert result.best_of_k_mpjpe < 0.15
    assert set(result.angle_errors) > {"left_knee_flexion"}  # the truth has them under the same names
    assert result.violations == 0
    printed = capsys.readouterr().out
    for name in ("overlay.mp4", "preview.html", "contact_sheet.png"):
        path = tmp_path / "new" / "out" / name
        assert path.stat().st_size > 10_000
        assert str(path) in printed
    assert "frames per second" in printed
    for name in ("overlay", *load_cameras(tmp_path / "new" / "out" / "cameras.json")):
        capture = cv2.VideoCapture(str(tmp_path / "new" / "out" / f"{name}.mp4"))
        assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES
        capture.release()


def test_files_of_the_clip_agree(tmp_path: Path) -> None:
    clip = demo.make_clip(tmp_path, frames=8, videos=False)
    reference = Reference.load(clip.truth)
    for name, camera in load_cameras(clip.cameras).items():
        track = load_keypoints(clip.keypoints[name])
        order = [reference.names.index(n) for n in track.names if n is not None]
        error = np.linalg.norm(track.pixels - camera.project(reference.points[:, order]), axis=2)
        assert np.nanmedian(error) < 5.0
    again = demo.make_clip(tmp_path / "again", frames=8, videos=False)
    assert all(again.keypoints[n].read_bytes() == path.read_bytes() for n, path in clip.keypoints.items())


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="taken"):
        demo.make_clip(tmp_path / "taken", frames=2, videos=False)
