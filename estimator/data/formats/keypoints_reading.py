"""Content of a keypoint file, gathered while it is read: people by frame number, and its other data."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from estimator.data.formats.checked_json import numbers
from estimator.data.formats.keypoints_people import LAYOUT_BY_COUNT, Notes, Person, cleaned
from humanoid.subject.landmarks import FORMATS, landmark_name
from humanoid.support.errors import InputError, shown

MOST_FRAMES = 2_000_000
_LARGEST_ID = 1e15  # a float is exact up to there
_FRAME_NUMBER = re.compile(r"([0-9]+)(?:_keypoints)?$")


@dataclass
class Reading:
    """Content of a file: people by frame number, and its other data.

    fractions: whether the coordinates are fractions of the picture's width and height, which a file without the
    picture's size has; else they are pixels.
    """

    source: Path
    layout: str
    frames: dict[int, list[Person]] = field(default_factory=dict)
    names: tuple[str | None, ...] = ()
    count: int | None = None
    image_size: tuple[int, int] | None = None
    fps: float | None = None
    notes: Notes = field(default_factory=Notes)
    fractions: bool = False

    def person(self, flat: Any, id: Any, source: str | Path, place: str) -> Person | None:
        """One person from a flat list of x, y, confidence; None from an empty list."""
        values = numbers(flat, source, place, finite=False)
        if values.size == 0:
            return None
        if values.ndim == 2 and values.shape[1] == 3:
            values = values.ravel()
        if not self.names:
            self.name_by_size(values.size, source, place)
        if values.ndim != 1 or values.size != 3 * len(self.names):
            problem = f"{self.layout} has {3 * len(self.names)} numbers, found {values.size}"
            raise InputError(source, problem, place=place, remedy=_counts())
        return Person(cleaned(values.reshape(-1, 3), self.notes, source, place), person_id(id))

    def name_by_size(self, size: int, source: str | Path, place: str) -> None:
        """Use the layout with this count of numbers, or the given one; raises InputError without one."""
        if self.layout == "auto":
            if size not in LAYOUT_BY_COUNT:
                raise InputError(source, f"{size} numbers fit no layout", place=place, remedy=_counts())
            self.layout = LAYOUT_BY_COUNT[size]
        self.names = FORMATS[self.layout]

    def add(self, frame: int, people: Sequence[Person | None]) -> None:
        """Add people to a frame; the frame counts as read even without people."""
        self.frames.setdefault(frame, []).extend(p for p in people if p is not None)


def _counts() -> str:
    return "layouts: " + ", ".join(f"{layout} = {count}" for count, layout in sorted(LAYOUT_BY_COUNT.items()))


def person_id(value: Any) -> str | None:
    """A person's id as text, None where a file gives none."""
    while isinstance(value, list) and value:
        value = value[0]
    if isinstance(value, str):
        return value or None
    if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value < _LARGEST_ID:
        return str(int(value)) if value == int(value) else str(value)
    return None  # OpenPose writes [-1] where it knows none


def frame_numbers(names: Sequence[str], source: Path) -> dict[str, int]:
    """Frame number of each file or image name: the number it ends with; without any, the order of the names."""
    unique = list(dict.fromkeys(names))
    digits_of: dict[str, str] = {}
    for name in unique:
        match = _FRAME_NUMBER.search(re.sub(r"\.[A-Za-z]{1,4}[0-9]?$", "", name))
        if match:
            digits_of[name] = match.group(1).lstrip("0") or "0"
    if not digits_of:
        return {name: i for i, name in enumerate(sorted(unique))}
    for name in unique:
        if name not in digits_of:
            raise InputError(source, "has no frame number at its end", place=name)
        if len(digits_of[name]) > len(str(MOST_FRAMES)) or int(digits_of[name]) > MOST_FRAMES:
            raise InputError(source, f"{digits_of[name]} is not a likely frame number", place=name)
    return {name: int(digits) for name, digits in digits_of.items()}


def frame_of_pictures(names: Sequence[str], source: Path) -> dict[str, int]:
    """`frame_numbers` where every name is a picture of its own; raises InputError where two have one frame number."""
    numbers_of = frame_numbers(names, source)
    first: dict[int, str] = {}
    for name, number in numbers_of.items():
        if number in first:
            problem = f"{shown(first[number])} and {shown(name)} are both frame {number}"
            raise InputError(source, problem, remedy="a file is of one camera's clip: give one for each")
        first[number] = name
    return numbers_of


def checked_names(value: Any, source: str | Path, place: str) -> tuple[str, ...]:
    """Names of keypoints, each there and no two alike; raises InputError."""
    if not isinstance(value, (list, tuple)) or not value or not all(isinstance(n, str) and n.strip() for n in value):
        raise InputError(source, "a list of names is needed, one for each keypoint", place=place)
    names = tuple(name.strip() for name in value)
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise InputError(source, f"the keypoint {shown(twice)} appears twice", place=place)
    return names


def as_landmarks(names: Sequence[str]) -> tuple[str, ...]:
    """The landmark for each name; an unknown name stays, as a robot's subject may have it."""
    return tuple(landmark_name(name) or name for name in names)
