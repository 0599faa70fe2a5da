"""Manifests made from a folder: each layout is recognised, and the manifest is read without a fault."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from humanoid.support.errors import InputError
from kinemode.batches.folders import manifest_of, write_manifest
from kinemode.batches.manifest import BatchRow, read_manifest


def fill(folder: Path, files: Sequence[str]) -> Path:
    """Make empty files, and camera files whose cameras are listed after the name: "calibration.json cam01 cam02"."""
    for line in files:
        name, *cameras = line.split(" ") if " cam" in line else [line]
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"cameras": [camera(c) for c in cameras]}) if cameras else "")
    return folder


def camera(name: str) -> dict[str, Any]:
    K = [[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]]
    pose = {"R": np.eye(3).tolist(), "t": [0.0, 0.0, 4.0]}
    return {"name": name, "image_size": [640, 480], "K": K, "distortion": [0.0] * 5, **pose}


def section(name: str) -> dict[str, Any]:
    """A camera in the form of Pose2Sim's files."""
    pose = {"rotation": [0.0, 0.0, 0.1], "translation": [float(len(name)), float(name[-1]), 4.0]}
    return {"name": name, "size": [640.0, 480.0], "matrix": camera(name)["K"], "distortions": [0.0] * 4, **pose}


def made(folder: Path) -> tuple[list[dict[str, str]], str]:
    """The rows and notes of a folder. The manifest, written beside the folder and in it, is read without a fault and
    has all of them."""
    manifest = manifest_of(folder)
    notes = "\n".join(manifest.left_out)
    rows = manifest.rows(folder)
    for place in (folder, folder.parent):
        read = read_manifest(write_manifest(manifest, place / "made.csv", overwrite=True))
        assert [row.name for row in read] == [row["name"] for row in rows]
        assert [row.clips for row in read] == [absolute(row.get("clips", ""), folder, row) for row in rows]
        (place / "made.csv").unlink()
    return rows, notes


def absolute(cell: str, folder: Path, row: dict[str, str]) -> tuple[str, ...]:
    if "'" in cell:
        return (str(folder / cell.strip("'")),)
    named = [(name, equals, path or name) for name, equals, path in (word.partition("=") for word in cell.split())]
    return tuple(f"{name if equals else ''}{equals}{folder / path}" for name, equals, path in named)


def test_videos_beside_each_other(tmp_path: Path) -> None:
    files = ["walk2.mp4", "walk10.MOV", "run.avi", "run.mp4", "my jump.mp4", "walk10.json", "run_json/1_keypoints.json",
             "walk2.keypoints/walk2.json", "alone.json", ".hidden.mp4", "notes.txt", "walk10.names.json"]  # fmt: skip
    rows, notes = made(fill(tmp_path / "lab", files))
    assert rows == [
        {"name": "my_jump", "clips": "'my jump.mp4'", "detect": "yes"},
        {"name": "run", "clips": "run.avi", "keypoints": "run_json"},
        {"name": "walk2", "clips": "walk2.mp4", "keypoints": "walk2.keypoints/walk2.json"},
        {"name": "walk10", "clips": "walk10.MOV", "keypoints": "walk10.json"},
    ]
    assert "run.mp4: left out, run.avi is taken" in notes
    assert "alone.json: not placed" in notes
    assert "names.json" not in notes


def test_a_folder_of_folders(tmp_path: Path) -> None:
    """A video is a clip; several are cameras where a camera file or their names imply it; equal names are made
    distinct."""
    files = ["calibration.json cam01 cam02", "a/walk/cam01.mp4", "a/walk/cam02.mp4", "a/walk/keypoints/cam01.json",
             "a/walk/keypoints/cam02.json", "b/walk/film.mp4", "c/one.mp4", "c/two.mp4", "c/three.mp4", "d/left.mp4",
             "d/right.mp4", "d/cameras.json cam_l cam_r", "e/1.png", "e/2.png", "e/3.png"]  # fmt: skip
    rows, notes = made(fill(tmp_path / "lab", files))
    both = "a/walk/{0}cam01{1} a/walk/{0}cam02{1}"
    assert rows == [
        {"name": "a_walk", "clips": both.format("", ".mp4"), "keypoints": both.format("keypoints/", ".json"),
         "cameras": "calibration.json"},
        {"name": "b_walk", "clips": "b/walk/film.mp4", "detect": "yes"},
        {"name": "one", "clips": "c/one.mp4", "detect": "yes"},
        {"name": "three", "clips": "c/three.mp4", "detect": "yes"},
        {"name": "two", "clips": "c/two.mp4", "detect": "yes"},
        {"name": "d", "clips": "cam_l=d/left.mp4 cam_r=d/right.mp4", "cameras": "d/cameras.json", "detect": "yes"},
    ]  # fmt: skip
    assert "d: cameras of cameras.json taken in their order: cam_l=left, cam_r=right" in notes
    assert "c: its 3 videos are taken as clips of their own" in notes
    assert "b/walk: film: not the cameras of calibration.json, which are cam01, cam02" in notes
    assert "e: a folder of pictures, not placed" in notes


@pytest.mark.parametrize("session", ["", "S01_P02_Participant/"])
def test_sessions_of_pose2sim(tmp_path: Path, session: str) -> None:
    """One trial or several, the calibration above them; board videos are not clips; JSON folders have the cameras'
    names."""
    trials = [f"{session}S01_P02_T0{i}_Trial/" for i in (1, 2)] if session else [""]
    files = [f"{t}{f}" for t in trials for f in ("videos/cam01.mp4", "videos/cam02.mp4", "Config.toml",
             "pose/cam01_json/cam01_00.json", "pose/cam02_json/cam02_00.json", "pose/cam01_pose.mp4")]  # fmt: skip
    folder = fill(tmp_path / "S01_Session", [*files, "calibration/intrinsics/int_cam1/film.mp4"])
    (folder / "calibration" / "Calib_scene.toml").write_text(tomli_w.dumps({n: section(n) for n in ("int_1", "int_2")}))
    rows, notes = made(folder)
    assert len(rows) == len(trials)
    for row, trial in zip(rows, trials, strict=True):
        assert row["clips"] == f"int_1={trial}videos/cam01.mp4 int_2={trial}videos/cam02.mp4"
        assert row["keypoints"] == f"int_1={trial}pose/cam01_json int_2={trial}pose/cam02_json"
        assert row["cameras"] == "calibration/Calib_scene.toml"
        assert "detect" not in row
        assert row.get("person") == ("S01_P02" if session else None)
    assert "taken in their order" in notes


def test_keypoints_of_pose2sim_without_videos(tmp_path: Path) -> None:
    files = ["calibration/calibration.json cam01 cam02", "pose/cam01_json/1.json", "pose/cam02_json/1.json"]
    rows, _ = made(fill(tmp_path / "trial", files))
    keypoints = "cam01=pose/cam01_json cam02=pose/cam02_json"
    assert rows == [{"name": "trial", "keypoints": keypoints, "cameras": "calibration/calibration.json"}]


def test_a_session_of_opencap(tmp_path: Path) -> None:
    trials = ("squat/squat.mov", "squat/squat_sync.mp4", "walk/walk.mov", "calibration/calibration.mov")
    films = [f"Videos/Cam{i}/InputMedia/{film}" for i in (0, 1) for film in trials]
    pickles = [f"Videos/Cam{i}/cameraIntrinsicsExtrinsics.pickle" for i in (0, 1)]
    folder = fill(tmp_path / "data", [*films, *pickles, "Videos/Cam0/InputMedia/jump/jump.mov"])
    metadata = "height_m: 1.78\nmass_kg: 70.0\nsubjectID: anna\niphoneModel:\n  Cam0: iPhone13,3\n  Cam1: iPhone13,3\n"
    (folder / "sessionMetadata.yaml").write_text(metadata)
    rows, notes = made(folder)
    anna = {"detect": "yes", "person": "anna", "height": "1.78"}
    media = "Cam{0}=Videos/Cam{0}/InputMedia/{1}"
    two = {film: " ".join(media.format(i, film) for i in (0, 1)) for film in ("squat/squat_sync.mp4", "walk/walk.mov")}
    assert rows == [
        {"name": "jump", "clips": "Videos/Cam0/InputMedia/jump/jump.mov", "phone": "iPhone13,3", **anna},
        {"name": "squat", "clips": two["squat/squat_sync.mp4"], **anna},
        {"name": "walk", "clips": two["walk/walk.mov"], "sync": "auto", **anna},
    ]
    assert "its cameras are in pickles" in notes
    assert "the trial calibration is left out" in notes


def test_two_people_of_one_name(tmp_path: Path) -> None:
    for session, height in (("a", 1.8), ("b", 1.6), ("c", 1.6)):
        folder = fill(tmp_path / "lab" / session, ["Videos/Cam0/InputMedia/walk/walk.mov"])
        who = "me" if session == "c" else "1"
        (folder / "sessionMetadata.yaml").write_text(f"subjectID: {who}\nheight_m: {height}\n")
    rows, notes = made(tmp_path / "lab")
    assert [(r["name"], r.get("person"), r["height"]) for r in rows] == [
        ("a_walk", None, "1.8"), ("b_walk", None, "1.6"), ("c_walk", "me", "1.6"),
    ]  # fmt: skip
    assert "lab: the person 1 has several heights" in notes


def test_equal_names_are_made_distinct(tmp_path: Path) -> None:
    rows, _ = made(fill(tmp_path / "lab", ["x/a b/film.mp4", "x/a_b/film.mp4", "y/film.mp4", "z/Y/film.mp4"]))
    names = [row["name"] for row in rows]
    assert len({name.casefold() for name in names}) == len(names) == 4


def test_links_to_folders_above(tmp_path: Path) -> None:
    folder = fill(tmp_path / "lab", ["walk/film.mp4"])
    (folder / "walk" / "again").symlink_to(folder)
    assert [row["name"] for row in made(folder)[0]] == ["walk"]


def test_folders_of_nothing(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for folder, problem in ((tmp_path, "no clip is in it"), (tmp_path / "gone", "there is no such folder")):
        with pytest.raises(InputError, match=problem):
            manifest_of(folder)


def test_an_existing_manifest_is_kept(tmp_path: Path) -> None:
    manifest = manifest_of(fill(tmp_path / "lab", ["walk.mp4"]))
    out = write_manifest(manifest, tmp_path / "made.csv")
    with pytest.raises(InputError, match="exists already"):
        write_manifest(manifest, out)
    with pytest.raises(InputError, match=r"ends in \.csv"):
        write_manifest(manifest, tmp_path / "made.toml")


def test_the_clips_of_the_evaluation_data(shared_data: Path) -> None:
    """A trial of Pose2Sim's own demonstration with four cameras: their names are those of the camera file."""
    (row,) = manifest_of(shared_data / "beam4cam").rows(shared_data)
    assert row["cameras"] == "beam4cam/calibration.json"
    assert len(row["clips"].split()) == len(row["keypoints"].split()) == 4
    names = {row["name"] for row in manifest_of(shared_data / "opencap").rows(shared_data)}
    assert names == {"squat", "walk"}


def test_rows_are_read_as_rows(tmp_path: Path) -> None:
    manifest = manifest_of(fill(tmp_path / "lab", ["Grüße.mp4"]))
    (row,) = read_manifest(write_manifest(manifest, tmp_path / "made.csv"))
    clip = str(tmp_path / "lab" / "Grüße.mp4")
    assert row == BatchRow("Grüße", "row 2", clips=(clip,), options={"detect": True})
