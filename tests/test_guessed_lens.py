"""The lens of a single camera without a calibration: from the user, the clip's tags, or that of most phones."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

import kinemode as km
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.media.film import ffmpeg_command
from humanoid.support.errors import InputError
from kinemode.inputs.lens import PHONES, lens_of, lens_tags
from kinemode.inputs.load import load_inputs
from kinemode.inputs.phones import checked_phone
from kinemode.request import FileOptions
from tests.builders import body_of, camera_at

BODY = body_of("human34")
MODEL = "com.apple.quicktime.model"
TAG = "com.apple.quicktime.camera.focal_length.35mm_equivalent"


def film(path: Path, *tags: str) -> Path:
    arguments = [word for tag in tags for word in ("-metadata", tag)]
    source = ["-f", "lavfi", "-i", "testsrc=size=64x48:rate=5", "-t", "0.4", "-movflags", "use_metadata_tags"]
    subprocess.run([*ffmpeg_command(), *source, *arguments, str(path)], check=True)
    return path


@pytest.mark.parametrize(("given", "focal"), [("26mm", 0.721), ("28 mm", 0.777), ("1400px", 1400 / 1920), ("0.9", 0.9)])
def test_the_users_value_is_used(given: str, focal: float) -> None:
    """Of 26 and 28 mm phones the calibrations have 0.714 and 0.784."""
    assert lens_of(given, None, 1920.0).focal == pytest.approx(focal, abs=1e-3)


@pytest.mark.parametrize("given", ["", "x", "26cm", "0", "1e9", "nan", "5000"])
def test_invalid_focal_lengths_are_refused(given: str) -> None:
    with pytest.raises(InputError, match=r"--focal: .*is not a focal length .as 26mm"):
        lens_of(given, None, 1920.0)


def test_films_and_pictures_declare_their_lens(tmp_path: Path) -> None:
    assert lens_tags(film(tmp_path / "a.mov", f"{TAG}=26")) == (26.0, None)
    assert lens_tags(film(tmp_path / "b.mov", f"{MODEL}=iPhone 12 Pro")) == (None, "iPhone 12 Pro")
    assert lens_tags(film(tmp_path / "c.mov", f"{TAG}=wide")) == (None, None)
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 28
    exif[ExifTags.Base.Model] = "iPhone XR"
    (tmp_path / "d").mkdir()
    Image.new("RGB", (64, 48)).save(tmp_path / "d" / "0.jpg", exif=exif)
    assert lens_tags(tmp_path / "d") == (28.0, "iPhone XR")
    (tmp_path / "d" / "0.jpg").write_bytes(b"\xff\xd8\xff damaged")
    assert lens_tags(tmp_path / "d") == (None, None)


@pytest.mark.parametrize(
    ("model", "focal"),
    [("iPhone13,3", 0.7136), ("iphone 12 PRO", 0.7136), ("iPhone12,1", 0.7121), ("iPadPro(11-inch) (M4)", 0.7767)],
)
def test_a_phone_has_the_lens_of_its_calibrations(model: str, focal: float) -> None:
    lens = lens_of(None, None, 1920.0, model)
    assert lens.focal == focal
    assert "neither zoomed nor stabilised" in lens.source


def test_every_phone_is_found_by_its_names_and_has_one_lens() -> None:
    table = json.loads(Path(checked_phone.__code__.co_filename).with_name("phone_lenses.json").read_text())["phones"]
    assert len(table) == 112
    for model, (focal, *names) in table.items():
        assert 0.65 < focal < 0.91
        assert checked_phone(model).focal == focal
        assert all(abs(checked_phone(name).focal - focal) < 0.002 for name in names)


@pytest.mark.parametrize(
    ("model", "message"),
    [("iPhone 12 Por", "did you mean iPhone 12 Pro"), ("Pixel 8", r"'Pixel 8' is not known \(Apple's are, as"),
     ("iPhone1,2", "is not known"), ("", "'' is not known")],
)  # fmt: skip
def test_a_phone_that_is_not_known_is_refused_with_near_names(model: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").touch()
    with pytest.raises(InputError, match=f"^--phone: the lens of .*{message}"):
        km.track("human34", None, keypoints=tmp_path / "a.json", phone=model)


def test_a_phone_and_a_focal_length_are_too_much(tmp_path: Path) -> None:
    (tmp_path / "a.json").touch()
    for function in (km.track, km.fit):
        with pytest.raises(InputError, match=r"^--phone: gives the focal length, as --focal does .leave one"):
            function("human34", None, keypoints=tmp_path / "a.json", phone="iPhone X", focal="26mm")


def load(
    folder: Path, *tags: str, focal: str | None = None, phone: str | None = None, cameras: Path | None = None
) -> tuple[float, str]:
    """Focal length over the longer side, and the notes, of two frames of a clip with tags."""
    folder.mkdir(exist_ok=True)
    clip = film(folder / "a.mov", *tags)
    pixels = np.tile(camera_at(0.0).project(BODY.landmarks(BODY.at(BODY.neutral))) / 10.0, (2, 1, 1))
    track = KeypointTrack("x", BODY.landmark_names, pixels, np.ones(pixels.shape[:2]), (64, 48), 5.0)
    write_keypoints(folder / "a.json", track)
    declared = {"focal": focal, "phone": phone}
    inputs = load_inputs(BODY, FileOptions(clip, keypoints=folder / "a.json", cameras=cameras, **declared))
    return inputs.observations[0].cameras[0].K[0, 0] / 64.0, " ".join(inputs.notes)


def test_the_users_value_takes_precedence_over_the_clips(tmp_path: Path) -> None:
    focal, notes = load(tmp_path, f"{TAG}=26", f"{MODEL}=iPhone 12 Pro")
    assert focal == pytest.approx(0.721, abs=1e-3)
    assert "by the file (26 mm on 35 mm film)" in notes
    focal, notes = load(tmp_path / "b", f"{TAG}=26", focal="0.9")
    assert focal == pytest.approx(0.9)
    assert "by --focal" in notes
    assert "guessed" not in notes
    assert 0.67 < PHONES < 0.8


def test_the_phone_named_by_a_film_takes_precedence_over_a_guess(tmp_path: Path) -> None:
    focal, notes = load(tmp_path / "a", f"{MODEL}=iPhone 12 Pro")
    assert focal == pytest.approx(0.7136)
    assert "by the phone that the file names (iPhone 12 Pro: OpenCap's calibration" in notes
    focal, notes = load(tmp_path / "b", f"{MODEL}=Pixel 8")
    assert (focal, "is guessed" in notes) == (pytest.approx(PHONES), True)
    focal, notes = load(tmp_path / "c", f"{MODEL}=iPhone 12 Pro", phone="iPhone XR")
    assert (focal, "by --phone (iPhone XR:" in notes) == (pytest.approx(0.7063), True)
    write_cameras(tmp_path / "cameras.json", [camera_at(0.0)])
    with pytest.raises(InputError, match="--phone: is of a camera that no file describes"):
        load(tmp_path / "d", phone="iPhone XR", cameras=tmp_path / "cameras.json")
