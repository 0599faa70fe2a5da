"""Keypoints of OpenPose, and of AlphaPose, which can write as OpenPose does.

OpenPose folders, also written by Pose2Sim and Sports2D: a file `<video>_<frame number>_keypoints.json` (or
    `..._000012.json`) a frame, {"people": [{"person_id": [-1], "pose_keypoints_2d": [x, y, c, ...]}, ...]}
AlphaPose: a list of {"image_id": "12.jpg", "keypoints": [x, y, c, ...], "score", "idx", "box"}; with its options `cmu`
    and `open` an object of frames with "bodies" or "people" instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from estimator.data.formats.checked_json import mapping, member, read_json, sequence
from estimator.data.formats.keypoints_reading import KeypointFile, KeypointFormat, Person, Reading, frame_numbers
from estimator.data.media.clip import listed
from humanoid.support.errors import InputError


def _listed_frames(value: list[Any], reading: Reading) -> None:
    """AlphaPose's list of detections."""
    path = reading.source
    if not value:
        raise InputError(path, "has no detection in it")
    entries = [mapping(v, path, f"entry {i}") for i, v in enumerate(value)]
    keys = [str(member(e, "image_id", path, f"entry {i}")) for i, e in enumerate(entries)]
    numbering = frame_numbers(keys, path)
    for i, (entry, key) in enumerate(zip(entries, keys, strict=True)):
        frame = numbering[key]
        place = f"entry {i} (frame {frame})"
        flat = member(entry, "keypoints", path, place)
        id = entry.get("idx", entry.get("track_id"))
        reading.add(frame, [reading.person(flat, id, path, f"{place}.keypoints")])


def _frames_by_name(value: Mapping[str, Any], reading: Reading) -> None:
    numbering = frame_numbers(list(value), reading.source)
    for name, frame in value.items():
        reading.add(numbering[name], _people(frame, reading, reading.source, name))


def _people(frame: Any, reading: Reading, source: Path, place: str) -> list[Person | None]:
    frame = mapping(frame, source, place)
    key, points = ("bodies", "joints") if "bodies" in frame else ("people", "pose_keypoints_2d")
    people = sequence(member(frame, key, source, place), source, f"{place} {key}".strip())
    readings: list[Person | None] = []
    for k, person in enumerate(people):
        where = f"{place}, person {k}".removeprefix(", ")
        person = mapping(person, source, where)
        flat = member(person, points, source, where)
        readings.append(reading.person(flat, person.get("person_id"), source, where))
    return readings


def _folder(path: Path, reading: Reading) -> None:
    files = sorted(p for p in listed(path) if p.suffix.lower() == ".json")
    if not files:
        raise InputError(
            path, "has no .json file", remedy="a folder has one JSON file a frame, as OpenPose writes them"
        )
    numbering = frame_numbers([f.stem for f in files], path)
    seen: dict[int, Path] = {}
    for file in files:
        number = numbering[file.stem]
        if number in seen:
            raise InputError(file, f"is frame {number}, and so is {seen[number].name}")
        seen[number] = file
        reading.add(number, _people(read_json(file), reading, file, f"frame {number}"))


def _is_openpose(file: KeypointFile) -> bool:
    return file.is_folder or (isinstance(file.json, dict) and "people" in file.json)


def _read_openpose(file: KeypointFile, reading: Reading) -> None:
    if file.is_folder:
        _folder(file.path, reading)
    else:
        reading.add(0, _people(file.json, reading, file.path, ""))


def _is_alphapose(file: KeypointFile) -> bool:
    frames = isinstance(file.json, dict) and bool(file.json) and all(isinstance(v, dict) for v in file.json.values())
    return frames or isinstance(file.json, list)


def _read_alphapose(file: KeypointFile, reading: Reading) -> None:
    if isinstance(file.json, list):
        _listed_frames(file.json, reading)
    else:
        _frames_by_name(file.json, reading)


OPENPOSE = KeypointFormat("OpenPose, Pose2Sim, Sports2D", _is_openpose, _read_openpose)
ALPHAPOSE = KeypointFormat("AlphaPose", _is_alphapose, _read_alphapose)
