"""Keypoints from DeepLabCut, COCO, rtmlib and arrays: the same person from each, and faults with their place."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, load_people, write_keypoints
from estimator.data.formats.people_tracks import ids_of
from humanoid.subject.landmarks import COCO17
from humanoid.support.errors import InputError

FRAMES = 5
LOST = (3, 6)  # frame and keypoint of a point that no file has


def points(who: int = 0) -> np.ndarray:
    """(T, 17, 3) of a person; one point missing, and all of frame 2."""
    rng = np.random.default_rng(who)
    xy = np.round(rng.uniform(50, 400, (1, 17, 2)) + 10.0 * np.arange(FRAMES)[:, None, None] + 500 * who, 3)
    out = np.concatenate([xy, np.round(rng.uniform(0.2, 1.0, (FRAMES, 17, 1)), 3)], axis=2)
    out[LOST] = out[2] = np.nan, np.nan, 0.0
    return out


def same(track: KeypointTrack, expected: np.ndarray, *, sure: bool = False) -> None:
    """The track is the person; with `sure` the file only marks which points exist."""
    assert track.names == COCO17
    np.testing.assert_allclose(track.pixels, expected[..., :2])
    wanted = (expected[..., 2] > 0.0).astype(float) if sure else expected[..., 2]
    np.testing.assert_allclose(track.confidence, wanted)


def deeplabcut(path: Path, people: dict[str, np.ndarray], index: Callable[[int], list[str]], coords: int = 3) -> Path:
    """A file as DeepLabCut writes it: a row of individuals where they have names."""
    kinds = ("x", "y", "likelihood")[:coords]
    columns = [(who, part, kind) for who in people for part in COCO17 for kind in kinds]
    pad = [""] * (len(index(0)) - 1)
    heads = [["scorer", *pad, *["DLC_resnet50_walk"] * len(columns)]]
    heads += [["individuals", *pad, *(who for who, _, _ in columns)]] if "" not in people else []
    heads += [["bodyparts", *pad, *(part for _, part, _ in columns)], ["coords", *pad, *(kind for *_, kind in columns)]]
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerows(heads)
        for t in range(FRAMES):
            values = np.concatenate([p[t, :, :coords].ravel() for p in people.values()])
            rows.writerow([*index(t), *("" if np.isnan(v) else v for v in values)])
    return path


def coco(people: dict[int, np.ndarray], flags: bool = False) -> dict[str, Any]:
    """A data set whose pictures are listed backwards, their ids in no order."""
    ids = {t: (7 * t + 3) % FRAMES + 100 for t in range(FRAMES)}
    images = [{"id": ids[t], "file_name": f"cam01/{t:06d}.png", "width": 1920, "height": 1080} for t in range(FRAMES)]
    annotations: list[dict[str, Any]] = []
    for t in reversed(range(FRAMES)):
        for who, p in people.items():
            row = np.nan_to_num(p[t])
            row[:, 2] = 2.0 * (row[:, 2] > 0.0) if flags else row[:, 2]
            entry = {"id": len(annotations), "image_id": ids[t], "category_id": 1, "keypoints": row.ravel().tolist()}
            annotations.append(entry | ({"track_id": who} if len(people) > 1 else {}))
    category = {"id": 1, "name": "person", "keypoints": list(COCO17), "skeleton": [[16, 14]]}
    return {"images": images[::-1], "annotations": annotations, "categories": [category]}


def test_deeplabcut(tmp_path: Path) -> None:
    file = deeplabcut(tmp_path / "a.csv", {"": points()}, lambda t: [str(t)])
    same(load_keypoints(file), points())
    pictures = deeplabcut(tmp_path / "b.csv", {"": points()}, lambda t: ["labeled-data", "walk", f"img{t:03d}.png"], 2)
    same(load_keypoints(pictures), points(), sure=True)
    both = deeplabcut(tmp_path / "c.csv", {"ann": points(), "bob": points(1), "single": points(2)}, lambda t: [str(t)])
    people = load_people(both)
    same(people.one("ann"), points())
    same(people.one("bob"), points(1))
    assert "'single'" in people.one("ann").notes[-1]
    assert len(people.frames[0]) == 2
    assert not people.frames[2]


def test_coco_data_sets(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(coco({0: points()})))
    track = load_keypoints(path)
    same(track, points())
    assert (track.layout, track.image_size) == ("coco17", (1920, 1080))
    path.write_text(json.dumps(coco({4: points(), 9: points(1)})))
    for who, id in enumerate((4, 9)):
        same(load_keypoints(path, person=id), points(who))
    flagged = coco({0: points()}, flags=True)
    flagged["annotations"][0]["keypoints"][2] = 1  # of the last frame's nose: labelled, not visible
    flagged["annotations"][0]["score"] = 0.8
    flagged["annotations"].append({"id": 99, "image_id": 100, "iscrowd": 1, "keypoints": [1.0] * 51})
    path.write_text(json.dumps(flagged))
    track = load_keypoints(path)
    np.testing.assert_allclose(track.confidence[-1], [0.4, *[0.8] * 16])
    np.testing.assert_allclose(track.pixels, points()[..., :2])
    for image in flagged["images"]:
        image["file_name"] = "picture.png"
    path.write_text(json.dumps(flagged))  # then the ids give the order
    order = np.argsort([(7 * t + 3) % FRAMES for t in range(FRAMES)])
    np.testing.assert_allclose(load_keypoints(path).pixels, points()[order, :, :2])


def test_arrays(tmp_path: Path) -> None:
    p = points()
    np.save(tmp_path / "a.npy", p)
    same(load_keypoints(tmp_path / "a.npy"), p)
    np.save(tmp_path / "b.npy", p[..., :2].astype(np.float32))
    track = load_keypoints(tmp_path / "b.npy")
    np.testing.assert_allclose(track.pixels, p[..., :2], rtol=1e-6)
    np.testing.assert_array_equal(track.confidence, p[..., 2] > 0.0)
    np.savez(tmp_path / "c.npz", keypoints=p[..., :2], scores=p[..., 2], fps=60.0, image_size=[640, 480])
    track = load_keypoints(tmp_path / "c.npz")
    same(track, p)
    assert (track.fps, track.image_size) == (60.0, (640, 480))
    np.savez(tmp_path / "d.npz", keypoints=np.stack([p, points(1)], axis=1))
    assert [len(people) for people in load_people(tmp_path / "d.npz").frames.values()] == [2, 2, 0, 2, 2]


def test_names_beside_a_file(tmp_path: Path) -> None:
    few = points()[:, [0, 5, 6, 11, 12]]
    np.save(tmp_path / "a.npy", few)
    with pytest.raises(InputError, match=r"5 keypoints fit no layout \(name them in a.names.json or a.names.txt; lay"):
        load_keypoints(tmp_path / "a.npy")
    (tmp_path / "a.names.txt").write_text("Nose\nLShoulder\nRShoulder\nleft hip\ntail\n")
    track = load_keypoints(tmp_path / "a.npy")
    assert track.names == ("nose", "left_shoulder", "right_shoulder", "left_hip", "tail")
    assert "('tail'): a.names.json can map" in track.notes[0]
    np.testing.assert_allclose(track.pixels, few[..., :2])
    file = deeplabcut(tmp_path / "b.csv", {"": points()}, lambda t: [str(t)])
    file.write_text(file.read_text().replace("nose", "snout"))
    assert load_keypoints(file).names[0] == "snout"
    (tmp_path / "b.names.json").write_text('{"snout": "nose"}')
    same(load_keypoints(file), points())
    (tmp_path / "b.names.json").write_text('{"snaut": "nose"}')
    with pytest.raises(InputError, match=r"b.names.json: there is no keypoint 'snaut' \(the keypoints are snout"):
        load_keypoints(file)


def test_rtmlibs_arrays(tmp_path: Path) -> None:
    people = np.stack([points(), points(1)], axis=1)
    seen = {t: [p for p in people[t] if p[:, 2].any()] for t in range(FRAMES)}
    frames = [
        {
            "keypoints": [np.nan_to_num(p[:, :2]).tolist() for p in seen[t]],
            "scores": [p[:, 2].tolist() for p in seen[t]],
        }
        for t in range(FRAMES)
    ]
    whole = {name: [frame[name] for frame in frames] for name in ("keypoints", "scores")} | {"fps": 50}
    path = tmp_path / "a.json"
    for content in (
        frames,
        whole,
        [f | {"frame_id": t, "track_ids": [3, 8][: len(seen[t])]} for t, f in enumerate(frames)],
    ):
        path.write_text(json.dumps(content))
        read = load_people(path)
        assert [len(read.frames[t]) for t in range(FRAMES)] == [2, 2, 0, 2, 2]
        for who in range(2):
            np.testing.assert_allclose(read.frames[4][who].points, people[4, who])
    same(load_keypoints(path, person=8), points(1))


def test_what_was_read_is_written_and_read_again(tmp_path: Path) -> None:
    track = load_keypoints(deeplabcut(tmp_path / "a.csv", {"": points()}, lambda t: [str(t)]))
    write_keypoints(tmp_path / "a.json", track)
    same(load_keypoints(tmp_path / "a.json"), points())


HEAD = "scorer,a,a,a\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood\n"
IMAGE = {"id": 1, "file_name": "1.png", "width": 9, "height": 9}


def data_set(**changed: Any) -> dict[str, Any]:
    whole = coco({0: points()})
    return whole | changed


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "frame,nose_x\n0,1\n", r"does not begin as DeepLabCut's.*read are AlphaPose, .*npz"),
        ("a.csv", HEAD, "no frame after its head"),
        ("a.csv", HEAD.replace("coords", "kind") + "0,1,2,1\n", r"line 1: its lines begin with .*'kind'"),
        ("a.csv", HEAD.replace("x,y", "x,z") + "0,1,2,1\n", r"coords: has 'z' in column 3 \(one of x, y, likelihood\)"),
        ("a.csv", HEAD.replace("x,y", "x,x") + "0,1,2,1\n", "column 3: 'nose' has x twice"),
        ("a.csv", HEAD + "0,1,2,1\n1,1,2\n", "line 5: has 3 cells, 4 are expected"),
        ("a.csv", HEAD + "0,1,2,much\n", "line 4: has a cell that is not a number"),
        ("a.csv", HEAD + "0,1,inf,1\n", "line 4, keypoint 0: has a number that is not finite"),
        ("a.csv", HEAD + "0,1,2,1\n0,1,2,1\n", "line 5: frame 0 is in line 4 too"),
        ("a.csv", HEAD + "a/1.png,1,2,1\nb/1.png,1,2,1\n", "'a/1.png' and 'b/1.png' are both frame 1"),
        ("a.npy", b"\x93NUMPY\x01\x00", "cannot be read"),
        ("a.npy", b"", "does not begin as NumPy's files do"),
        ("a.npy", np.zeros((3, 17)), r"keypoints: has the shape \(3, 17\) \(read are \(T, K, 2\)"),
        ("a.npy", np.array(["x"]), "keypoints: is of type"),
        ("a.npz", {"points": np.zeros(3)}, "has no array 'keypoints' but points"),
        ("a.npz", {"keypoints": np.ones((2, 17, 2)), "scores": np.ones((2, 1))}, r"scores: has the shape \(2, 1\)"),
        ("a.npz", {"keypoints": np.ones((2, 3, 2)), "names": np.array(["a", "b"])}, "2 names, the keypoints are 3"),
        ("a.json", data_set(annotations=[]), "no annotation with keypoints"),
        ("a.json", data_set(images=[IMAGE, IMAGE]), "images: two pictures have the id '1'"),
        ("a.json", data_set(images=[IMAGE, IMAGE | {"id": 2, "width": 8}]), r"several sizes \(8x9, 9x9\)"),
        ("a.json", data_set(images=[IMAGE, IMAGE | {"id": 2, "file_name": "b/1.png"}]), "are both frame 1"),
        ("a.json", data_set(images=[IMAGE]), r"annotations\[0\]: its image_id 1.. matches no picture"),
        ("a.json", data_set(categories=[{"id": 1, "keypoints": ["nose"]}]), r"annotations\[0\].keypoints: 3 numbers"),
        ("a.json", [{"keypoints": [[[1, 2]]], "scores": []}], "frame 0: has 1 people's keypoints, 0 people's scores"),
        ("a.json", [{"keypoints": [[[1, 2, 3]]], "scores": [[1]]}], r"frame 0, person 0: needs \[x, y\]"),
        ("a.json", {"keypoints": [[], []], "scores": [[]]}, "keypoints of 2 frames and scores of 1"),
    ],
)  # fmt: skip
def test_faults_name_their_place(tmp_path: Path, name: str, content: Any, message: str) -> None:
    path = tmp_path / name
    if isinstance(content, (bytes, str)):
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    elif isinstance(content, np.ndarray):
        np.save(path, content)
    elif name.endswith(".npz"):
        np.savez(path, **content)
    else:
        path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message) as caught:
        load_keypoints(path)
    assert caught.value.source == str(path)


def test_members_that_were_meant_for_known_ones_are_not_left_out(tmp_path: Path) -> None:
    track = load_keypoints(deeplabcut(tmp_path / "a.csv", {"": points()}, lambda t: [str(t)]))
    write_keypoints(tmp_path / "a.json", track)
    own = json.loads((tmp_path / "a.json").read_text())
    person = {"id": 3, "keypoints": np.nan_to_num(points()[0]).tolist()}
    for changed, message in (
        ({"image_sise": [640, 480]}, r"'image_sise' is unknown \(did you mean image_size\?"),
        ({"frames": [{"keypoint": [], "people": [person]}]}, r"frame 0: the member 'keypoint' is unknown"),
        ({"frames": [{"people": [{"ids": 3, **{k: v for k, v in person.items() if k != "id"}}]}]}, "person 0: .*'ids'"),
    ):
        kept = {key: value for key, value in own.items() if key != "image_size" or "image_sise" not in changed}
        (tmp_path / "b.json").write_text(json.dumps(kept | changed))
        with pytest.raises(InputError, match=message):
            load_people(tmp_path / "b.json")
    (tmp_path / "b.json").write_text(json.dumps(own | {"detector": "x", "scores": 1}))
    same(load_keypoints(tmp_path / "b.json"), points())
    np.savez(tmp_path / "c.npz", keypoints=points()[..., :2], score=points()[..., 2])
    with pytest.raises(InputError, match=r"'score' is unknown \(did you mean scores\?"):
        load_keypoints(tmp_path / "c.npz")
    (tmp_path / "a.names.json").write_text('{"nose": "noze"}')
    notes = load_keypoints(tmp_path / "a.csv").notes
    assert any("nose is called 'noze', which is not a landmark of people: nose?" in note for note in notes)


def yolo(p: np.ndarray, id: int | None = None, scale: tuple[float, float] = (1.0, 1.0)) -> dict[str, Any]:
    """A person's points (17, 3) in a frame in the form of `Results.summary()`; missing points lie at (0, 0), though
    with a confidence."""
    there = p[:, 2] > 0.0
    x, y = (np.where(there, p[:, axis] / scale[axis], 0.0) for axis in (0, 1))
    keypoints = {"x": x.tolist(), "y": y.tolist(), "visible": np.where(there, p[:, 2], 0.3).tolist()}
    box = {"x1": 1.0, "y1": 2.0, "x2": 30.0, "y2": 40.0}
    person = {"name": "person", "class": 0, "confidence": 0.9, "box": box, "keypoints": keypoints}
    return person if id is None else {**person, "track_id": id}


def yolo_frames(people: dict[int | None, np.ndarray], scale: tuple[float, float] = (1.0, 1.0)) -> list[list[Any]]:
    """All people's points by frame; a frame without points has no people."""
    return [[yolo(p[t], id, scale) for id, p in people.items() if np.any(p[t, :, 2] > 0.0)] for t in range(FRAMES)]


def test_ultralytics_json(tmp_path: Path) -> None:
    path, frames = tmp_path / "a.json", yolo_frames({None: points()})
    for content in (frames, [json.dumps(frame) for frame in frames]):
        path.write_text(json.dumps(content))
        track = load_keypoints(path)
        same(track, points())
        assert (track.layout, track.frame_count) == ("coco17", FRAMES)
        assert any("at exactly (0, 0) are missing (1 times)" in note for note in track.notes)
    path.write_text(json.dumps(["[]", *[json.dumps(frame) for frame in frames]]))  # no people in the first frame
    np.testing.assert_allclose(load_keypoints(path).pixels[1:], points()[..., :2])
    path.write_text(json.dumps(yolo_frames({4: points(), 9: points(1)})))
    for who, id in enumerate((4, 9)):
        same(load_keypoints(path, person=id), points(who))
    path.write_text(json.dumps(frames[0]))
    track = load_keypoints(path)
    np.testing.assert_allclose(track.pixels, points()[:1, :, :2])
    assert any("is of one picture" in note for note in track.notes)
    (tmp_path / "frames").mkdir()
    for t, frame in enumerate(frames):
        (tmp_path / "frames" / f"walk_{t:04d}.json").write_text(json.dumps(frame))
    same(load_keypoints(tmp_path / "frames"), points())


@pytest.mark.parametrize("size", [(1280, 720), (608, 1080)])
def test_fractions_of_the_picture_need_its_size(tmp_path: Path, size: tuple[int, int]) -> None:
    path, (width, height) = tmp_path / "a.json", size
    path.write_text(json.dumps(yolo_frames({None: points()}, (float(width), float(height)))))
    same(load_keypoints(path, image_size=size), points())
    assert load_keypoints(path, image_size=size).image_size == size
    with pytest.raises(InputError, match=r"fractions of a picture whose size is not known .*--keypoint-size"):
        load_keypoints(path)
    same(load_people(path).in_pixels(size).one(), points())


def write_labels(
    folder: Path,
    people: dict[int, np.ndarray],
    size: tuple[int, int],
    ends: str = "",
    stem: str = "walk_{}",
    first: int = 1,
) -> Path:
    """Labels as `save_txt` writes them; ends: of a line, with the person's {id}."""
    folder.mkdir()
    for t, frame in enumerate(yolo_frames(dict(people), (float(size[0]), float(size[1])))):
        lines = []
        for person, id in zip(frame, people, strict=False):
            columns = [person["keypoints"][key] for key in ("x", "y", "visible")]
            values = " ".join(f"{v:.9g}" for v in np.array(columns).T.ravel())
            lines.append(f"0 0.5 0.5 0.2 0.7 {values} {ends.format(id=id)}".rstrip())
        if lines:
            (folder / f"{stem.format(t + first)}.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.parametrize("ends", ["", "0.87", "{id}", "0.87 {id}"])
def test_ultralytics_labels(tmp_path: Path, ends: str) -> None:
    """Whatever follows the keypoints: nothing, a confidence, a number, or both."""
    size = (1280, 720)
    folder = write_labels(tmp_path / "labels", {4: points(), 9: points(1)}, size, ends)
    people = load_people(folder).in_pixels(size)
    if "{id}" in ends:
        same(people.one(4), points())
        same(people.one(9), points(1))
    else:
        assert ids_of(people.frames) == set()
    assert [len(people.frames.get(t, ())) for t in range(FRAMES)] == [2, 2, 0, 2, 2]
    assert any(
        "whose first frame Ultralytics numbers 1" in note
        for note in people.one(0 if not ids_of(people.frames) else 4).notes
    )


def test_labels_without_confidences_and_of_pictures(tmp_path: Path) -> None:
    p = points()
    folder = write_labels(tmp_path / "pictures", {1: p}, (640, 360), stem="img{:05d}", first=0)
    same(load_keypoints(folder, image_size=(640, 360)), p)
    for file in folder.iterdir():
        words = file.read_text().split()
        kept = words[:5] + [w for k, w in enumerate(words[5:]) if k % 3 < 2]
        file.write_text(" ".join(kept) + "\n")
    (folder / "img00002.txt").write_text("")  # as hand labelling leaves a picture without people
    same(load_keypoints(folder, image_size=(640, 360)), p, sure=True)


def test_faults_of_ultralytics_files(tmp_path: Path) -> None:
    person = yolo(points()[0])
    short = {**person, "keypoints": {**person["keypoints"], "y": [1.0] * 5}}
    for content, message in (
        ([[person], [short]], r"frame 1, person 0.keypoints: has 17 x, 5 y and 17 confidences"),
        ([[person], [{"name": "person"}]], r"frame 1, person 0.keypoints: is missing"),
        ([[person], 3], "frame 1: a list .* is needed, found a number"),
        ([[yolo(points()[0, :5])]], "15 numbers fit no layout"),
        ([[], []], "has no person in any frame"),
    ):
        (tmp_path / "a.json").write_text(json.dumps(content))
        with pytest.raises(InputError, match=message):
            load_keypoints(tmp_path / "a.json")
    folder = write_labels(tmp_path / "labels", {1: points()}, (640, 360))
    for text, message in (
        ("0 0.5 0.5 0.1 0.1\n", "line 1: has 5 numbers, which are not a class, a box and 17 keypoints .39 or 56"),
        ("0 a b\n", "line 1: has words among its numbers"),
    ):
        (folder / "walk_1.txt").write_text(text)
        with pytest.raises(InputError, match=message):
            load_keypoints(folder)
    (folder / "walk_1.txt").unlink()
    (folder / "other_2.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    with pytest.raises(InputError, match="are both frame 2"):
        load_keypoints(folder)
