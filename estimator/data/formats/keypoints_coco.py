"""COCO data sets: {"images": [...], "annotations": [...], "categories": [...]}, as annotation tools write them too.

An annotation's `keypoints` are x, y, v for each name of its category: v is 0 for a point that is not labelled, 1 for
one that is labelled and hidden, 2 for a visible one (T.-Y. Lin et al., Microsoft COCO, ECCV 2014; the format is
described at cocodataset.org). Detectors write their confidence in its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator.data.formats.cameras_json import image_size
from estimator.data.formats.checked_json import mapping, member, number_between, numbers, sequence
from estimator.data.formats.keypoints_names import named_landmarks
from estimator.data.formats.keypoints_reading import (
    MOST_FRAMES,
    KeypointFormat,
    Person,
    Reading,
    checked_names,
    cleaned,
    frame_of_pictures,
    person_id,
)
from humanoid.subject.landmarks import FORMATS
from humanoid.support.errors import InputError, shown

_HIDDEN = 0.5  # confidence of a point that was annotated without being visible
_FLAGS = (0.0, 1.0, 2.0)


def is_coco(value: Any) -> bool:
    """Whether a JSON value is a COCO data set."""
    return isinstance(value, dict) and {"images", "annotations"} <= value.keys()


def read_coco(value: Mapping[str, Any], reading: Reading) -> None:
    """Read a data set of one camera: the pictures in the order of `frame_id`, of the numbers their file names end with,
    else of their ids; people by `track_id`.

    Confidences: 1 for visible points, 0.5 for hidden ones, times the person's `score` where there is one; of detectors
    what they wrote.

    Raises
    ------
    InputError: naming the annotation; also pictures of several sizes or videos, and keypoints of several categories.
    """
    path = reading.source
    images = [mapping(v, path, f"images[{i}]") for i, v in enumerate(sequence(value["images"], path, "images"))]
    listed = sequence(value["annotations"], path, "annotations")
    annotations = [mapping(v, path, f"annotations[{i}]") for i, v in enumerate(listed)]
    frame_of = _frames(images, reading)
    kept = [(i, a) for i, a in enumerate(annotations) if a.get("keypoints") and a.get("iscrowd") in (None, 0, False)]
    if not kept:
        raise InputError(path, "has no annotation with keypoints", place="annotations")
    _set_names(value, [a for _, a in kept], reading)
    for frame in frame_of.values():
        reading.add(frame, [])
    points = {i: _points(a["keypoints"], i, reading) for i, a in kept}
    flags = all(np.isin(p[:, 2], _FLAGS).all() for p in points.values())
    sure = max((p[:, 2].max(initial=0.0) for p in points.values()), default=0.0)
    for i, annotation in kept:
        place = f"annotations[{i}]"
        image = _key(member(annotation, "image_id", path, place))
        if image not in frame_of:
            raise InputError(path, f"its image_id {shown(annotation['image_id'])} matches no picture", place=place)
        if flags:
            points[i][:, 2] = _confidence(points[i][:, 2], sure) * _score(annotation, path, place)
        reading.add(frame_of[image], [_person(points[i], annotation, reading, place)])


def _points(flat: Any, i: int, reading: Reading) -> np.ndarray:
    place = f"annotations[{i}].keypoints"
    values = numbers(flat, reading.source, place, finite=False)
    if not reading.names:
        reading.name_by_size(values.size, reading.source, place)
    if values.size != 3 * len(reading.names):
        problem = f"{3 * len(reading.names)} numbers are needed, found {values.size}"
        raise InputError(reading.source, problem, place=place)
    return values.reshape(-1, 3)


def _confidence(flags: np.ndarray, sure: float) -> np.ndarray:
    """Confidence of visibility flags (J,); where none in the file is 2, 1 means that a point is present and no more."""
    return np.where(flags == 0.0, 0.0, np.where(flags == sure, 1.0, _HIDDEN))


def _score(annotation: Mapping[str, Any], path: Any, place: str) -> float:
    score = annotation.get("score")
    return 1.0 if score is None else number_between(score, 0.0, 1.0, path, f"{place}.score")


def _person(points: np.ndarray, annotation: Mapping[str, Any], reading: Reading, place: str) -> Person:
    attributes = annotation.get("attributes")
    also = attributes.get("track_id") if isinstance(attributes, dict) else None
    id = person_id(annotation.get("track_id", also))
    return Person(cleaned(points, reading.notes, reading.source, place), id)


def _set_names(value: Mapping[str, Any], annotations: Sequence[Mapping[str, Any]], reading: Reading) -> None:
    """The keypoints' names, from the category of the annotations; without one from the count of numbers."""
    path = reading.source
    used = {_key(a.get("category_id")) for a in annotations}
    listed = sequence(value.get("categories") or [], path, "categories")
    of_used = {}
    for i, category in enumerate(listed):
        category = mapping(category, path, f"categories[{i}]")
        if category.get("keypoints") and (_key(category.get("id")) in used or len(listed) == 1):
            of_used[str(category.get("name", i))] = checked_names(
                category["keypoints"], path, f"categories[{i}].keypoints"
            )
    if len(set(of_used.values())) > 1:
        remedy = "leave only one category in the file"
        raise InputError(path, f"has keypoints of {', '.join(of_used)}, whose names differ", remedy=remedy)
    own = next(iter(of_used.values()), None)
    if own is None or reading.layout != "auto":
        return
    reading.names = named_landmarks(own, reading)
    known = [layout for layout, names in FORMATS.items() if names == reading.names]
    reading.layout = known[0] if known else "COCO"


def _frames(images: Sequence[Mapping[str, Any]], reading: Reading) -> dict[str, int]:
    """The frame of each picture by its id; notes the pictures' size."""
    path = reading.source
    ids = [_key(member(image, "id", path, f"images[{i}]")) for i, image in enumerate(images)]
    twice = next((id for i, id in enumerate(ids) if id in ids[:i]), None) if len(set(ids)) < len(ids) else None
    if twice is not None:
        raise InputError(path, f"two pictures have the id {shown(twice)}", place="images")
    videos = {_key(image["video_id"]) for image in images if image.get("video_id") is not None}
    if len(videos) > 1:
        raise InputError(path, f"has {len(videos)} videos", place="images", remedy="a file is of one camera's clip")
    _set_size(images, reading)
    numbered = [image.get("frame_id") for image in images]
    if all(isinstance(n, int) and not isinstance(n, bool) and 0 <= n < MOST_FRAMES for n in numbered):
        if len(set(numbered)) < len(numbered):
            raise InputError(path, "two pictures have the same frame_id", place="images")
        return dict(zip(ids, map(int, numbered), strict=True))  # type: ignore[arg-type]
    files = [image.get("file_name") for image in images]
    if all(isinstance(file, str) and file for file in files) and any(c.isdigit() for file in files for c in str(file)):
        of_file = frame_of_pictures([str(file) for file in files], path)
        return {id: of_file[str(file)] for id, file in zip(ids, files, strict=True)}
    return {id: i for i, id in enumerate(sorted(ids, key=_order))}


def _set_size(images: Sequence[Mapping[str, Any]], reading: Reading) -> None:
    pairs = [[image["width"], image["height"]] for image in images if "width" in image and "height" in image]
    sizes = {image_size(pair, reading.source, "images") for pair in pairs}
    if len(sizes) > 1:
        some = ", ".join(sorted(f"{w}x{h}" for w, h in sizes)[:3])
        remedy = "a file is of one camera's clip"
        raise InputError(reading.source, f"has pictures of several sizes ({some})", place="images", remedy=remedy)
    reading.image_size = next(iter(sizes), None)


def _key(value: Any) -> str:
    """An id as text, the same whether it was written as a number or as text."""
    return value if isinstance(value, str) else str(person_id(value))


def _order(id: str) -> tuple[int, int, str]:
    return (0, int(id), "") if id.isascii() and id.isdigit() and len(id) < 20 else (1, 0, id)


COCO = KeypointFormat("COCO", lambda file: is_coco(file.json), lambda file, reading: read_coco(file.json, reading))
