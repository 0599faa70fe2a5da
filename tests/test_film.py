"""Films play in common players, and are written whole or not at all."""

from __future__ import annotations

import base64
import subprocess
import threading
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from estimator.data.media.clip import Clip
from estimator.data.media.film import FORMATS, write_film
from humanoid.support.errors import InputError

COLOURS = np.array([(255, 0, 0), (0, 255, 0), (0, 0, 255), (128, 128, 128), (30, 120, 210), (200, 60, 150)], np.uint8)
NTSC = 30000 / 1001
COUNT = 33  # more than between two key frames


def picture(i: int, size: tuple[int, int] = (192, 96)) -> np.ndarray:
    """Six bars of colour, shifted by one with every frame."""
    bars = np.roll(COLOURS, i, axis=0)
    return np.repeat(np.repeat(bars[None], size[1], axis=0), size[0] // len(COLOURS), axis=1)


def bars(image: np.ndarray) -> np.ndarray:
    """The colours in the middle of the bars (6, 3)."""
    width = image.shape[1] // len(COLOURS)
    return image[image.shape[0] // 2, width // 2 :: width].astype(int)


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("films")
    return {ending: write_film(folder / f"film{ending}", map(picture, range(COUNT)), NTSC) for ending in FORMATS}


@pytest.mark.parametrize(("ending", "code"), [(".mp4", "avc1"), (".webm", "VP90")])
def test_every_frame_at_its_time_in_its_colours(films: dict[str, Path], ending: str, code: str) -> None:
    capture = cv2.VideoCapture(str(films[ending]))
    assert int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode().lower() in (code.lower(), "h264")
    clip = Clip.open(films[ending])
    assert Fraction(clip.fps).limit_denominator(2000) == Fraction(30000, 1001)
    np.testing.assert_allclose(clip.times, np.arange(COUNT) / NTSC, atol=1.1e-3 if ending == ".webm" else 2e-6)
    for i, image in enumerate(clip.frames()):
        np.testing.assert_allclose(bars(image), bars(picture(i)), atol=6, err_msg=str(i))


def test_an_mp4_plays_before_it_is_complete(films: dict[str, Path]) -> None:
    data = films[".mp4"].read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
    described = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-i", films[".mp4"]], capture_output=True, text=True, check=False
    ).stderr
    assert "h264 (High)" in described
    assert "yuv420p(tv, bt709, progressive)" in described


def test_a_gif_lasts_as_long_and_is_small(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.gif", (picture(i // 10, (960, 540)) for i in range(30)), 30.0)
    clip = Clip.open(path)
    assert clip.image_size == (480, 270)
    assert clip.report.read == 13
    np.testing.assert_allclose(clip.times, np.arange(13) * 0.08, atol=1e-9)
    for i, image in enumerate(clip.frames()):
        near = (bars(picture(int(3.0 * t))) for t in (i * 0.08 - 0.04, i * 0.08 + 0.04))  # half a frame of the GIF's
        assert min(np.abs(bars(image) - colours).max() for colours in near) <= 6
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


def test_odd_sizes_and_single_frames(tmp_path: Path) -> None:
    image = np.full((35, 51, 3), 90, np.uint8)
    image[:, -1] = image[-1] = (20, 200, 30)
    path = write_film(tmp_path / "a.mp4", [image], 25.0, fine=True)
    (read,) = Clip.open(path).frames()
    assert read.shape == (36, 52, 3)
    np.testing.assert_allclose(read[5, -2:], image[5, [-1, -1]], atol=12)
    for ending in (".webm", ".gif"):
        assert Clip.open(write_film(tmp_path / f"a{ending}", [image], 25.0)).report.read == 1


def test_equal_pictures_give_equal_files(films: dict[str, Path], tmp_path: Path) -> None:
    for ending, film in films.items():
        again = write_film(tmp_path / f"again{ending}", map(picture, range(COUNT)), NTSC)
        assert again.read_bytes() == film.read_bytes()


@pytest.mark.parametrize(
    ("name", "rate", "problem"),
    [
        ("a.avi", 30.0, r"\.avi is not a film format \(one of \.mp4, \.webm, \.gif\)"),
        ("film", 30.0, r"needs an ending \(one of \.mp4, \.webm, \.gif\)"),
        ("none/a.mp4", 30.0, "cannot be written: No such file or directory"),
        ("a.mp4", float("nan"), "frames per second must be"),
        ("a.mp4", 0.0, "frames per second must be"),
    ],
)
def test_invalid_films(tmp_path: Path, name: str, rate: float, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        write_film(tmp_path / name, [picture(0)], rate)
    assert not list(tmp_path.iterdir())


def test_a_film_cut_short_leaves_the_old_one_and_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, before = tmp_path / "a.mp4", threading.active_count()
    started: list[subprocess.Popen[bytes]] = []

    class Noted(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *arguments: Any, **how: Any) -> None:
            super().__init__(*arguments, **how)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Noted)
    path.write_text("before")

    def stopped() -> Iterator[np.ndarray]:
        yield from map(picture, range(20))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_film(path, stopped(), 30.0)
    with pytest.raises(InputError, match="no frame"):
        write_film(path, [], 30.0)
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]
    assert threading.active_count() == before
    assert started
    assert all(process.returncode is not None for process in started)


def test_an_encoder_that_fails_is_an_error_of_the_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho first >&2; echo no such encoder >&2; exit 8\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    with pytest.raises(InputError, match=r"a\.mp4: cannot be encoded: no such encoder$"):
        write_film(tmp_path / "a.mp4", map(picture, range(COUNT)), 30.0)
    program.write_text("#!/bin/sh\nkill -9 $$\n")
    with pytest.raises(InputError, match=r"a\.mp4: cannot be encoded: FFmpeg was ended by signal 9$"):
        write_film(tmp_path / "a.mp4", map(picture, range(COUNT)), 30.0)


PLAYED = """
const [film, type, time, done] = arguments;
const bytes = Uint8Array.from(atob(film), c => c.charCodeAt(0));
const video = document.createElement("video"), canvas = document.createElement("canvas");
video.muted = true;
video.onerror = () => done(video.error.message);
video.onloadeddata = () => { video.currentTime = time; };
video.onseeked = () => {
  canvas.width = video.videoWidth; canvas.height = video.videoHeight;
  const context = canvas.getContext("2d");
  context.drawImage(video, 0, 0);
  const {data} = context.getImageData(0, 0, canvas.width, canvas.height);
  // a busy Chromium says "seeked" before it has the frame, and then draws black
  if (data.every((value, i) => i % 4 == 3 || value == 0)) return setTimeout(video.onseeked, 20);
  done([video.duration, canvas.width, canvas.height, [...data]]);
};
video.src = URL.createObjectURL(new Blob([bytes], {type}));
"""


@pytest.mark.parametrize("ending", [".mp4", ".webm"])
def test_a_browser_plays_it(films: dict[str, Path], browser: Any, ending: str) -> None:
    browser.get("about:blank")
    data = base64.b64encode(films[ending].read_bytes()).decode()
    for frame in (3, 31):
        played = browser.execute_async_script(PLAYED, data, f"video/{ending[1:]}", (frame + 0.5) / NTSC)
        assert isinstance(played, list), played
        duration, width, height, pixels = played
        assert duration == pytest.approx(COUNT / NTSC, abs=2e-3)
        assert (width, height) == (192, 96)
        shown = np.array(pixels, np.uint8).reshape(height, width, 4)[..., 2::-1]
        # Chromium's own conversion is coarse; with another film's colour matrix it would be off by 30
        np.testing.assert_allclose(bars(shown), bars(picture(frame)), atol=14)


def test_a_browser_shows_the_gif(films: dict[str, Path], browser: Any) -> None:
    browser.get(films[".gif"].as_uri())
    shot = cv2.imdecode(np.frombuffer(browser.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)
    for colour in COLOURS:
        assert (np.abs(shot - colour.astype(int)).max(axis=2) <= 6).sum() > 1000, colour
