"""The lens of a single camera without a calibration: by the user's word, the clip's tags, or that of most phones."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.media.film import ffmpeg_command
from estimator.data.media.lens_tags import film_equivalent
from humanoid.support.errors import InputError
from kinemode.inputs.declared import Declared
from kinemode.inputs.files import InputFiles
from kinemode.inputs.lens import PHONES, lens_of
from kinemode.inputs.load import load_inputs
from tests.builders import body_of, camera_at

BODY = body_of("human34")
TAG = "com.apple.quicktime.camera.focal_length.35mm_equivalent"


def film(path: Path, *tags: str) -> Path:
    said = [word for tag in tags for word in ("-metadata", tag)]
    source = ["-f", "lavfi", "-i", "testsrc=size=64x48:rate=5", "-t", "0.4", "-movflags", "use_metadata_tags"]
    subprocess.run([*ffmpeg_command(), *source, *said, str(path)], check=True)
    return path


@pytest.mark.parametrize(("said", "focal"), [("26mm", 0.721), ("28 mm", 0.777), ("1400px", 1400 / 1920), ("0.9", 0.9)])
def test_what_the_user_says_is_taken(said: str, focal: float) -> None:
    """Of 26 and 28 mm phones the calibrations have 0.714 and 0.784."""
    assert lens_of(said, None, 1920.0).focal == pytest.approx(focal, abs=1e-3)


@pytest.mark.parametrize("said", ["", "x", "26cm", "0", "1e9", "nan", "5000"])
def test_what_is_no_focal_length_is_refused(said: str) -> None:
    with pytest.raises(InputError, match=r"--focal: .*is no focal length .as 26mm"):
        lens_of(said, None, 1920.0)


def test_films_and_pictures_tell_their_lens(tmp_path: Path) -> None:
    assert film_equivalent(film(tmp_path / "a.mov", f"{TAG}=26")) == 26.0
    assert film_equivalent(film(tmp_path / "b.mov")) is None
    assert film_equivalent(film(tmp_path / "c.mov", f"{TAG}=wide")) is None
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 28
    (tmp_path / "d").mkdir()
    Image.new("RGB", (64, 48)).save(tmp_path / "d" / "0.jpg", exif=exif)
    assert film_equivalent(tmp_path / "d") == 28.0
    (tmp_path / "d" / "0.jpg").write_bytes(b"\xff\xd8\xff damaged")
    assert film_equivalent(tmp_path / "d") is None


def load(folder: Path, *, focal: str | None = None, cameras: Path | None = None) -> tuple[float, str]:
    """Focal length over the longer side, and the notes, of two frames of a clip with a tag."""
    clip = film(folder / "a.mov", f"{TAG}=26")
    pixels = np.tile(camera_at(0.0).project(BODY.landmarks(BODY.at(BODY.neutral))) / 10.0, (2, 1, 1))
    track = KeypointTrack("x", BODY.landmark_names, pixels, np.ones(pixels.shape[:2]), (64, 48), 5.0)
    write_keypoints(folder / "a.json", track)
    declared = Declared(focal=focal)
    inputs = load_inputs(BODY, InputFiles(clip, folder / "a.json", cameras, declared=declared))
    return inputs.observations[0].cameras[0].K[0, 0] / 64.0, " ".join(inputs.notes)


def test_the_users_word_goes_before_the_clips(tmp_path: Path) -> None:
    focal, said = load(tmp_path)
    assert focal == pytest.approx(0.721, abs=1e-3)
    assert "by the file (26 mm on 35 mm film)" in said
    focal, said = load(tmp_path, focal="0.9")
    assert focal == pytest.approx(0.9)
    assert "by --focal" in said
    assert "guessed" not in said
    assert 0.67 < PHONES < 0.8
