"""Keypoints of MMPose and of rtmlib, which runs its models (RTMPose).

MMPose: a list of {"frame_id", "instances": [{"keypoints": [[x, y], ...], "keypoint_scores": [...]}]}, also inside
{"meta_info", "instance_info": [...]}.

rtmlib: `keypoints, scores = body(picture)`, unchanged: for every frame keypoints (N, K, 2) [px] and scores (N, K) of N
people. As JSON a list of {"keypoints", "scores"}, one a frame, or one object whose two lists have an entry a frame; a
frame may have "frame_id" (or "frame") and "track_ids" (N), as rtmlib's PoseTracker keeps them. As arrays in an npz: see
keypoints_npy. The OpenPose-like files that Sports2D and Pose2Sim write with it are folders of OpenPose's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator.data.formats.checked_json import mapping, member, number_between, numbers, sequence
from estimator.data.formats.keypoints_reading import MOST_FRAMES, KeypointFile, KeypointFormat, Reading
from estimator.data.media.clip import FPS_RANGE
from humanoid.support.errors import InputError


def _mmpose(frames: list[Any], reading: Reading, where: str) -> None:
    path = reading.source
    entries = [mapping(f, path, f"{where}[{i}]") for i, f in enumerate(frames)]
    ids = [e.get("frame_id", i) for i, e in enumerate(entries)]
    if not all(isinstance(i, int) and 0 <= i < MOST_FRAMES for i in ids):
        raise InputError(path, "a frame_id is not a frame number", place=where)
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


def _is_mmpose(file: KeypointFile) -> bool:
    first = file.json[0] if isinstance(file.json, list) and file.json else None
    if isinstance(file.json, dict):
        return "instance_info" in file.json
    return isinstance(first, dict) and "instances" in first


def _read(file: KeypointFile, reading: Reading) -> None:
    if isinstance(file.json, dict):
        _mmpose(sequence(file.json["instance_info"], file.path, "instance_info"), reading, "instance_info")
    else:
        _mmpose(file.json, reading, "")


MMPOSE = KeypointFormat("MMPose", _is_mmpose, _read)


def is_rtmlib(value: Any) -> bool:
    """Whether a JSON value has keypoints and scores by frame."""
    first = value[0] if isinstance(value, list) and value else value
    return isinstance(first, dict) and {"keypoints", "scores"} <= first.keys() and "image_id" not in first


def read_rtmlib(value: Any, reading: Reading) -> None:
    """Read rtmlib's own arrays; the layout follows from the count of keypoints. Raises InputError with frame and
    person."""
    path = reading.source
    for i, frame in enumerate(value if isinstance(value, list) else _frames(value, reading)):
        place = f"frame {i}"
        _frame(i, mapping(frame, path, place), reading, place)


def _frames(value: Mapping[str, Any], reading: Reading) -> list[dict[str, Any]]:
    """One object's lists as a list of objects."""
    path = reading.source
    if value.get("fps") is not None:
        reading.fps = number_between(value["fps"], *FPS_RANGE, path, "fps")
    keypoints, scores = (sequence(value[name], path, name) for name in ("keypoints", "scores"))
    if len(keypoints) != len(scores):
        raise InputError(path, f"has keypoints of {len(keypoints)} frames and scores of {len(scores)}")
    return [{"keypoints": k, "scores": s} for k, s in zip(keypoints, scores, strict=True)]


def _frame(i: int, frame: Mapping[str, Any], reading: Reading, place: str) -> None:
    path = reading.source
    keypoints, scores = (sequence(member(frame, name, path, place), path, place) for name in ("keypoints", "scores"))
    number = frame.get("frame_id", frame.get("frame", i))
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < MOST_FRAMES:
        raise InputError(path, "frame_id is not a frame number", place=place)
    if number in reading.frames:
        raise InputError(path, f"the frame_id {number} appears twice", place=place)
    ids = sequence(frame.get("track_ids") or [None] * len(keypoints), path, place)
    if len(keypoints) != len(scores) or len(ids) != len(keypoints):
        problem = f"has {len(keypoints)} people's keypoints, {len(scores)} people's scores and {len(ids)} ids"
        raise InputError(path, problem, place=place)
    reading.add(number, [])
    for k, (own, sure, id) in enumerate(zip(keypoints, scores, ids, strict=True)):
        who = f"{place}, person {k}"
        xy = numbers(own, path, who, finite=False)
        confidence = numbers(sure, path, who, finite=False)
        if xy.ndim != 2 or xy.shape[1] != 2 or confidence.shape != xy.shape[:1]:
            raise InputError(path, "needs [x, y] and a score for each keypoint", place=who)
        reading.add(number, [reading.person(np.column_stack([xy, confidence]).ravel().tolist(), id, path, who)])


RTMLIB = KeypointFormat(
    "rtmlib", lambda file: is_rtmlib(file.json), lambda file, reading: read_rtmlib(file.json, reading)
)
