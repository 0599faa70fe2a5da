"""The file layouts 2D keypoints come in. Each reader gives the people of every frame.

own: {"format", "image_size", "fps", "names", "frames": [{"keypoints": [[x, y, confidence], ...] or null}, ...]}
    with several people {"people": [{"id", "keypoints"}, ...]} for a frame
OpenPose folders, also written by Pose2Sim and Sports2D: a file `<video>_<frame number>_keypoints.json` (or
    `..._000012.json`) a frame, {"people": [{"person_id": [-1], "pose_keypoints_2d": [x, y, c, ...]}, ...]}
AlphaPose: a list of {"image_id": "12.jpg", "keypoints": [x, y, c, ...], "score", "idx", "box"}; with its options `cmu`
    and `open` an object of frames with "bodies" or "people" instead.
MMPose (RTMPose): a list of {"frame_id", "instances": [{"keypoints": [[x, y], ...], "keypoint_scores": [...]}]}, also
    inside {"meta_info", "instance_info": [...]}.
DeepLabCut's csv, COCO data sets, arrays of NumPy and of rtmlib: the files keypoints_*.py beside this one.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.cameras_json import image_size
from estimator.data.formats.checked_json import mapping, member, number_between, numbers, read_json, sequence
from estimator.data.formats.keypoints_coco import is_coco, read_coco
from estimator.data.formats.keypoints_deeplabcut import read_deeplabcut
from estimator.data.formats.keypoints_npy import read_arrays
from estimator.data.formats.keypoints_people import Person
from estimator.data.formats.keypoints_reading import MOST_FRAMES, Reading, as_landmarks, frame_numbers
from estimator.data.formats.keypoints_rtmlib import is_rtmlib, read_rtmlib
from estimator.data.media.clip import FPS_RANGE, listed
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError

KINDS = "kinemode's JSON, OpenPose, Pose2Sim, Sports2D, AlphaPose, MMPose, rtmlib, COCO, DeepLabCut csv, npy and npz"


def read_layout(path: Path, layout: str) -> Reading:
    """Read a keypoint file or folder of any known layout."""
    if layout != "auto" and layout not in FORMATS:
        raise InputError(path, f"no layout {layout!r}", remedy=f"one of auto, {', '.join(FORMATS)}")
    if not path.exists():
        raise InputError(path, "no such file or folder")
    if path.is_dir():
        return _folder(path, layout)
    reading = Reading(path, layout)
    kind = _kind_of(path)
    if kind == "arrays":
        read_arrays(reading)
    elif kind == "DeepLabCut":
        read_deeplabcut(reading)
    else:
        _json_of(read_json(path), reading)
    return reading


def _kind_of(path: Path) -> str:
    """One of "arrays", "DeepLabCut" and "JSON", by how a file begins; raises InputError for what is none."""
    try:
        with path.open("rb") as file:
            start = file.read(64)
    except (OSError, ValueError):
        return "JSON"  # whose reader says why it cannot be read
    if start.startswith((b"\x93NUMPY", b"PK\x03\x04", b"PK\x05\x06")):
        return "arrays"
    if start.removeprefix(b"\xef\xbb\xbf").startswith(b"scorer,"):
        return "DeepLabCut"
    if start.startswith(b"\x89HDF"):
        remedy = "DeepLabCut writes csv with analyze_videos(..., save_as_csv=True): give that"
        raise InputError(path, "is an HDF5 file, which is not read", remedy=remedy)
    if path.suffix.lower() in (".csv", ".npy", ".npz"):
        problem = "does not begin as DeepLabCut's csv does, with 'scorer,'" if path.suffix.lower() == ".csv" else ""
        raise InputError(path, problem or "does not begin as NumPy's files do", remedy=f"read are {KINDS}")
    return "JSON"


def _json_of(value: Any, reading: Reading) -> None:
    path = reading.source
    if is_coco(value):
        read_coco(value, reading)
    elif is_rtmlib(value):
        read_rtmlib(value, reading)
    elif isinstance(value, list):
        _listed_frames(value, reading)
    elif isinstance(value, dict) and "frames" in value:
        _own(value, reading)
    elif isinstance(value, dict) and "instance_info" in value:
        _mmpose(sequence(value["instance_info"], path, "instance_info"), reading, "instance_info")
    elif isinstance(value, dict) and "people" in value:
        reading.add(0, _people(value, reading, path, ""))
    elif isinstance(value, dict) and value and all(isinstance(v, dict) for v in value.values()):
        _frames_by_name(value, reading)
    else:
        raise InputError(path, "is no keypoint file of a known layout", remedy=f"read are {KINDS}")


def _own(value: Mapping[str, Any], reading: Reading) -> None:
    path = reading.source
    _own_header(value, reading)
    frames = sequence(value["frames"], path, "frames")
    reading.count = len(frames)
    for i, frame in enumerate(frames):
        place = f"frame {i}"
        told = {"keypoints": None} if frame is None else mapping(frame, path, place)
        if "people" in told:
            reading.add(i, _own_people(told["people"], reading, place))
            continue
        keypoints = member(told, "keypoints", path, place)
        people = [] if keypoints is None else [reading.person(keypoints, None, path, f"{place}, person 0")]
        reading.add(i, people)


def _own_people(value: Any, reading: Reading, place: str) -> list[Person | None]:
    path = reading.source
    people: list[Person | None] = []
    for k, person in enumerate(sequence(value, path, f"{place} people")):
        where = f"{place}, person {k}"
        told = mapping(person, path, where)
        people.append(reading.person(member(told, "keypoints", path, where), told.get("id"), path, where))
    return people


def _own_header(value: Mapping[str, Any], reading: Reading) -> None:
    path = reading.source
    if value.get("image_size") is not None:
        reading.image_size = image_size(value["image_size"], path, "image_size")
    if value.get("fps") is not None:
        reading.fps = number_between(value["fps"], *FPS_RANGE, path, "fps")
    declared = value.get("format")
    if declared is not None and not isinstance(declared, str):
        raise InputError(path, "a name is needed", place="format")
    if reading.layout == "auto" and declared in FORMATS:
        reading.layout = declared
    elif reading.layout == "auto" and value.get("names") is not None:
        names = sequence(value["names"], path, "names")
        if not names or not all(isinstance(name, str) and name for name in names):
            raise InputError(path, "a list of names is needed, one for each keypoint", place="names")
        reading.layout = declared or "named"
        exact = declared == "landmarks"  # a subject's own names, which may differ from every detector's
        reading.names = tuple(names) if exact else as_landmarks(names)


def _listed_frames(value: list[Any], reading: Reading) -> None:
    """AlphaPose's list of detections or MMPose's list of frames."""
    path = reading.source
    if not value:
        raise InputError(path, "has no detection in it")
    if isinstance(value[0], dict) and "instances" in value[0]:
        _mmpose(value, reading, "")
        return
    entries = [mapping(v, path, f"entry {i}") for i, v in enumerate(value)]
    keys = [str(member(e, "image_id", path, f"entry {i}")) for i, e in enumerate(entries)]
    numbering = frame_numbers(keys, path)
    for i, (entry, key) in enumerate(zip(entries, keys, strict=True)):
        frame = numbering[key]
        place = f"entry {i} (frame {frame})"
        flat = member(entry, "keypoints", path, place)
        id = entry.get("idx", entry.get("track_id"))
        reading.add(frame, [reading.person(flat, id, path, f"{place}.keypoints")])


def _mmpose(frames: list[Any], reading: Reading, where: str) -> None:
    path = reading.source
    entries = [mapping(f, path, f"{where}[{i}]") for i, f in enumerate(frames)]
    ids = [e.get("frame_id", i) for i, e in enumerate(entries)]
    if not all(isinstance(i, int) and 0 <= i < MOST_FRAMES for i in ids):
        raise InputError(path, "a frame_id is no frame number", place=where)
    first = 1 if where and ids and min(ids) == 1 else 0  # the top-down demo counts its frames from 1
    for number, entry in zip(ids, entries, strict=True):
        people = sequence(member(entry, "instances", path, f"frame {number}"), path, f"frame {number}")
        for k, person in enumerate(people):
            place = f"frame {number}, person {k}"
            person = mapping(person, path, place)
            xy = numbers(member(person, "keypoints", path, place), path, place, finite=False)
            scores = numbers(member(person, "keypoint_scores", path, place), path, place, finite=False)
            if xy.ndim != 2 or xy.shape[1] != 2 or scores.shape != xy.shape[:1]:
                raise InputError(path, "needs [x, y] and a score for each keypoint", place=place)
            flat = np.column_stack([xy, scores]).ravel().tolist()
            reading.add(number - first, [reading.person(flat, person.get("track_id"), path, place)])
        reading.add(number - first, [])


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


def _folder(path: Path, layout: str) -> Reading:
    files = sorted(p for p in listed(path) if p.suffix.lower() == ".json")
    if not files:
        raise InputError(
            path, "has no .json file", remedy="a folder has one JSON file a frame, as OpenPose writes them"
        )
    reading = Reading(path, layout)
    numbering = frame_numbers([f.stem for f in files], path)
    seen: dict[int, Path] = {}
    for file in files:
        number = numbering[file.stem]
        if number in seen:
            raise InputError(file, f"is frame {number}, and so is {seen[number].name}")
        seen[number] = file
        reading.add(number, _people(read_json(file), reading, file, f"frame {number}"))
    return reading
