"""Keypoints of Ultralytics' YOLO pose models.

As JSON what `Results.to_json()` gives: for each picture a list of {"name", "class", "confidence", "box", "track_id",
"keypoints": {"x": [...], "y": [...], "visible": [...]}}, in pixels, or in fractions of the picture (`normalize=True`).
A file has a list of these lists, or of their texts, one a frame; a file with one of them is one picture; a folder has
such a file a frame.

As text a folder of `save_txt`: a file a frame, `walk_12.txt`, with a line for each person: its class, the box (4), x, y
and confidence (or x, y) of each keypoint in fractions of the picture, the person's confidence (`save_conf`) and number
(of a tracker). Frames without a person have no file. Those of a video are numbered from 1.

A point at exactly (0, 0) is missing whatever its confidence: so Ultralytics writes those that it is unsure of. The 17
keypoints are COCO's, those of another model are named beside the file (`estimator.data.formats.keypoints_names`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.checked_json import decoded, mapping, member, numbers, parsed_json, read_json, sequence
from estimator.data.formats.keypoints_names import named_landmarks, naming_beside
from estimator.data.formats.keypoints_reading import (
    KeypointFile,
    KeypointFormat,
    Person,
    Reading,
    cleaned,
    frame_of_pictures,
    person_id,
)
from estimator.data.media.clip import listed
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError, shown
from humanoid.support.files import read_bytes

_BOX = 5  # numbers of a line before its keypoints: the class and the box
_USUAL = "coco17"
_FRACTION = 2.0  # coordinates up to here, all of a file, are fractions: no person is two pixels large
_MOST_BYTES = 1_000_000  # of the labels of one picture
_PADDED = re.compile(r"(?<!\d)0\d+$")


def is_ultralytics(value: Any) -> bool:
    """Whether a JSON value is one picture's people, or a list of such."""
    frames = value if isinstance(value, list) else [value]
    first = next(filter(None, map(_frame_value, frames)), None)
    nobody = first is None and bool(frames) and all(isinstance(frame, (list, str)) for frame in frames)
    return nobody or _is_frame(first) or _is_frame(value)


def _frame_value(frame: Any) -> Any:
    """A frame's people, where it is a text of JSON those in it; an object of another text."""
    try:
        return parsed_json(frame, "") if isinstance(frame, str) else frame
    except InputError:
        return {"text": frame}


def _is_frame(value: Any) -> bool:
    first = value[0] if isinstance(value, list) and value else None
    keypoints = first.get("keypoints") if isinstance(first, dict) else None
    return isinstance(keypoints, dict) and {"x", "y"} <= keypoints.keys()


def _read_value(value: Any, reading: Reading) -> None:
    """Frames of a file; one picture's people count as frame 0."""
    path = reading.source
    value = parsed_json(value, path) if isinstance(value, str) else value
    if _is_frame(value):
        reading.notes.say(f"{path.name} is of one picture: a list of such lists has one a frame")
        value = [value]
    for i, frame in enumerate(sequence(value, path)):
        _read_frame(i, frame, reading, path, f"frame {i}")
    reading.count = len(value)


def _read_frame(number: int, frame: Any, reading: Reading, source: Path, place: str) -> None:
    people = parsed_json(frame, source) if isinstance(frame, str) else frame
    reading.add(number, [])
    for k, person in enumerate(sequence([] if people is None else people, source, place)):
        where = f"{place}, person {k}"
        reading.add(number, [_of_object(mapping(person, source, where), reading, source, where)])


def _of_object(person: Mapping[str, Any], reading: Reading, source: Path, place: str) -> Person | None:
    keypoints = mapping(member(person, "keypoints", source, place), source, f"{place}.keypoints")
    x, y = (numbers(member(keypoints, axis, source, place), source, place, finite=False) for axis in "xy")
    visible = keypoints.get("visible")
    sure = np.ones(x.shape) if visible is None else numbers(visible, source, place, finite=False)
    if x.ndim != 1 or not x.shape == y.shape == sure.shape:
        problem = f"has {x.size} x, {y.size} y and {sure.size} confidences"
        raise InputError(source, problem, place=f"{place}.keypoints", remedy="one of each is needed for every keypoint")
    return _person(np.column_stack([x, y, sure]), person.get("track_id"), reading, source, place)


def _person(points: np.ndarray, id: Any, reading: Reading, source: Path, place: str) -> Person | None:
    """A person of points (K, 3), those at (0, 0) missing; None where there are no points."""
    if not len(points):
        return None
    if not reading.names:
        _set_names(reading, len(points), source, place)
    if len(points) != len(reading.names):
        problem = f"has {len(points)} keypoints, {len(reading.names)} are expected"
        raise InputError(source, problem, place=place)
    nowhere = (points[:, :2] == 0.0).all(axis=1)
    reading.notes.add("points at exactly (0, 0) are missing", int((nowhere & (points[:, 2] > 0.0)).sum()))
    points[nowhere] = np.nan, np.nan, 0.0
    return Person(cleaned(points, reading.notes, source, place), person_id(id))


def _set_names(reading: Reading, count: int, source: Path, place: str) -> None:
    own = naming_beside(reading.source).names
    if own is not None and reading.layout == "auto":
        reading.layout, reading.names = "named", named_landmarks(own, reading)
    else:
        reading.name_by_size(3 * count, source, place)


def _read_folder(path: Path, reading: Reading) -> None:
    texts, objects = _files(path, ".txt"), _files(path, ".json")
    if texts and objects:
        raise InputError(path, "has .txt and .json files", remedy="keep those of one kind")
    files = texts or objects
    numbering = frame_of_pictures([file.stem for file in files], path)
    if texts:
        _read_labels(texts, _counted_from_one(numbering, reading), reading)
        return
    for file in objects:
        number = numbering[file.stem]
        _read_frame(number, read_json(file), reading, file, f"frame {number}")


def _counted_from_one(numbering: Mapping[str, int], reading: Reading) -> dict[str, int]:
    """Frames from 0: those of a video's labels have the names' numbers less one, those of pictures the numbers."""
    of_video = min(numbering.values()) > 0 and not any(_PADDED.search(stem) for stem in numbering)
    if of_video:
        reading.notes.say("the labels are those of a video, whose first frame Ultralytics numbers 1")
    return {stem: number - of_video for stem, number in numbering.items()}


def _read_labels(files: Sequence[Path], numbering: Mapping[str, int], reading: Reading) -> None:
    lines = {file: _lines(file) for file in files}
    count = _keypoint_count(reading)
    widths = {len(line) for of_file in lines.values() for line in of_file}
    both = any((width - _BOX) % count == 2 for width in widths)  # a confidence and a number
    last = [line[-1] for of_file in lines.values() for line in of_file if (len(line) - _BOX) % count == 1]
    numbered = not both and all(value >= 1.0 and value % 1.0 == 0.0 for value in last)
    for file, of_file in lines.items():
        number = numbering[file.stem]
        reading.add(number, [])
        for k, line in enumerate(of_file):
            points, more = _points(line, count, file, f"line {k + 1}")
            id = more[-1] if len(more) == 2 or (len(more) == 1 and numbered) else None
            reading.add(number, [_person(points, id, reading, file, f"line {k + 1}")])


def _keypoint_count(reading: Reading) -> int:
    """Number of keypoints of a line: by the names beside the folder, or by the given layout."""
    own = naming_beside(reading.source).names
    if own is not None and reading.layout == "auto":
        return len(own)
    return len(FORMATS[_USUAL if reading.layout == "auto" else reading.layout])


def _points(line: np.ndarray, count: int, file: Path, place: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 3) of a line, and the numbers behind them."""
    size, more = divmod(len(line) - _BOX, count)
    if size not in (2, 3) or more > 2:
        problem = f"has {len(line)} numbers, which are not a class, a box and {count} keypoints"
        remedy = f"{_BOX + 2 * count} or {_BOX + 3 * count}, and two more at most"
        raise InputError(file, problem, place=place, remedy=remedy)
    points = line[_BOX : _BOX + size * count].reshape(count, size)
    sure = points[:, 2:] if size == 3 else np.ones((count, 1))
    return np.hstack([points[:, :2], sure]), line[_BOX + size * count :]


def _lines(file: Path) -> list[np.ndarray]:
    """The numbers of every line; an empty file has none."""
    content = read_bytes(file, most=_MOST_BYTES)
    if not content.strip():
        return []
    lines = decoded(content, file).splitlines()
    return [_numbers(line.split(), file, f"line {i}") for i, line in enumerate(lines, 1) if line.strip()]


def _numbers(words: Sequence[str], file: Path, place: str) -> np.ndarray:
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        raise InputError(file, f"has words among its numbers: {shown(' '.join(words))}", place=place) from None


def _files(path: Path, ending: str) -> list[Path]:
    return sorted(file for file in listed(path) if file.suffix.lower() == ending)


def _recognises(file: KeypointFile) -> bool:
    if not file.is_folder:
        return is_ultralytics(file.json)
    objects = _files(file.path, ".json")
    if not objects:
        return bool(_files(file.path, ".txt"))
    first = next((value for value in map(read_json, objects) if value != []), None)
    return _is_frame(_frame_value(first))


def _read(file: KeypointFile, reading: Reading) -> None:
    if file.is_folder:
        _read_folder(file.path, reading)
    else:
        _read_value(file.json, reading)
    people = [person for frame in reading.frames.values() for person in frame if person.size > 0.0]
    reading.fractions = bool(people) and all(float(np.nanmax(np.abs(p.points[:, :2]))) <= _FRACTION for p in people)


ULTRALYTICS = KeypointFormat("Ultralytics YOLO", _recognises, _read)
