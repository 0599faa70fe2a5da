"""Formats of keypoint files: how they are recognised, and the people and other data gathered while one is read."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.checked_json import BEYOND, LARGEST, WITHIN, numbers, read_json
from humanoid.subject.landmarks import FORMATS, landmark_name
from humanoid.support.errors import InputError, shown

LAYOUT_BY_COUNT = {3 * len(names): layout for layout, names in reversed(FORMATS.items())}


@dataclass(frozen=True)
class Person:
    """One detection of a person: points (J, 3) with x, y [px], NaN where missing, and confidence, 0 where missing.

    world (J, 3): the same points in space [m], see `estimator.data.formats.keypoints_own`; None where a file has none.
    """

    points: np.ndarray
    id: str | None = None
    world: np.ndarray | None = None

    @cached_property
    def size(self) -> float:
        """Diagonal of the points' bounding box [px], 0 for fewer than two."""
        xy = self.points[self.points[:, 2] > 0.0, :2]
        return float(np.hypot(*(xy.max(axis=0) - xy.min(axis=0)))) if len(xy) > 1 else 0.0

    @cached_property
    def weight(self) -> float:
        """Size times mean confidence."""
        return self.size * float(self.points[:, 2].mean())


@dataclass
class Notes:
    """Number of corrections while reading."""

    counts: dict[str, int] = field(default_factory=dict)

    def add(self, what: str, count: int) -> None:
        """Count `count` further cases of `what`."""
        if count:
            self.counts[what] = self.counts.get(what, 0) + count

    def say(self, what: str) -> None:
        """Add the note `what` once."""
        self.counts.setdefault(what, 0)

    @property
    def texts(self) -> tuple[str, ...]:
        """One line for each kind."""
        return tuple(f"{what} ({count} times)" if count else what for what, count in self.counts.items())


def cleaned(points: np.ndarray, notes: Notes, source: str | Path, place: str) -> np.ndarray:
    """Points (J, 3) with missing ones as NaN and confidence 0, confidences in [0, 1].

    A point is missing where its confidence is 0 (OpenPose writes 0, 0, 0) or where both coordinates are NaN.
    """
    points = points.copy()
    xy, confidence = points[:, :2], points[:, 2]
    if (
        np.abs(points).max(initial=0.0) < LARGEST
        and confidence.min(initial=1.0) > 0.0
        and confidence.max(initial=0.0) <= 1.0
    ):
        return points  # nothing to correct, as with most people of a crowd
    missing = np.isnan(xy).all(axis=1)
    points[missing, 2] = 0.0
    wrong = ~missing & ~(np.abs(points) < LARGEST).all(axis=1)
    if wrong.any():
        bad = int(np.flatnonzero(wrong)[0])
        raise InputError(source, BEYOND, place=f"{place}, keypoint {bad}", remedy=WITHIN)
    notes.add("confidence above 1 taken as 1", int((confidence > 1.0).sum()))
    notes.add("negative confidence taken as 0: a missing point", int((confidence < 0.0).sum()))
    confidence[:] = np.clip(confidence, 0.0, 1.0)
    xy[confidence == 0.0] = np.nan
    return points


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


@dataclass(frozen=True)
class KeypointFile:
    """A file or folder that should hold keypoints."""

    path: Path

    @cached_property
    def is_folder(self) -> bool:
        """Whether it is one."""
        return self.path.is_dir()

    @cached_property
    def start(self) -> bytes:
        """Its first bytes, empty for a folder and for an unreadable file, for which the reader of JSON gives the
        reason."""
        try:
            with self.path.open("rb") as file:
                return file.read(64)
        except (OSError, ValueError):
            return b""

    @property
    def ending(self) -> str:
        """Ending of its name, in lower case, with the dot."""
        return self.path.suffix.lower()

    @cached_property
    def json(self) -> Any:
        """Its content as JSON, None for a folder; raises InputError where it is not JSON."""
        return None if self.is_folder else read_json(self.path)


@dataclass(frozen=True)
class KeypointFormat:
    """A format of keypoint files; register it with `estimator.data.formats.keypoints.register`.

    name: as errors list it. recognises: whether a file is of this format, by its content; those registered last are
    tried first. read: fills a `Reading` of the file with the people of every frame; raises InputError naming frame and
    person. of_json: whether its files are JSON; formats of other files are tried before any file is read as JSON.
    """

    name: str
    recognises: Callable[[KeypointFile], bool]
    read: Callable[[KeypointFile, Reading], None]
    of_json: bool = True
