"""Keypoints of MMPose (RTMPose).

A list of {"frame_id", "instances": [{"keypoints": [[x, y], ...], "keypoint_scores": [...]}]}, also inside
{"meta_info", "instance_info": [...]}.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.data.formats.checked_json import mapping, member, numbers, sequence
from estimator.data.formats.keypoint_format import KeypointFile, KeypointFormat
from estimator.data.formats.keypoints_reading import MOST_FRAMES, Reading
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
