"""kinemode's own keypoint files.

{"format", "image_size", "fps", "names", "frames": [{"keypoints": [[x, y, confidence], ...] or null}, ...]}; with
several people {"people": [{"id", "keypoints"}, ...]} for a frame.
Beside its keypoints a person may have "world": [[x, y, z], ...], each keypoint's place in space, lifted from this
picture by a network [m]: x right, y down, z away from the camera, about the middle of the hips, at most 3 m from there.
MediaPipe's world landmarks are such; those of any other network work too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from estimator.data.formats.cameras_json import image_size
from estimator.data.formats.checked_json import check_members, mapping, member, number_between, sequence, shaped
from estimator.data.formats.keypoints_reading import KeypointFormat, Person, Reading, as_landmarks
from estimator.data.media.clip import FPS_RANGE
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError

FARTHEST = 3.0  # m, of a point from the middle of the hips


def _own(value: Mapping[str, Any], reading: Reading) -> None:
    path = reading.source
    check_members(value, ("format", "image_size", "fps", "names", "frames"), path, "", near=True)
    _own_header(value, reading)
    frames = sequence(value["frames"], path, "frames")
    reading.count = len(frames)
    for i, frame in enumerate(frames):
        place = f"frame {i}"
        content = {"keypoints": None} if frame is None else mapping(frame, path, place)
        if content.keys() - {"keypoints", "people", "world"}:
            check_members(content, ("keypoints", "people", "world"), path, place, near=True)
        if "people" in content:
            reading.add(i, _own_people(content["people"], reading, place))
            continue
        keypoints = member(content, "keypoints", path, place)
        reading.add(i, [] if keypoints is None else [_own_person(content, reading, f"{place}, person 0")])


def _own_people(value: Any, reading: Reading, place: str) -> list[Person | None]:
    path = reading.source
    people: list[Person | None] = []
    for k, person in enumerate(sequence(value, path, f"{place} people")):
        where = f"{place}, person {k}"
        content = mapping(person, path, where)
        if content.keys() - {"id", "keypoints", "world"}:
            check_members(content, ("id", "keypoints", "world"), path, where, near=True)
        people.append(_own_person(content, reading, where))
    return people


def _own_person(content: Mapping[str, Any], reading: Reading, place: str) -> Person | None:
    path = reading.source
    person = reading.person(member(content, "keypoints", path, place), content.get("id"), path, place)
    if person is None or content.get("world") is None:
        return person
    place = f"{place}, world"
    world = shaped(content["world"], (len(reading.names), 3), path, place)
    if np.abs(world).max() > FARTHEST:
        problem = f"has {np.abs(world).max():g} m from the hips, at most {FARTHEST:g} m is taken"
        raise InputError(path, problem, place=place, remedy="metres are needed")
    return replace(person, world=world)


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


OWN = KeypointFormat(
    "kinemode JSON",
    lambda file: isinstance(file.json, dict) and "frames" in file.json,
    lambda file, reading: _own(file.json, reading),
)
