"""Keypoint files: every layout gives the same person, and every fault is named with its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.data.cameras.camera import guessed_camera
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, write_keypoints
from estimator.data.formats.keypoints_reading import LAYOUT_BY_COUNT
from estimator.data.sequence import assemble, keypoint_jitter
from estimator.data.timing import length_notes
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import COCO17, FORMATS, landmark_name, landmark_spread, mirror_index
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError

FRAMES = 6


def person(layout: str, frame: int, offset: float = 0.0, scale: float = 1.0) -> np.ndarray:
    """Keypoints (J, 3); a landmark lies at the same place in every layout."""
    rows = []
    for j, name in enumerate(FORMATS[layout]):
        seed = sum(map(ord, name)) if name else 1000 + j
        rows.append([100 + scale * (seed * 37 % 200) + offset + 3 * frame, 100 + scale * (seed * 91 % 300), 0.9])
    return np.array(rows)


def openpose(folder: Path, frames: dict[int, list[np.ndarray]], stem: str = "clip_{:012d}_keypoints") -> Path:
    folder.mkdir(exist_ok=True)
    for number, people in frames.items():
        listed = [{"person_id": [-1], "pose_keypoints_2d": p.ravel().tolist(), "face_keypoints_2d": []} for p in people]
        (folder / f"{stem.format(number)}.json").write_text(json.dumps({"version": 1.3, "people": listed}))
    return folder


def assert_is(track: KeypointTrack, layout: str, frames: int = FRAMES) -> None:
    assert track.layout == layout
    assert track.names == FORMATS[layout]
    assert track.frame_count == frames
    for t in range(frames):
        np.testing.assert_allclose(track.pixels[t], person(layout, t)[:, :2])
    assert np.ptp(track.confidence) == 0.0


@pytest.mark.parametrize("layout", FORMATS)
def test_every_layout_in_every_file(tmp_path: Path, layout: str) -> None:
    people = [person(layout, t) for t in range(FRAMES)]
    declared = (
        "auto" if LAYOUT_BY_COUNT[3 * len(FORMATS[layout])] == layout else layout
    )  # the rarer of two of one count
    for folder, names in (("a", "clip_{:012d}_keypoints"), ("cam1_json", "cam1_{:06d}")):
        written = openpose(tmp_path / folder, {t: [p] for t, p in enumerate(people)}, names)
        assert_is(load_keypoints(written, layout=declared), layout)
    alpha = [
        {"image_id": f"{t}.jpg", "category_id": 1, "keypoints": p.ravel().tolist(), "score": 2.9, "idx": [1.0]}
        for t, p in enumerate(people)
    ]
    instances = [
        {"frame_id": t + 1, "instances": [{"keypoints": p[:, :2].tolist(), "keypoint_scores": p[:, 2].tolist()}]}
        for t, p in enumerate(people)
    ]
    contents: list[Any] = [
        {
            "format": layout,
            "image_size": [640, 480],
            "fps": 60.0,
            "frames": [{"keypoints": p.tolist()} for p in people],
        },
        alpha,
        {f"{t}.jpg": {"version": 0.1, "bodies": [{"joints": p.ravel().tolist()}]} for t, p in enumerate(people)},
        {"meta_info": {}, "instance_info": instances},
        [i | {"frame_id": t} for t, i in enumerate(instances)],
    ]
    for content in contents:
        (tmp_path / "a.json").write_text(json.dumps(content))
        assert_is(load_keypoints(tmp_path / "a.json", layout=declared), layout)
    track = load_keypoints(tmp_path / "a.json", layout=layout)
    write_keypoints(tmp_path / "b.json", track)
    again = load_keypoints(tmp_path / "b.json")
    np.testing.assert_array_equal(again.pixels, track.pixels)
    np.testing.assert_array_equal(again.confidence, track.confidence)


def test_missing_frames_points_and_confidences(tmp_path: Path) -> None:
    p = person("body25", 0)
    p[3] = 0.0  # OpenPose's missing point
    p[4, 2], p[5, 2] = 3.5, -0.01
    p[6, :2] = np.nan
    track = load_keypoints(openpose(tmp_path / "a", {2: [p], 3: [], 5: [person("body25", 5)]}))
    assert track.frame_count == 6
    seen = (track.confidence > 0).any(axis=1)
    np.testing.assert_array_equal(seen, [False, False, True, False, False, True])
    np.testing.assert_array_equal(np.isnan(track.pixels).any(axis=2), track.confidence == 0.0)
    assert (track.confidence[2, [3, 5, 6]] == 0.0).all()
    assert track.confidence[2, 4] == 1.0
    text = " ".join(track.notes)
    assert "above 1" in text
    assert "negative" in text
    assert "begin at 2" in text
    assert load_keypoints(tmp_path / "a", first=2).frame_count == 4


def test_the_subject_is_followed_through_changes_of_order(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    frames = {}
    for t in range(40):
        both = [person("coco17", t), person("coco17", -t, offset=260.0, scale=0.4)]
        if t in (10, 11, 30):
            both = both[1:]  # the subject is not detected
        frames[t] = [both[i] for i in rng.permutation(len(both))]
    track = load_keypoints(openpose(tmp_path / "a", frames))
    for t in range(40):
        if t in (10, 11, 30):
            assert np.isnan(track.pixels[t]).all()
        else:
            np.testing.assert_allclose(track.pixels[t], person("coco17", t)[:, :2])
    other = load_keypoints(tmp_path / "a", person=1)
    np.testing.assert_allclose(other.pixels[30], person("coco17", -30, offset=260.0, scale=0.4)[:, :2])
    with pytest.raises(InputError, match=r"no person 2.*0.*to 1"):
        load_keypoints(tmp_path / "a", person=2)


def test_person_by_id(tmp_path: Path) -> None:
    listed = [
        {
            "image_id": f"{t}.jpg",
            "keypoints": person("halpe26", t, 50.0 * k).ravel().tolist(),
            "score": 1.0,
            "idx": 4 + k,
        }
        for t in range(3)
        for k in ((0, 1) if t % 2 else (1, 0))
    ]
    (tmp_path / "a.json").write_text(json.dumps(listed))
    for k in (0, 1):
        track = load_keypoints(tmp_path / "a.json", person=4 + k)
        np.testing.assert_allclose(track.pixels[:, 0, 0], [person("halpe26", t, 50.0 * k)[0, 0] for t in range(3)])
    with pytest.raises(InputError, match="ids in it: 4, 5"):
        load_keypoints(tmp_path / "a.json", person=0)


GOOD = [[10.0 * j, 5.0 * j, 0.5] for j in range(17)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        ('{"frames": [\n{]}', "line 2"),
        ("{}", "known layout"),
        ("[]", "no detection"),
        ("3", "known layout"),
        ({"frames": [None, None]}, "no person"),
        ({"frames": [{"points": []}]}, r"frame 0: the member 'points' is unknown .did you mean keypoints"),
        ({"frames": [None, {"keypoints": GOOD[:5]}]}, "frame 1, person 0: 15 numbers fit no layout"),
        ({"format": "coco17", "frames": [{"keypoints": GOOD + GOOD[:1]}]}, "frame 0, person 0: coco17 has 51"),
        ({"frames": [{"keypoints": [*GOOD[:16], [1.0, "x", 0.5]]}]}, "frame 0, person 0.*found text"),
        ({"frames": [{"keypoints": [*GOOD[:16], [1.0, float("inf"), 0.5]]}]}, "person 0, keypoint 16.*not finite"),
        ({"frames": [{"keypoints": [*GOOD[:16], [1.0, float("nan"), 0.5]]}]}, "person 0, keypoint 16.*not finite"),
        ({"frames": [{"keypoints": [*GOOD[:16], [1.0]]}]}, "frame 0, person 0.*differ in length"),
        ({"frames": [{"keypoints": (np.array(GOOD) / 1000).tolist()}]}, "fractions of the image"),
        ({"frames": [{"keypoints": GOOD}], "image_size": [0, 3]}, "image_size"),
        ({"frames": [{"keypoints": GOOD}], "fps": -1}, "fps"),
        ([{"image_id": "a.jpg"}], r"entry 0 \(frame 0\)\.keypoints: is missing"),
        ([{"image_id": "1.jpg", "keypoints": []}, {"image_id": "x.jpg"}], "x.jpg: has no frame number"),
        ([{"frame_id": 0, "instances": [{"keypoints": [[1, 2]], "keypoint_scores": []}]}], "frame 0, person 0"),
        ({"people": [{"pose_keypoints_2d": "text"}]}, "person 0"),
        ({"people": 3}, "people"),
    ],
)
def test_faults_name_their_place(tmp_path: Path, content: Any, message: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError, match=message) as caught:
        load_keypoints(path)
    assert caught.value.source == str(path)


def test_faulty_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no \.json file"):
        load_keypoints(tmp_path)
    folder = openpose(tmp_path / "a", {0: [person("coco17", 0)], 1: [person("coco18", 1)]})
    with pytest.raises(InputError, match=r"_000000000001_keypoints\.json: frame 1, person 0: coco17 has 51"):
        load_keypoints(folder)
    with pytest.raises(InputError, match="one of auto, mediapipe33"):
        load_keypoints(folder, layout="coco")
    openpose(folder, {1: [person("coco17", 0)]})
    openpose(folder, {0: [person("coco17", 0)]}, "other_{:03d}")
    with pytest.raises(InputError, match="is frame 0, and so is"):
        load_keypoints(folder)


def test_observations_are_in_the_bodys_order(tmp_path: Path) -> None:
    body = Body(load_subject("human34"))
    cameras = {name: guessed_camera(name, (640, 480)) for name in ("a", "b")}
    times = np.arange(5) / 30.0
    layouts = {"a": "body25", "b": "coco17"}
    tracks = {
        name: load_keypoints(
            openpose(tmp_path / name, {t: [person(layouts[name], t)] for t in range(3 + 3 * (name == "a"))})
        )
        for name in layouts
    }
    observations = assemble(body, tracks, cameras, times)
    assert [o.index for o in observations] == list(range(5))
    assert observations[3].time == times[3]
    for c, layout in enumerate(layouts.values()):
        for i, landmark in enumerate(body.landmark_names):
            pixel = observations[1].pixels[c, i]
            if landmark in FORMATS[layout]:
                np.testing.assert_allclose(pixel, person(layout, 1)[FORMATS[layout].index(landmark), :2])
            else:
                assert np.isnan(pixel).all()
                assert observations[1].confidence[c, i] == 0.0
    assert observations[4].count == int((observations[4].confidence[0] > 0).sum()) > 0  # b is over
    assert [note.split(":")[0] for note in length_notes(tracks, 5)] == ["a", "b"]
    with pytest.raises(InputError, match=r"no camera 'b'.*cameras: a"):
        assemble(body, tracks, {"a": cameras["a"]}, times)
    with pytest.raises(InputError, match="camera 640 x 480, clip 64 x 48"):
        assemble(body, tracks, cameras, times, clip_sizes={"b": (64, 48)})
    foreign = KeypointTrack("hand", ("left_index", None, "nose"), np.zeros((5, 3, 2)), np.ones((5, 3)))
    with pytest.raises(InputError, match=r"subject: nose, .*; hand: left_index, nose"):
        assemble(body, {"a": foreign}, cameras, times)


def test_landmark_tables() -> None:
    known = {name for format in FORMATS.values() for name in format if name}
    for layout, names in FORMATS.items():
        used = [name for name in names if name]
        assert len(used) == len(set(used)), layout
        mirror = mirror_index(used)
        np.testing.assert_array_equal(mirror[mirror], np.arange(len(used)))
        assert [used[i] for i in mirror][used.index("left_knee")] == "right_knee"
        assert used[mirror[used.index("nose")]] == "nose"
        assert {n for n in COCO17 if not n.endswith(("eye", "ear"))} <= set(used)
    for name in ("human34", "arm8", "upper13"):
        assert {landmark.name for landmark in load_subject(name).landmarks} <= known
    np.testing.assert_allclose(
        landmark_spread(["nose", "left_hip", "right_eye", "left_wrist"]), [0.26, 1.07, 0.25, 0.62]
    )
    meant = {"RBigToe": "right_big_toe", "left_foot_index": "left_big_toe", "LAnkle": "left_ankle",
             "Hip": "mid_hip",
             "Head": "head_top", "RHip": "right_hip", "MidHip": "mid_hip",
             "mouth_left": None, "R_Knee": "right_knee"}  # fmt: skip
    assert {name: landmark_name(name) for name in meant} == meant


def test_real_keypoints(shared_data: Path) -> None:
    track = load_keypoints(shared_data / "beam4cam" / "keypoints" / "cam01.json")
    assert track.layout == "mediapipe33"
    assert track.image_size == (1080, 1920)
    assert track.fps == 60.0
    assert track.pixels.shape == (100, 33, 2)
    assert (track.confidence > 0).any(axis=1).all()


def test_jitter_is_what_trembles_not_what_moves() -> None:
    rng, times = np.random.default_rng(5), np.arange(90)[:, None, None] / 30.0
    smooth = 300.0 + 150.0 * np.sin(np.array([2.0, 3.0]) * times + rng.uniform(0.0, 6.0, (1, 17, 1)))
    assert keypoint_jitter(smooth) < 0.8  # a swing of 150 px, accelerating
    noisy = smooth + rng.normal(0.0, 4.0, smooth.shape)
    noisy[rng.random(noisy.shape[:2]) < 0.05] += 60.0
    noisy[rng.random(noisy.shape[:2]) < 0.1] = np.nan
    assert keypoint_jitter(noisy) == pytest.approx(4.0, rel=0.25)  # each outlier spoils three differences
    assert keypoint_jitter(noisy[:2]) == 0.0
