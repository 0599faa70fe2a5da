"""2D keypoints that a program has as arrays, made into the track that a file would give."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.formats.keypoints_people import LAYOUT_BY_COUNT, Notes, cleaned
from humanoid.subject.landmarks import FORMATS, landmark_name
from humanoid.support.errors import InputError

AUTO = "auto"
Layout = str | Sequence[str]
"""Names of keypoints: a key of `humanoid.subject.landmarks.FORMATS`, a name for each of them, or "auto", which finds
the format from their number."""


def keypoint_track(
    values: Any, layout: Layout = AUTO, *, fps: float | None = None, argument: str = "keypoints"
) -> KeypointTrack:
    """A track from an array (T, K, 2) of x, y [px], or (T, K, 3) with confidences from 0 to 1.

    A point is missing where both coordinates are NaN, or its confidence is 0. argument: the array's name in errors.

    Raises
    ------
    InputError: an array of another shape, or that is not of numbers; a layout that is unknown or has another number of
    keypoints; impossible coordinates.
    """
    points = keypoint_points(values, 3, "(T, K, 2) or (T, K, 3)", argument)
    name, names = named_layout(layout, points.shape[1], argument)
    notes = Notes()
    clean = np.array([cleaned(p, notes, argument, f"frame {i}") for i, p in enumerate(points)]).reshape(points.shape)
    pixels, confidence = np.ascontiguousarray(clean[..., :2]), np.ascontiguousarray(clean[..., 2])
    return KeypointTrack(name, names, pixels, confidence, None, fps, notes.texts, argument)


def keypoint_points(values: Any, axes: int, shape: str, argument: str) -> np.ndarray:
    """x, y and confidence (..., K, 3) from an array of some axes, the last of which has two or three numbers; a copy.

    Raises InputError, telling the `shape` that is taken, for any other.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(argument, "is not an array of numbers", remedy=f"give one of shape {shape}") from None
    if array.ndim != axes or array.shape[-1] not in (2, 3) or 0 in array.shape[-2:]:
        raise InputError(argument, f"has the shape {array.shape}", remedy=f"{shape} is needed")
    if array.shape[-1] == 2:
        seen = np.isfinite(array).any(axis=-1, keepdims=True).astype(np.float64)
        array = np.concatenate([array, seen], axis=-1)
    return array


def named_layout(layout: Layout, count: int | None, argument: str = "keypoints") -> tuple[str, tuple[str | None, ...]]:
    """The name of a layout and the landmark of each of its keypoints, None where none corresponds.

    count: how many there are; None where that is not known yet, with a layout that is not "auto". Raises InputError
    for a layout that is unknown or has another number of them.
    """
    if not isinstance(layout, str):
        names: tuple[str | None, ...] = tuple(landmark_name(name) or name for name in layout)
        name = "named"
    elif layout == AUTO:
        if count is None or 3 * count not in LAYOUT_BY_COUNT:
            raise InputError(argument, f"{count} keypoints fit no layout", remedy=f"layout: {_known()}")
        name = LAYOUT_BY_COUNT[3 * count]
        names = FORMATS[name]
    elif layout in FORMATS:
        name, names = layout, FORMATS[layout]
    else:
        raise InputError("layout", f"there is no {layout!r}", remedy=_known())
    if count not in (None, len(names)):
        problem = f"has {count} keypoints, the layout {name} {len(names)}"
        raise InputError(argument, problem, remedy=f"layout: {_known()}")
    return name, names


def _known() -> str:
    return "a list of names, or one of " + ", ".join(f"{name} ({len(names)})" for name, names in FORMATS.items())
