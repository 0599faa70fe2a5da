"""Keypoints of several people into a file, as kinemode's JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from humanoid.support.atomic import replacing

PersonContent = Mapping[str, Sequence[Sequence[float]]]
"""Of a person: keypoints (K, 3) x, y [px], confidence; perhaps world (K, 3) [m], see
`estimator.data.formats.keypoints_own`."""


def write_people(
    path: str | Path,
    layout: str,
    names: Sequence[str],
    frames: Sequence[Mapping[int, PersonContent]],
    *,
    image_size: tuple[int, int] | None = None,
    fps: float | None = None,
    **more: Any,
) -> None:
    """Write every frame's people, by their numbers.

    Parameters
    ----------
    layout: a key of `humanoid.subject.landmarks.FORMATS`. names (K): of the keypoints.
    frames: for each frame the people by number; a frame may be empty. Where there is only one number in all of them,
        they are written as one person.
    image_size: width, height [px]. fps: frames per second. more: further members of the file.

    Raises
    ------
    InputError: the file cannot be written.
    """
    numbers = {number for people in frames for number in people}
    rows = [_of_one(people) if len(numbers) < 2 else _of_all(people) for people in frames]
    size = None if image_size is None else list(image_size)
    content = {"format": layout, "image_size": size, "fps": fps, "names": list(names), **more, "frames": rows}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, separators=(",", ":")), encoding="utf-8")


def _of_one(people: Mapping[int, PersonContent]) -> dict[str, Any]:
    return next((dict(person) for person in people.values()), {"keypoints": None})


def _of_all(people: Mapping[int, PersonContent]) -> dict[str, Any]:
    return {"people": [{"id": number, **person} for number, person in people.items()]}
