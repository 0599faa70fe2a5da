"""Output of rtmlib's models, `keypoints, scores = body(picture)`, unchanged: for every frame keypoints (N, K, 2) [px]
and scores (N, K) of N people.

As JSON a list of {"keypoints", "scores"}, one a frame, or one object whose two lists have an entry a frame; a frame may
have "frame_id" (or "frame") and "track_ids" (N), as rtmlib's PoseTracker keeps them. As arrays in an npz: see
keypoints_npy. The OpenPose-like files that Sports2D and Pose2Sim write with it are folders of OpenPose's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator.data.formats.checked_json import mapping, member, number_between, numbers, sequence
from estimator.data.formats.keypoint_format import KeypointFormat
from estimator.data.formats.keypoints_reading import MOST_FRAMES, Reading
from estimator.data.media.clip import FPS_RANGE
from humanoid.support.errors import InputError


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
