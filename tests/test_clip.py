"""Clips: what is read, when, and what is wrong with it."""

from __future__ import annotations

import os
import re
import struct
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.media.clip import Clip
from estimator.data.media.container import Container, container_of
from estimator.data.media.picture import read_picture
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from humanoid.support.quiet import captured_output
from kinemode.inputs.lens import PHONES
from kinemode.inputs.load import load_inputs
from kinemode.request import FileOptions

COUNT, SIZE = 90, (96, 64)


def picture(i: int) -> np.ndarray:
    """A frame that encodes its number in 7 blocks, black or white."""
    image = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    for bit in range(7):
        image[16:48, 4 + 12 * bit : 14 + 12 * bit] = 255 if i >> bit & 1 else 0
    return image


def number(image: np.ndarray) -> int:
    return sum((int(image[32, 9 + 12 * bit, 1]) > 128) << bit for bit in range(7))


def video(path: Path, code: str, fps: float = 25.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), fps, SIZE)
    for i in range(COUNT):
        writer.write(picture(i))
    writer.release()
    return path


@pytest.mark.parametrize(("name", "code"), [("a.mp4", "mp4v"), ("a.avi", "MJPG"), ("a.webm", "VP80")])
def test_random_access_is_sequential_access(tmp_path: Path, name: str, code: str) -> None:
    clip = Clip.open(video(tmp_path / name, code))
    assert clip.image_size == SIZE
    assert clip.fps == pytest.approx(25.0)
    in_order = list(clip.frames())
    assert [number(f) for f in in_order] == list(range(COUNT))
    for i in (70, 3, 69, 89, 0, 1, 45, 44, 88):
        np.testing.assert_array_equal(clip.frame(i), in_order[i])
    clip.close()
    assert number(clip.frame(50)) == 50
    assert [number(f) for f in clip.frames(85)] == list(range(85, COUNT))
    assert clip.report.complete
    assert clip.report.read == COUNT
    assert not clip.report.notes
    np.testing.assert_allclose(clip.times, np.arange(COUNT) / 25.0, atol=1e-3)
    for i in (-1, COUNT, 10 * COUNT):
        with pytest.raises(IndexError):
            clip.frame(i)


def test_truncated_video_is_reported_and_kept(tmp_path: Path) -> None:
    path = video(tmp_path / "a.avi", "MJPG")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    clip = Clip.open(path)
    read = [number(f) for f in clip.frames()]
    assert 10 < len(read) < COUNT
    assert read == list(range(len(read)))
    if clip.frame_count is not None:  # the index at the end of the file is lost, perhaps the header's count too
        assert clip.report.read == len(read)
        assert not clip.report.complete
        assert f"{len(read)} of {clip.frame_count}" in clip.report.notes[0]


def test_bad_videos(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "text.mp4").write_text("not a video at all\n" * 50)
    good = video(tmp_path / "a.mp4", "mp4v").read_bytes()
    (tmp_path / "headless.mp4").write_bytes(good[: len(good) // 2])
    (tmp_path / "folder").mkdir()
    for name in ("empty.mp4", "text.mp4", "headless.mp4", "folder", "absent.mp4"):
        with pytest.raises(InputError, match=name):
            Clip.open(tmp_path / name)
    with pytest.raises(InputError, match="fps must be"):
        Clip.open(tmp_path / "a.mp4", fps=float("nan"))


def test_frame_times(tmp_path: Path) -> None:
    clip = Clip.open(video(tmp_path / "a.mp4", "mp4v"), fps=50.0)
    np.testing.assert_allclose(clip.times, np.arange(COUNT) / 50.0)
    clip = Clip.open(tmp_path / "a.mp4")
    uneven = np.cumsum([0.0, 0.04, 0.04, 0.12, 0.04]) + 0.5
    times, fps, notes = clip._timing(uneven)  # type: ignore[attr-defined]
    np.testing.assert_allclose(times, uneven - 0.5)
    assert fps == pytest.approx(4 / 0.24)
    assert "varies" in notes[0]
    for stamps in (np.zeros(5), np.array([0.0, 0.1, 0.05, 0.2]), np.arange(5) * 1e-6):
        times, fps, _ = clip._timing(stamps)  # type: ignore[attr-defined]
        np.testing.assert_allclose(times, np.arange(len(stamps)) / 25.0)


def test_folder(tmp_path: Path) -> None:
    for i in (10, 2, 1, 9):
        cv2.imwrite(str(tmp_path / f"f{i}.png"), picture(i))
    (tmp_path / "notes.txt").write_text("not an image")
    clip = Clip.open(tmp_path)
    assert [number(f) for f in clip.frames()] == [1, 2, 9, 10]
    np.testing.assert_array_equal(clip.frame(2), picture(9))
    assert clip.report.read == 4
    assert "30" in clip.report.notes[0]
    assert Clip.open(tmp_path, fps=10.0).times[-1] == pytest.approx(0.3)
    cv2.imwrite(str(tmp_path / "f3.png"), np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(InputError, match=r"f3\.png.*10 x 10"):
        _ = Clip.open(tmp_path).report
    (tmp_path / "f3.png").write_bytes(b"broken")
    with pytest.raises(InputError, match=r"f3\.png"):
        list(Clip.open(tmp_path).frames())


def test_real_clip(shared_data: Path) -> None:
    clip = Clip.open(shared_data / "beam4cam" / "videos" / "cam01.mp4")
    assert clip.image_size == (1080, 1920)
    assert clip.frame_count == 100
    late = clip.frame(60)
    for i, image in enumerate(clip.frames()):
        if i == 60:
            np.testing.assert_array_equal(image, late)
            break


def damaged(data: bytes, *at: int) -> bytes:
    changed = bytearray(data)
    for i in at:
        changed[i] ^= 0x55
    return bytes(changed)


def test_decoders_print_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """They print from C, beside our one line; our notes and errors cover the content."""
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (96, 128, 3), np.uint8), (0, 0), 2.0)
    good = {e: cv2.imencode(f".{e}", image)[1].tobytes() for e in ("png", "jpg", "bmp")}
    good["mp4"] = video(tmp_path / "a.mp4", "mp4v").read_bytes()
    half = {f"half.{e}": data[: len(data) // 2] for e, data in good.items()}
    bad = half | {"header.png": damaged(good["png"], 20), "crc.png": damaged(good["png"], len(good["png"]) // 2)}
    for name, data in bad.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=name):
            read_picture(tmp_path / name) if name != "half.mp4" else Clip.open(tmp_path / name)

    (tmp_path / "clip").mkdir()
    broken = damaged(good["jpg"], *range(700, len(good["jpg"]) - 10, 97))
    for i, data in enumerate((good["jpg"], broken, broken, good["jpg"])):
        (tmp_path / "clip" / f"{i}.jpg").write_bytes(data)
    report = Clip.open(tmp_path / "clip", fps=30.0).report
    assert report.read == 4
    assert report.notes == ("2 images are damaged and only partly decoded, 1.jpg first",)
    (tmp_path / "broken.mp4").write_bytes(damaged(good["mp4"], *range(2000, len(good["mp4"]) // 2, 301)))
    assert Clip.open(tmp_path / "broken.mp4").report.read > 0
    assert capfd.readouterr() == ("", "")


def test_threads_do_not_lose_standard_error(capfd: pytest.CaptureFixture[str]) -> None:
    def worker() -> None:
        for _ in range(50):
            with captured_output() as output:
                os.write(2, b"x")
            assert output == ["x"]

    threads = [threading.Thread(target=worker) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    os.write(2, b"still there")
    assert capfd.readouterr().err == "still there"


def with_edit(path: Path, first: int, last: int) -> Path:
    """The same MP4 with an edit list that shows the frames from `first` to before `last` alone."""
    content = bytearray(path.read_bytes())
    movie, media, edit = (content.find(kind) + 4 for kind in (b"mvhd", b"mdhd", b"elst"))
    (movies,), (medias,) = (struct.unpack_from(">I", content, at) for at in (movie + 12, media + 12))
    struct.pack_into(">Ii", content, edit + 8, round((last - first) / 25.0 * movies), round(first / 25.0 * medias))
    edited = path.with_name("edited.mp4")
    edited.write_bytes(content)
    return edited


@pytest.mark.parametrize(("first", "last"), [(30, COUNT), (0, 55), (20, 61)])
def test_frames_cut_by_an_edit_list_are_not_damage(first: int, last: int, tmp_path: Path) -> None:
    clip = Clip.open(with_edit(video(tmp_path / "a.mp4", "mp4v"), first, last))
    assert clip.report.notes == ()
    assert clip.report.declared is None
    assert number(clip.frame(0)) == first
    assert abs(clip.report.read - (last - first)) <= 1


def test_a_damaged_header_is_ignored(tmp_path: Path) -> None:
    whole = bytearray(with_edit(video(tmp_path / "a.mp4", "mp4v"), 30, COUNT).read_bytes())
    header, rng = whole.find(b"moov"), np.random.default_rng(0)
    for _ in range(300):
        content = whole.copy()
        for at in rng.integers(header - 8, len(content), 12):
            content[at] = rng.integers(256)
        (tmp_path / "b.mp4").write_bytes(content[: rng.integers(header, len(content) + 1)])
        shown = container_of(tmp_path / "b.mp4").shown
        assert shown is None or shown >= 0.0
    (tmp_path / "b.mp4").write_bytes(b"\0\0\0\x10ftypisom\0\0\0\0" + b"\x7f\0\0\0moov" * 30_000)
    assert container_of(tmp_path / "b.mp4").shown is None


def test_an_estimated_frame_count_is_not_damage(tmp_path: Path) -> None:
    """Matroska stores a duration alone; a file that ends earlier is reported."""
    path = video(tmp_path / "a.webm", "VP80")
    clip = Clip.open(path)
    assert (clip.frame_count, clip.report.declared, clip.report.read, clip.report.notes) == (None, None, COUNT, ())
    content = path.read_bytes()
    path.write_bytes(content[: int(0.6 * len(content))])
    (note,) = Clip.open(path).report.notes
    assert re.fullmatch(r"ends early: \d\.\d of 3\.6 declared seconds could be read", note)


def test_a_stream_without_times_has_no_rate_of_its_own(tmp_path: Path) -> None:
    """Whatever FFmpeg assumes; the user's value overrides it."""
    path = tmp_path / "a.mjpeg"
    path.write_bytes(b"".join(cv2.imencode(".jpg", picture(i))[1].tobytes() for i in range(COUNT)))
    clip = Clip.open(path)
    assert (clip.rate_known, clip.fps, clip.report.read) == (False, 30.0, COUNT)
    np.testing.assert_allclose(clip.times, np.arange(COUNT) / 30.0)
    assert clip.report.notes == ("no usable frame rate: 30 assumed; give it with --fps",)
    given = Clip.open(path, fps=50.0)
    assert (given.rate_known, given.report.notes) == (True, ())
    np.testing.assert_allclose(given.times, np.arange(COUNT) / 50.0)


@pytest.mark.parametrize(
    ("start", "timed", "counted"),
    [
        (b"\x00\x00\x00\x01\x67\x64\x00\x1e", False, False),  # H.264
        (b"\x00\x00\x01\x09\x10\x00\x00\x01", False, False),  # H.264 that begins with a delimiter
        (b"\x00\x00\x00\x01\x40\x01\x0c\x01", False, False),  # H.265
        (b"\x00\x00\x01\xba\x44\x00\x04\x00", True, False),  # MPEG program stream
        (b"\x1aE\xdf\xa3\xa3B\x86\x81", True, False),  # Matroska
        (b"RIFF\x10\x00\x00\x00AVI LIST", True, True),
        (b"\x00\x00\x00\x10ftypisom\x00\x00\x00\x00\x00\x00\x10\x00moov", True, True),  # cut short
        (b"", True, False),
    ],
)
def test_container_metadata(start: bytes, timed: bool, counted: bool, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(start)
    assert container_of(tmp_path / "a") == Container(timed=timed, counted=counted)


def with_pixels(path: Path, wide: int, high: int) -> Path:
    """The same MP4, its pixels declared as `wide` to `high` (a box `pasp` at the end of the sample's description)."""
    content = bytearray(path.read_bytes())
    at = content.find(b"mp4v", content.find(b"stsd")) - 4
    end = at + struct.unpack_from(">I", content, at)[0]
    for kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", None):
        size = at if kind is None else content.find(kind) - 4
        struct.pack_into(">I", content, size, struct.unpack_from(">I", content, size)[0] + 16)
    content[end:end] = struct.pack(">I4sII", 16, b"pasp", wide, high)
    changed = path.with_name("pixels.mp4")
    changed.write_bytes(content)
    return changed


@pytest.mark.parametrize(("wide", "high"), [(64, 45), (8, 9), (1, 1)])
def test_pixels_need_not_be_square(wide: int, high: int, tmp_path: Path) -> None:
    path = with_pixels(video(tmp_path / "a.mp4", "mp4v"), wide, high)
    clip = Clip.open(path)
    assert clip.pixel_aspect == pytest.approx(wide / high)
    assert clip.image_size == SIZE
    names = ("nose", "left_shoulder", "right_shoulder", "left_hip", "right_hip", "left_knee")
    pixels = np.tile(np.random.default_rng(0).uniform(10.0, 50.0, (6, 2)), (COUNT, 1, 1))
    track = KeypointTrack("names", names, pixels, np.ones((COUNT, 6)), SIZE, 25.0)
    write_keypoints(tmp_path / "k.json", track)
    inputs = load_inputs(Body(load_subject("human34")), FileOptions({"a": path}, keypoints={"a": tmp_path / "k.json"}))
    (camera,) = inputs.observations[0].cameras
    assert camera.K[1, 1] / camera.K[0, 0] == pytest.approx(wide / high)
    assert camera.K[1, 1] == pytest.approx(PHONES * max(SIZE[0] * wide / high, SIZE[1]))
    assert any("not square" in note for note in inputs.notes) == (wide != high)
