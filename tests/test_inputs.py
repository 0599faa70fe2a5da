"""Inconsistent input: sizes, frame rates, clocks and names are corrected or reported, never assumed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.data.agreement import agreement
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.media.clip import Clip, ClipReport
from estimator.data.media.film import write_film
from estimator.data.timing import CameraClock, at_places, clip_clock, keypoint_clock, timeline
from estimator.vision.resolution import resized_camera, same_aspect
from humanoid.subject.landmarks import COCO17
from humanoid.support.errors import InputError
from kinemode.inputs import cameras as cameras_module, load as load_module
from kinemode.inputs.doubts import likely_offsets
from kinemode.inputs.load import Inputs, load_inputs
from kinemode.request import FileOptions
from tests.builders import body_of, camera_at

SIZE, COUNT, RATE = (160, 120), 60, 30.0
BODY = body_of("human34")


def swinging(time: np.ndarray) -> np.ndarray:
    """Configurations (T, nq) of a body that swings its limbs and sways, at these times [s]."""
    rng = np.random.default_rng(4)
    amplitude, phase = rng.uniform(0.2, 0.6, BODY.nv), rng.uniform(0.0, 6.28, BODY.nv)
    amplitude[:6] = 0.1
    return np.array([BODY.integrate(BODY.neutral, amplitude * np.sin(4.0 * t + phase)) for t in time])


def seen(camera: Camera, time: np.ndarray, fps: float | None = RATE, **changes: Any) -> KeypointTrack:
    """Keypoints of an exact detector at these times; the file declares no size unless `changes` does."""
    pixels = np.array([camera.project(BODY.landmarks(BODY.at(q))) for q in swinging(time)])
    return KeypointTrack("landmarks", BODY.landmark_names, pixels, np.ones(pixels.shape[:2]), fps=fps, **changes)


TIME = np.arange(COUNT) / RATE
CAMERAS = {
    name: replace(resized_camera(camera_at(at), SIZE), name=name)
    for name, at in (("a", 0.0), ("b", 70.0), ("c", 160.0))
}
SEEN = {name: seen(camera, TIME) for name, camera in CAMERAS.items()}


def halved(track: KeypointTrack) -> KeypointTrack:
    return replace(track, pixels=(track.pixels + 0.5) / 2.0 - 0.5)


def later(track: KeypointTrack, frames: int) -> KeypointTrack:
    return replace(track, pixels=track.pixels[frames:], confidence=track.confidence[frames:])


def every(track: KeypointTrack, step: int, fps: float | None) -> KeypointTrack:
    return replace(track, pixels=track.pixels[::step], confidence=track.confidence[::step], fps=fps)


def pictures(folder: Path, count: int = COUNT, size: tuple[int, int] = SIZE) -> Path:
    """A clip as a folder of pictures, whose grey value encodes the frame number."""
    folder.mkdir()
    for i in range(count):
        cv2.imwrite(str(folder / f"{i:03d}.png"), np.full((size[1], size[0]), i, np.uint8))
    return folder


@pytest.fixture(scope="module")
def folder_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pictures(tmp_path_factory.mktemp("clips") / "a")


def files(folder: Path, tracks: dict[str, KeypointTrack]) -> dict[str, Path]:
    folder.mkdir(exist_ok=True)
    for name, track in tracks.items():
        write_keypoints(folder / f"{name}.json", track)
    return {name: folder / f"{name}.json" for name in tracks}


def load(folder: Path, tracks: dict[str, KeypointTrack], clips: Any = None, **options: Any) -> Inputs:
    return load_inputs(BODY, FileOptions(clips, keypoints=files(folder / "k", tracks), cameras=CAMERAS, **options))


def test_every_file_is_opened_once(tmp_path: Path, folder_clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    def counted(function: Any) -> Any:
        return lambda path, **how: (opened.append(Path(path).name), function(path, **how))[1]

    monkeypatch.setattr(Clip, "open", staticmethod(counted(Clip.open)))
    monkeypatch.setattr(cameras_module, "load_cameras", counted(cameras_module.load_cameras))
    monkeypatch.setattr(load_module, "load_people", counted(load_module.load_people))
    write_cameras(tmp_path / "c.json", list(CAMERAS.values()))
    tracks = files(tmp_path / "k", {"a": every(SEEN["a"], 2, 15.0)})
    load_inputs(BODY, FileOptions({"a": folder_clip}, keypoints=tracks, cameras=tmp_path / "c.json", fps="a=30"))
    assert sorted(opened) == ["a", "a", "a.json", "c.json"]  # the clip a second time, at the given rate


def stacked(inputs: Inputs) -> np.ndarray:
    return np.array([o.pixels for o in inputs.observations])


def has_note(inputs: Inputs, text: str) -> bool:
    return any(text in note for note in inputs.notes)


def test_what_agrees_is_taken_as_it_is(tmp_path: Path) -> None:
    inputs = load(tmp_path, SEEN)
    assert inputs.notes == ()
    np.testing.assert_array_equal(inputs.times, TIME)
    np.testing.assert_array_equal(stacked(inputs), np.stack([t.pixels for t in SEEN.values()], axis=1))


def test_declared_sizes_are_scaled_with_a_note(tmp_path: Path) -> None:
    declared = {name: replace(halved(track), image_size=(80, 60)) for name, track in SEEN.items()}
    without_size = {name: halved(track) for name, track in SEEN.items()}
    expected = stacked(load(tmp_path, SEEN))
    sizes = {"b": (80, 60), "a": "80x60", "c": "80x60"}
    for tracks, more in (
        (declared, {}),
        (without_size, {"keypoint_size": "80x60"}),
        (without_size, {"keypoint_size": sizes}),
    ):
        inputs = load(tmp_path, tracks, **more)
        np.testing.assert_allclose(stacked(inputs), expected, atol=1e-9)
        assert sum("80 x 60 are scaled to 160 x 120" in note for note in inputs.notes) == 3
    with pytest.raises(InputError, match=r"declares pictures of 80 x 60, --keypoint-size has 160 x 120"):
        load(tmp_path, declared, keypoint_size=SIZE)
    alone = load_inputs(
        BODY, FileOptions(None, keypoints=files(tmp_path, {"a": without_size["a"]}), keypoint_size=(80, 60))
    )
    assert alone.observations[0].cameras[0].image_size == (80, 60)
    with pytest.raises(InputError, match=r"disagree: keypoints 80 x 80"):
        load(tmp_path, {"a": replace(SEEN["a"], image_size=(80, 80))})
    for wrong in ("80", "80x", (80,), "0x4", "d=80x60", (float("inf"), 60), 7, ["a=80x60", "a=60x80"]):
        with pytest.raises(InputError, match="--keypoint-size"):
            load(tmp_path, SEEN, keypoint_size=wrong)


def yolo(track: KeypointTrack, size: tuple[float, float]) -> list[Any]:
    """COCO's points of a track in every frame, as Ultralytics writes them in fractions of a picture."""
    kept = [track.names.index(name) for name in COCO17]
    fractions = track.pixels[:, kept] / size
    return [[{"keypoints": {"x": f[:, 0].tolist(), "y": f[:, 1].tolist(), "visible": [0.9] * 17}}] for f in fractions]


def test_fractions_of_a_picture_become_pixels_of_the_camera_or_of_the_given_size(tmp_path: Path) -> None:
    for name, size in (("pixels", (1.0, 1.0)), ("fractions", (160.0, 120.0))):
        (tmp_path / f"{name}.json").write_text(json.dumps(yolo(SEEN["a"], size)))

    def read(name: str, with_cameras: bool, size: str | None = None) -> Inputs:
        declared = {"fps": RATE, "keypoint_size": size}
        keypoints = {"a": tmp_path / f"{name}.json"}
        return load_inputs(
            BODY,
            FileOptions(None, keypoints=keypoints, cameras={"a": CAMERAS["a"]} if with_cameras else None, **declared),
        )

    expected = stacked(read("pixels", True))
    np.testing.assert_allclose(stacked(read("fractions", True)), expected, atol=1e-9)
    np.testing.assert_allclose(stacked(read("fractions", False, "160x120")), expected, atol=1e-9)
    with pytest.raises(InputError, match="keypoint-size"):
        read("fractions", False)


def test_the_noise_of_keypoints_is_given_in_pixels_by_camera(tmp_path: Path) -> None:
    few = {name: replace(t, pixels=t.pixels[:8], confidence=t.confidence[:8]) for name, t in SEEN.items()}
    assert load(tmp_path, few).noise == ()
    assert load(tmp_path, few, keypoint_noise="4").noise == (4.0, 4.0, 4.0)
    np.testing.assert_array_equal(load(tmp_path, few, keypoint_noise=["b=2.5"]).noise, [np.nan, 2.5, np.nan])
    for wrong in ("0", "-1", "a=b", "d=3", "inf"):
        with pytest.raises(InputError, match="--keypoint-noise"):
            load(tmp_path, few, keypoint_noise=wrong)


def test_undeclared_sizes_are_noticed(tmp_path: Path) -> None:
    doubled = replace(SEEN["a"], pixels=SEEN["a"].pixels * 4.0)
    with pytest.raises(InputError, match=r"outside the picture of 160 x 120.*--keypoint-size"):
        load(tmp_path, {"a": doubled})
    assert has_note(load(tmp_path, {"a": halved(SEEN["a"])}), "--keypoint-size 80x60")
    some = SEEN["a"].pixels.copy()
    some[:12] += 1000.0
    assert has_note(load(tmp_path, {"a": replace(SEEN["a"], pixels=some)}), "20% of the keypoints lie outside")
    assert load(tmp_path, {"a": SEEN["a"]}).notes == ()


@pytest.mark.parametrize("factor", [2 / 3, 1.5])
def test_cameras_that_only_another_size_reconciles_are_refused(tmp_path: Path, factor: float) -> None:
    scaled = {name: replace(t, pixels=(t.pixels + 0.5) * factor - 0.5) for name, t in SEEN.items()}
    size = f"{round(160 * factor)}x{round(120 * factor)}"
    with pytest.raises(InputError, match=f"--keypoint-size {size}"):
        load(tmp_path, scaled)
    odd = {**{name: replace(t, image_size=SIZE) for name, t in SEEN.items()}, "b": scaled["b"]}
    with pytest.raises(InputError, match=f"--keypoint-size b={size}"):
        load(tmp_path, odd)
    wrong = {name: replace(t, image_size=SIZE) for name, t in scaled.items()}
    assert has_note(load(tmp_path, wrong), "are the sizes that are declared")


def test_a_calibration_of_another_size_is_scaled(tmp_path: Path, folder_clip: Path) -> None:
    write_cameras(tmp_path / "c.json", [resized_camera(CAMERAS["a"], (320, 240))])
    keypoints = files(tmp_path, {"a": SEEN["a"]})
    inputs = load_inputs(BODY, FileOptions({"a": folder_clip}, keypoints=keypoints, cameras=tmp_path / "c.json"))
    np.testing.assert_allclose(inputs.observations[0].cameras[0].K, CAMERAS["a"].K, atol=1e-9)
    assert has_note(inputs, "calibrated at 320 x 240, scaled to 160 x 120")
    write_cameras(tmp_path / "c.json", [replace(CAMERAS["a"], image_size=(160, 100))])
    with pytest.raises(InputError, match=r"c\.json: image sizes of 'a' disagree: camera 160 x 100, pictures 160 x 120"):
        load_inputs(BODY, FileOptions({"a": folder_clip}, keypoints=keypoints, cameras=tmp_path / "c.json"))


def test_aspects() -> None:
    for size, other in (((1920, 1080), (854, 480)), ((1080, 1920), (480, 854)), ((640, 480), (160, 120))):
        assert same_aspect(size, other)
        assert same_aspect(other, size)
    assert not same_aspect((1088, 1920), (1080, 1920))
    assert not same_aspect((640, 480), (480, 640))


def test_keypoints_of_another_rate_are_matched_by_time(tmp_path: Path, folder_clip: Path) -> None:
    full = seen(CAMERAS["a"], TIME)
    expected = full.pixels
    slow = load(tmp_path, {"a": every(full, 2, 15.0)}, {"a": folder_clip}, fps=RATE)
    assert has_note(slow, "keypoints at 15 frames per second, the clip at 30: matched by time")
    pixels = stacked(slow)[:, 0]
    np.testing.assert_array_equal(pixels[::2], expected[::2])
    middle = (expected[:-2:2] + expected[2::2]) / 2.0
    np.testing.assert_allclose(pixels[1:-1:2], middle, atol=1e-9)
    assert np.isnan(pixels[-1]).all()  # no keypoint comes later
    without_size = load(tmp_path, {"a": every(full, 2, None)}, {"a": folder_clip}, fps=RATE)
    assert has_note(without_size, "keypoints end after 30 of 60 frames; if they are of every 2nd frame")
    assert has_note(without_size, "write their fps into the keypoint file")
    assert has_note(load(tmp_path, {"a": every(full, 2, 15.0)}, {"a": folder_clip}), "the pictures' rate: --fps a=RATE")
    copied = load(tmp_path, {"a": every(full, 2, RATE)}, {"a": folder_clip}, fps=RATE)
    assert has_note(copied, "correct fps in the keypoint file")
    fast = load(tmp_path, {"a": seen(CAMERAS["a"], np.arange(2 * COUNT) / 60.0, 60.0)}, {"a": folder_clip}, fps=RATE)
    np.testing.assert_allclose(stacked(fast)[:, 0], expected, atol=1e-9)
    double = load(tmp_path, {"a": seen(CAMERAS["a"], np.arange(2 * COUNT) / 60.0, None)}, {"a": folder_clip}, fps=RATE)
    assert has_note(double, "only the first 60 are used; if the clip has every 2nd of these")


def test_pictures_without_a_rate_take_the_keypoints_rate(tmp_path: Path, folder_clip: Path) -> None:
    inputs = load(tmp_path, {"a": replace(SEEN["a"], fps=60.0)}, {"a": folder_clip})
    np.testing.assert_allclose(inputs.times, np.arange(COUNT) / 60.0)
    assert has_note(inputs, "the pictures have no frame rate: 60, as")
    both = load(tmp_path, {"a": replace(SEEN["a"], fps=60.0)}, {"a": folder_clip}, fps="a=30")
    np.testing.assert_allclose(both.times, TIME)  # as many keypoints as pictures are the pictures' own
    np.testing.assert_array_equal(stacked(both)[:, 0], SEEN["a"].pixels)
    assert has_note(both, "both have 60 frames: frame by frame, at the clip's rate")
    with pytest.raises(InputError, match="declare their frame rates"):
        load(tmp_path, {"a": SEEN["a"]}, fps=25.0)
    with pytest.raises(InputError, match="no camera 'z'"):
        load(tmp_path, {"a": SEEN["a"]}, fps="z=25")
    assert has_note(load(tmp_path, {"a": replace(SEEN["a"], fps=None)}), "30 frames per second assumed")
    assert load(tmp_path, {"a": replace(SEEN["a"], fps=None)}, fps=25.0).times[1] == pytest.approx(0.04)


def test_cameras_with_offsets_share_a_clock(tmp_path: Path) -> None:
    shifted = {"a": SEEN["a"], "b": later(SEEN["b"], 4), "c": SEEN["c"]}
    inputs = load(tmp_path, shifted, offset={"b": 4 / RATE})
    assert inputs.times[0] == pytest.approx(4 / RATE)
    expected = np.stack([track.pixels[4:] for track in SEEN.values()], axis=1)
    np.testing.assert_allclose(stacked(inputs), expected, atol=1e-9)
    assert has_note(inputs, "56 instants from 0.13 to 1.97 s")
    assert not has_note(inputs, "--offset")
    without_size = load(tmp_path, shifted)
    assert has_note(without_size, "--offset b=0.13")
    for wrong, why in (("0.1", "no camera"), ("z=1", "no camera 'z'"), ("b=x", "--offset"), ("b=900", "never run at")):
        with pytest.raises(InputError, match=why):
            load(tmp_path, shifted, offset=wrong)


def test_cameras_of_different_rates(tmp_path: Path, folder_clip: Path) -> None:
    half = pictures(tmp_path / "b", COUNT // 2)
    tracks = {"a": SEEN["a"], "b": every(SEEN["b"], 2, 15.0)}
    inputs = load(tmp_path, tracks, {"a": folder_clip, "b": half}, fps=["a=30", "b=15"], offset="b=0.21")
    assert has_note(inputs, "a 30 from 0 s, b 15 from 0.21 s")
    np.testing.assert_allclose(inputs.times, TIME[6:])
    assert inputs.frames[0] is not None
    assert inputs.frames[1] is not None
    np.testing.assert_array_equal(inputs.frames[0], np.arange(6, COUNT))
    np.testing.assert_array_equal(inputs.frames[1][:6], [0, 0, 1, 1, 2, 2])
    between = 0.65 * tracks["b"].pixels[1] + 0.35 * tracks["b"].pixels[2]  # at 0.3 s, 0.09 s after it began
    np.testing.assert_allclose(inputs.observations[3].pixels[1], between, atol=1e-6)


def test_a_part_of_the_clip(tmp_path: Path, folder_clip: Path) -> None:
    whole = load(tmp_path, {"a": SEEN["a"]}, {"a": folder_clip})
    part = load(tmp_path, {"a": SEEN["a"]}, {"a": folder_clip}, start=0.5, end=1.0)
    np.testing.assert_allclose(part.times, TIME[15:31])
    np.testing.assert_array_equal(stacked(part), stacked(whole)[15:31])
    np.testing.assert_array_equal(part.frames[0], np.arange(15, 31))
    assert [o.index for o in part.observations] == list(range(16))
    assert part.observations[0].jitter == whole.observations[0].jitter
    for wrong in ({"start": 1.0, "end": 0.5}, {"start": 5.0}, {"end": -1.0}, {"start": float("nan")}, {"end": "late"}):
        with pytest.raises(InputError, match=r"--start|--end"):
            load(tmp_path, {"a": SEEN["a"]}, **wrong)


def test_interpolation_ends_at_gaps() -> None:
    track = KeypointTrack("x", ("nose",), np.array([[[0.0, 0.0]], [[1.0, 2.0]], [[np.nan] * 2], [[3.0, 6.0]]]),
                          np.array([[1.0], [0.4], [0.0], [1.0]]))  # fmt: skip
    times = np.arange(4) / 30.0
    placed = at_places(track, np.array([0.25, 1.0, 1.5, 2.5, 3.0, np.nan]), times)
    np.testing.assert_allclose(placed.pixels[:, 0, 0], [0.25, 1.0, np.nan, np.nan, 3.0, np.nan])
    np.testing.assert_allclose(placed.confidence[:, 0], [0.4, 0.4, 0.0, 0.0, 1.0, 0.0])
    assert np.isnan(at_places(track, np.array([0.5, 1.0]), times * 10.0).pixels[0]).all()
    assert at_places(track, np.arange(4.0), times) is track


def test_clocks() -> None:
    report = ClipReport(90, 90, np.arange(90) / 29.97, 29.97, ())
    track = KeypointTrack("x", ("nose",), np.zeros((90, 1, 2)), np.ones((90, 1)))
    for rate in (None, 30.0):
        clock, notes = clip_clock("a", track, report, rate)
        assert (clock.frame_by_frame, notes) == (True, ())
    several = {"a": keypoint_clock(90, 30.0), "b": keypoint_clock(88, 29.97)}
    line = timeline(several)  # never half a frame apart
    np.testing.assert_array_equal(line.times, several["a"].keypoints)
    np.testing.assert_array_equal(line.places["b"][:88], np.arange(88))
    assert np.isnan(line.places["b"][88:]).all()
    apart = timeline({"a": keypoint_clock(3000, 30.0), "b": keypoint_clock(3000, 29.7)})
    assert (
        np.nanmax(np.abs(apart.places["b"] / 29.7 - apart.times)) < 0.02 / 29.7 + 1e-9
    )  # by time: else 1 s at the end
    empty = CameraClock(TIME, TIME, RATE, 100.0)
    with pytest.raises(InputError, match="never run at the same time"):
        timeline({"a": keypoint_clock(90, 30.0), "b": empty})


def test_names_that_match_nothing(tmp_path: Path, folder_clip: Path) -> None:
    keypoints = files(tmp_path, {"other": SEEN["a"]})["other"]
    write_cameras(tmp_path / "c.json", [CAMERAS["a"]])

    def loaded(clip: str, points: str, cameras: Path | None = None) -> Inputs:
        return load_inputs(BODY, FileOptions(clip, keypoints=points, cameras=cameras))

    inputs = loaded(str(folder_clip), str(keypoints))
    assert has_note(inputs, f"the keypoints {keypoints} are used for the clip {folder_clip}")
    assert not has_note(loaded(str(folder_clip), f"a={keypoints}"), "are treated as")
    for wrong in (f"b={keypoints}", {"b": keypoints}):
        with pytest.raises(InputError, match="no clip 'b' for this keypoint file"):
            load_inputs(BODY, FileOptions(str(folder_clip), keypoints=wrong, cameras=None))
    with pytest.raises(InputError, match="no clip 'b' for this keypoint file"):
        load_inputs(BODY, FileOptions(str(folder_clip), keypoints=[f"b={keypoints}"], cameras=None))
    assert has_note(loaded(None, str(keypoints), tmp_path / "c.json"), "the camera 'a' of")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no camera 'b'"):
        loaded(None, f"b={keypoints}", tmp_path / "c.json")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no camera 'b'"):
        loaded(f"b={folder_clip}", f"b={keypoints}", tmp_path / "c.json")


@pytest.mark.parametrize("seed", [2, 5, 8, 9])
def test_another_person_in_every_camera_is_not_another_size(seed: int, tmp_path: Path) -> None:
    """Any pose fits better when scaled down: distances count at the size at which they were found."""
    rng, tracks = np.random.default_rng(seed), {}
    for name, camera in CAMERAS.items():
        q = swinging(TIME)
        q[:, :3] += rng.uniform(-1.2, 1.2, 3)
        pixels = np.array([camera.project(BODY.landmarks(BODY.at(pose))) for pose in q])
        tracks[name] = replace(SEEN[name], pixels=pixels, image_size=SIZE)
    inputs = load(tmp_path, tracks)
    assert has_note(inputs, "the keypoints of the cameras do not fit each other")
    assert has_note(inputs, "and the person right?")


def test_the_real_clip_fits_itself(shared_data: Path) -> None:
    folder = shared_data / "beam4cam"
    keypoints = {name: folder / "keypoints" / f"{name}.json" for name in ("cam01", "cam02", "cam03", "cam04")}
    inputs = load_inputs(BODY, FileOptions(None, keypoints=keypoints, cameras=folder / "calibration.json"))
    assert inputs.notes == ()
    assert all(frames is None for frames in inputs.frames)
    cameras, pixels = inputs.observations[0].cameras, stacked(inputs)
    late = pixels[:94].copy()
    late[:, 1] = pixels[6:, 1]
    assert likely_offsets(cameras, pixels, inputs.times) == ()
    np.testing.assert_allclose(likely_offsets(cameras, late, inputs.times[:94]), (0.0, 0.1, 0.0, 0.0), atol=0.02)
    half = agreement(cameras, (pixels + 0.5) / 2.0 - 0.5, [True] * 4)
    assert half is not None
    assert half.factor == 2.0


def test_a_file_of_every_second_frame_may_number_them(tmp_path: Path, folder_clip: Path) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    for i in range(0, COUNT, 2):
        flat = [v for point in SEEN["a"].pixels[i][:17].tolist() for v in (*point, 1.0)]
        (folder / f"a_{i:06d}_keypoints.json").write_text(json.dumps({"people": [{"pose_keypoints_2d": flat}]}))
    inputs = load_inputs(BODY, FileOptions({"a": folder_clip}, keypoints={"a": folder}, cameras=CAMERAS))
    assert [o.count > 0 for o in inputs.observations] == [i % 2 == 0 for i in range(COUNT)]


def test_a_video_beside_keypoints_without_a_rate(tmp_path: Path) -> None:
    video = write_film(tmp_path / "a.mp4", [np.full((SIZE[1], SIZE[0], 3), i, np.uint8) for i in range(COUNT)], RATE)
    half = {"a": every(SEEN["a"], 2, None)}
    assert has_note(load(tmp_path, half, {"a": video}), "give the keypoints' rate: --fps a=RATE")
    inputs = load(tmp_path, half, {"a": video}, fps="a=15")
    assert has_note(inputs, "matched by time")
    np.testing.assert_array_equal(stacked(inputs)[::2, 0], SEEN["a"].pixels[::2])
    thirds = {"a": replace(later(SEEN["a"], 5), fps=None)}  # cut short, but no fraction of the clip
    assert load(tmp_path, thirds, {"a": video}).notes == ("a: keypoints end after 55 of 60 frames",)
    assert load(tmp_path, {"a": SEEN["a"]}, {"a": video}, fps=RATE).notes == ()  # the declared rate


@pytest.mark.parametrize(("declared", "rate"), [(None, 120.0), (RATE, 240.0), (None, 12.0)])
def test_slow_motion_has_the_rate_that_is_given(tmp_path: Path, declared: float | None, rate: float) -> None:
    """A film saved at another rate than it was taken at, its keypoints without a rate or with the film's."""
    video = write_film(tmp_path / "a.mp4", [np.full((SIZE[1], SIZE[0], 3), i, np.uint8) for i in range(COUNT)], RATE)
    inputs = load(tmp_path, {"a": replace(SEEN["a"], fps=declared)}, {"a": video}, fps=f"a={rate:g}")
    np.testing.assert_allclose(inputs.times, np.arange(COUNT) / rate)
    np.testing.assert_array_equal(stacked(inputs)[:, 0], SEEN["a"].pixels)
    assert inputs.notes == (f"a: the film has 30 frames per second: {rate:g} is used instead, as given with --fps",)
    half = load(tmp_path, {"a": every(SEEN["a"], 2, RATE / 2.0)}, {"a": video}, fps=4.0 * RATE)
    np.testing.assert_allclose(half.times, np.arange(COUNT) / (4.0 * RATE))
    np.testing.assert_array_equal(stacked(half)[::2, 0], SEEN["a"].pixels[::2])  # 15 a second of the film's
