"""Files with impossible values are refused by the reader, which names the allowed range."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.robustness import fuzz_judge, fuzz_readers
from benchmarks.robustness.fuzz_corpus import SIZE, Files, facing, npz
from benchmarks.robustness.fuzz_texts import ARM, ARM_LANDMARKS, ARM_MESHES, BVH_CMU, BVH_PLAIN
from estimator.data.formats.keypoints import load_keypoints
from estimator.data.image_cues import ImageCues
from estimator.search.mode_search import ModeSearch
from estimator.tracking.registry import make_tracker
from estimator.vision.cues.foreground import silhouette_of
from humanoid.kinematics.body import Body
from humanoid.shape.solids import solids_of
from humanoid.subject.subject import load_subject
from kinemode.energy_parts import Case, energy_parts
from tests.builders import body_of, observe
from tests.changed_json import changed

judge = partial(fuzz_judge.judge, most_seconds=inf)


def refused(reader: str, name: str, content: bytes, folder: Path, **others: bytes) -> str:
    """The message of a reader for a file that it must refuse."""
    path = folder / name
    path.write_bytes(content)
    for other, data in others.items():
        (folder / other.replace("__", ".")).write_bytes(data)
    verdict = judge(reader, path)
    assert verdict.outcome == "refused", verdict
    return verdict.message


KEYPOINTS = {
    "no names": ("names", [], "names: a list of names is needed, one for each keypoint"),
    "an empty name": ("names.0", "", "names: a list of names is needed"),
    "huge integer": ("frames.0.keypoints.0.0", 10**400, "frame 0.*at least 1e7 in size.*below 1e\\+07"),
    "far pixel": ("frames.0.keypoints.0.0", 1e11, "keypoint 0.*at least 1e7 in size.*below 1e\\+07"),
    "image size": ("image_size", [20_000, 480], "image_size.*1 to 16384"),
    "frame rate": ("fps", 1e5, "fps: must be 0.5 to 2000, got 100000"),
    "slow": ("fps", 1e-300, "fps: must be 0.5 to 2000, got 1e-300"),
}
CAMERAS = {
    "focal length": ("cameras.0.K.0.0", 9e6, "K: a focal length must be 1 to 1e\\+06 pixels, got 9e\\+06"),
    "short focal length": ("cameras.0.K.1.1", 1e-5, "pixels, got 1e-05"),
    "huge focal length": ("cameras.0.K.0.0", 1e11, "at least 1e7 in size"),
    "huge integer": ("cameras.0.K.0.0", 10**400, "K: has a number.*at least 1e7 in size .numbers are finite"),
    "image size": ("cameras.1.image_size", [10**6, 10**6], "image_size.*1 to 16384"),
    "distortion": ("cameras.1.distortion.0", 1e6, "distortion: has a coefficient too large .up to 10000"),
    "far away": ("cameras.1.t.0", 1e8, "t: .*at least 1e7 in size"),
}


@pytest.mark.parametrize("name", KEYPOINTS)
def test_invalid_keypoints(name: str, valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    place, new, message = KEYPOINTS[name]
    named = json.loads(next(f["keypoints.json"] for f in valid["keypoints"] if b'"detector"' in f["keypoints.json"]))
    assert re.search(message, refused("keypoints", "k.json", changed(named, place, new), tmp_path))


@pytest.mark.parametrize("name", CAMERAS)
def test_invalid_cameras(name: str, valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    place, new, message = CAMERAS[name]
    value = json.loads(valid["cameras"][0]["cameras.json"])
    assert re.search(message, refused("cameras", "c.json", changed(value, place, new), tmp_path))


@pytest.mark.parametrize("number", ["9" * 5000, 400_000])
def test_invalid_frame_numbers(number: int | str, valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    """They would fill the memory with frames that do not exist."""
    value = json.loads(next(f["keypoints.json"] for f in valid["keypoints"] if b"image_id" in f["keypoints.json"]))
    message = refused("keypoints", "k.json", changed(value, "3.image_id", f"{number}.jpg"), tmp_path)
    assert re.search("not a likely frame number|number the frames from the clip's first", message)


_DEEP = "".join(f"JOINT a{i}\n{{\nOFFSET 0 0 0\nCHANNELS 0\n" for i in range(300))


@pytest.mark.parametrize("id", [20261121, 10**12])
def test_ids_may_be_large(id: int, valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    value = json.loads(next(f["keypoints.json"] for f in valid["keypoints"] if b"image_id" in f["keypoints.json"]))
    (tmp_path / "k.json").write_bytes(changed(value, "0.idx", id))
    assert load_keypoints(tmp_path / "k.json", person=id).notes == (f"person {id}",)


BVH = {
    "no Spine1": (BVH_CMU, "Spine1", "Spine9", ""),
    "far away": (BVH_PLAIN, "1 17 2", "1 17e9 2", "line .*at least 1e7 in size .*below 1e\\+07"),
    "leaves": (BVH_PLAIN, "1 17 2", "999999 17 2", "over 10000 m from where the motion began"),
    "fast": (
        BVH_PLAIN,
        "Frame Time: 0.02",
        "Frame Time: 1e-300",
        "frame time must be 0.0005 to 2 s, got 1e-300",
    ),
    "no shank": (BVH_PLAIN, "0 -7 0", "0 0 0", "left_knee and left_ankle are at the same place"),
    "deep": (BVH_PLAIN, "End Site", _DEEP, "nested over 200 deep"),
}


@pytest.mark.parametrize("name", BVH)
def test_invalid_motion_capture(name: str, tmp_path: Path) -> None:
    text, old, new, message = BVH[name]
    assert old in text
    path = tmp_path / "a.bvh"
    path.write_text(text.replace(old, new, 1))
    verdict = judge("bvh", path)
    assert verdict.outcome == ("refused" if message else "read"), verdict
    assert re.search(message, verdict.message)


SETTINGS = {
    "huge": ("[cost]\nnu = 1e308", "\\[cost\\] nu: 1e\\+308 cannot work .*at most 1e\\+09"),
    "tiny": ("[cost]\nnu = 1e-308", "1e-308 cannot work"),
    "tiny that may be zero": ("[css]\njump_penalty = 1e-308", "1e-308 cannot work .*0 or more"),
    "infinite": ("[cost]\nnu = inf", "inf cannot work"),
    "many": ("[css]\nsamples = 1000000000", "1000000000 cannot work .*at most 100000"),
    "thousands of digits": ("[css]\nsamples = " + 5000 * "9", "is not TOML"),
    "in hexadecimal": ("[css]\nsamples = 0x" + 5000 * "f", "a number of thousands of digits cannot work"),
    "long value": (f"[css]\nshape = 3\n[cost]\npotential = '{100_000 * 'x'}'", "xxx \\.\\.\\. xxx|3 is not text"),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_invalid_settings(name: str, tmp_path: Path) -> None:
    text, message = SETTINGS[name]
    assert re.search(message, refused("settings", "s.toml", text.encode(), tmp_path))


_POINTS = np.zeros((3, 2, 3))
REFERENCES: dict[str, tuple[dict[str, Any], str]] = {
    "infinite": ({"points": np.full((3, 2, 3), np.inf)}, "infinite, or at least 1e7 in size .metres below"),
    "far": ({"points": np.full((3, 2, 3), 1e8)}, "at least 1e7 in size"),
    "texts": ({"points": np.full((3, 2, 3), "1")}, "points: numbers are needed"),
    "complex": ({"points": _POINTS + 1j}, "points: numbers are needed"),
    "nothing": ({"points": np.zeros((0, 2, 3))}, "has no points"),
    "numbers for names": ({"names": np.zeros(2)}, "names: a list of names is needed"),
    "rates": ({"fps": np.array([30.0, 60.0])}, "fps: one number is needed"),
    "frame rate": ({"fps": np.array(1e9)}, "fps: must be 0.5 to 2000, got 1e.09"),
    "no character": (
        {"names": np.array([0x7FFFFFFF, 0], np.uint32).view("<U1")},
        "names: has invalid characters",
    ),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_invalid_references(name: str, tmp_path: Path) -> None:
    arrays = {"points": _POINTS, "names": np.array(["a", "b"]), "fps": np.array(30.0)}
    new, message = REFERENCES[name]
    assert re.search(message, refused("reference", "r.npz", npz(arrays | new), tmp_path))


def test_damaged_references(valid: Mapping[str, list[Files]], tmp_path: Path) -> None:
    good = bytearray(valid["reference"][0]["reference.npz"])
    place = good.index(b"PK\x01\x02") + 6  # the zip version needed
    good[place : place + 2] = b"\xff\xff"
    assert "cannot be read" in refused("reference", "r.npz", bytes(good), tmp_path)
    trc = valid["trc"][0]["reference.trc"].decode()
    head, row = trc.split("\n6\t")[0].splitlines()[:5], trc.splitlines()[6]
    for lines, message in (
        ([*head[:3], "Frame#\tTime", "", row], "line 4: has no markers"),
        ([*head, row, row, row], "time: is not 3 rising numbers"),
        ([*head, row.replace(row.split("\t")[3], "1e300")], "line 6: has a number too large .up to 1e.10"),
        ([*head], "has no points|is not a TRC file"),
    ):
        assert re.search(message, refused("trc", "r.trc", "\n".join(lines).encode(), tmp_path))


def test_landmark_files_of_endless_joints_load(tmp_path: Path) -> None:
    """A limit added to a joint without one needs the attributes that URDF parsers require."""
    (tmp_path / "arm.urdf").write_text(ARM_MESHES[""])
    (tmp_path / "arm.landmarks.toml").write_text(ARM_LANDMARKS)
    body = Body(load_subject(tmp_path / "arm.urdf"))
    assert solids_of(body, "visual")
    assert body.bounded_q.size == 2
    numbers = "[limits]\nelbow = [0x" + 5000 * "f" + ", 1]"
    message = refused("landmark file", "arm.landmarks.toml", numbers.encode(), tmp_path)
    assert "not [lower, upper]" in message


def test_every_shape_that_is_offered_loads(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    box = '<box size="1 1 1"/>'
    message = refused("urdf", path.name, ARM.replace(box, "<capsule radius='1' length='1'/>").encode(), tmp_path)
    offered = message.partition("shapes: ")[2].partition(")")[0].split(", ")
    assert {"box", "cylinder", "mesh"} < set(offered)
    assert "capsule" not in offered
    for shape in sorted(set(offered) - {"mesh"}):
        path.write_text(ARM.replace(box, f'<{shape} size="1 1 1" radius="1" length="1"/>'))
        assert judge("urdf", path).outcome == "read", shape


def test_a_body_behind_the_camera_has_an_energy_all_the_same() -> None:
    """None of it projects into the image, so its extent there is unknown."""
    body, camera = body_of("arm8"), facing("k")
    search: ModeSearch = make_tracker("css", body).search
    seen = observe(body, body.clamp(body.neutral), [camera])
    mask = np.zeros(SIZE[::-1], bool)
    mask[10:30, 20:40] = True
    silhouette, q = silhouette_of(mask), body.clamp(body.neutral)
    for depth in (0.0, -3.0):
        moved = replace(camera, t_camera_world=np.array([0.0, 0.0, depth]))
        cues = (ImageCues(moved, {"silhouette": silhouette}),)
        observation = replace(seen, cameras=(moved,), cues=cues)
        likelihood = search.likelihood(observation, q)
        posed = body.at(q)
        case = Case(search, observation, "as_detected", posed, None, False, 0.0, posed, likelihood)
        parts = energy_parts(case)
        assert np.isfinite([part.energy for part in parts]).all()


def test_memory_is_judged_by_what_reading_adds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test process uses much memory before it reads anything."""

    class Greedy:
        def read(self, path: Path) -> np.ndarray:
            return np.ones(len(path.read_bytes()) * 1_000_000)

    monkeypatch.setitem(fuzz_readers.READERS, "greedy", Greedy())
    monkeypatch.setattr(fuzz_judge, "MOST_MEMORY", 400_000_000)
    path = tmp_path / "bytes"
    path.write_bytes(bytes(1))
    assert judge("greedy", path).outcome == "read"
    path.write_bytes(bytes(40))  # 320 MB
    assert judge("greedy", path).outcome == "memory"
