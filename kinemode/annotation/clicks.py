"""Clicked landmarks: from files and from the page into a keypoint track, and back to what the page shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.checked_json import mapping, shaped
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints, read_layout
from estimator.data.sequence import common_landmarks
from estimator.data.timing import length_notes
from humanoid.support.errors import InputError

LAYOUT = "landmarks"
"""Layout of files whose keypoints are a subject's landmarks, one by one."""

_PAGE = "the page"


def no_clicks(names: Sequence[str], frame_count: int, image_size: tuple[int, int], fps: float | None) -> KeypointTrack:
    """A track of a clip's length, T frames, in which none of the L landmarks is set; fps None where it is unknown."""
    pixels, confidence = np.full((frame_count, len(names), 2), np.nan), np.zeros((frame_count, len(names)))
    return KeypointTrack(LAYOUT, tuple(names), pixels, confidence, image_size, fps)


def load_clicks(path: str | Path, like: KeypointTrack) -> KeypointTrack:
    """Clicks from a file written earlier; `like` has the landmarks and the frames they have to be of.

    Every point counts, also one alone in its frame, which `load_keypoints` would leave out.
    Raises InputError where the file is another program's, another clip's or another subject's.
    """
    reading = read_layout(Path(path), "auto")
    if reading.layout != LAYOUT:
        remedy = "name another --out; --keypoints takes a detector's points to correct"
        raise InputError(path, f"holds {reading.layout} keypoints, not clicks: they are not replaced", remedy=remedy)
    unknown = [str(name) for name in reading.names if name not in like.names]
    if unknown:
        remedy = f"name its --subject, or another --out; landmarks: {', '.join(map(str, like.names))}"
        raise InputError(path, f"has landmarks the subject lacks: {', '.join(unknown)}", remedy=remedy)
    if reading.count != like.frame_count:
        problem = f"is of a clip with {reading.count} frames, this one has {like.frame_count}"
        raise InputError(path, problem, remedy="name another --out")
    _same_size(reading.image_size, like, path)
    clicked, columns = np.full((*like.confidence.shape, 3), np.nan), [like.names.index(n) for n in reading.names]
    for t, people in reading.frames.items():
        for person in people:
            clicked[t, columns] = person.points
    return replace(like, pixels=clicked[..., :2], confidence=np.nan_to_num(clicked[..., 2]), source=str(path))


def corrected_from(clicks: KeypointTrack, path: str | Path) -> KeypointTrack:
    """Clicks with a detector's keypoints in the frames that have no click; notes list what was left out.

    Raises InputError where the keypoint file cannot be read, has another image size or too few of the landmarks.
    """
    detected = load_keypoints(path, image_size=clicks.image_size)
    _same_size(detected.image_size, clicks, path)
    here, there = map(np.array, common_landmarks([str(name) for name in clicks.names], detected))
    count = min(clicks.frame_count, detected.frame_count)
    frames = np.flatnonzero(~(clicks.confidence[:count] > 0.0).any(axis=1))
    pixels, confidence = clicks.pixels.copy(), clicks.confidence.copy()
    pixels[np.ix_(frames, here)] = detected.pixels[np.ix_(frames, there)]
    confidence[np.ix_(frames, here)] = detected.confidence[np.ix_(frames, there)]
    notes = (*detected.notes, *length_notes({Path(path).name: detected}, clicks.frame_count))
    return replace(clicks, pixels=pixels, confidence=confidence, notes=notes)


def inside_only(clicks: KeypointTrack) -> KeypointTrack:
    """Clicks without the points outside the image, which cannot have been clicked; a note counts them."""
    outside = (clicks.confidence > 0.0) & ~_inside(clicks.pixels, clicks.image_size)
    if not outside.any():
        return clicks
    pixels = np.where(outside[..., None], np.nan, clicks.pixels)
    note = f"points outside the image left out ({int(outside.sum())} times)"
    return replace(
        clicks, pixels=pixels, confidence=np.where(outside, 0.0, clicks.confidence), notes=(*clicks.notes, note)
    )


def clicks_from_page(frames: Any, like: KeypointTrack) -> KeypointTrack:
    """Clicks from the page's {"frame": {"landmark": [x, y, confidence]}}, with the landmarks and frames of `like`.

    Raises InputError: no such frame or landmark, no finite number, a point outside the image, a confidence that is
    not above 0 and up to 1.
    """
    pixels, confidence = np.full_like(like.pixels, np.nan), np.zeros_like(like.confidence)
    column = {name: i for i, name in enumerate(like.names)}
    for key, points in mapping(frames, _PAGE, "frames").items():
        t = _frame_number(key, like.frame_count)
        for name, point in mapping(points, _PAGE, f"frame {t}").items():
            if name not in column:
                remedy = f"landmarks: {', '.join(map(str, like.names))}"
                raise InputError(_PAGE, f"there is no landmark {name!r}", place=f"frame {t}", remedy=remedy)
            value = shaped(point, (3,), _PAGE, f"frame {t}, {name}")
            if not _inside(value[:2], like.image_size):
                size = "{} x {}".format(*like.image_size or ())
                raise InputError(_PAGE, f"is outside the image of {size} pixels", place=f"frame {t}, {name}")
            if not 0.0 < value[2] <= 1.0:
                raise InputError(_PAGE, "a confidence above 0 and up to 1 is needed", place=f"frame {t}, {name}")
            pixels[t, column[name]], confidence[t, column[name]] = value[:2], value[2]
    return replace(like, pixels=pixels, confidence=confidence)


def clicks_for_page(clicks: KeypointTrack) -> dict[str, dict[str, list[float]]]:
    """The input of `clicks_from_page`."""
    frames: dict[str, dict[str, list[float]]] = {}
    for t, j in np.argwhere(clicks.confidence > 0.0).tolist():
        point = [*clicks.pixels[t, j].tolist(), float(clicks.confidence[t, j])]
        frames.setdefault(str(t), {})[str(clicks.names[j])] = point
    return frames


def _frame_number(key: str, count: int) -> int:
    if not (key.isascii() and key.isdecimal() and len(key) < 10 and int(key) < count):
        raise InputError(_PAGE, f"there is no frame {key[:20]!r}", place="frames", remedy=f"0 to {count - 1}")
    return int(key)


def _inside(pixels: np.ndarray, image_size: tuple[int, int] | None) -> np.ndarray:
    """Which points (..., 2) lie on the image; its pixels' centres are at integers."""
    return np.all((pixels >= -0.5) & (pixels <= np.array(image_size) - 0.5), axis=-1)


def _same_size(size: tuple[int, int] | None, like: KeypointTrack, path: str | Path) -> None:
    if size is not None and size != like.image_size:
        here, there = ("{} x {}".format(*s) for s in (like.image_size or (), size))
        raise InputError(path, f"is of images of {there} pixels, the clip has {here}")
