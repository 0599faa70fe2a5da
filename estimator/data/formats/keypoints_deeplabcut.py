"""DeepLabCut's csv: of one animal, of several with a row of individuals, and of labelled pictures.

The first lines are `scorer`, with several animals `individuals`, `bodyparts` and `coords` (x, y and, of a network,
likelihood); the others begin with the frame's number or the picture's path, in one cell or in three. The format:
A. Mathis et al., DeepLabCut, Nature Neuroscience 21, 2018; J. Lauer et al., Nature Methods 19, 2022 (several animals).
Lightning Pose and Anipose write the same.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.checked_json import read_text
from estimator.data.formats.keypoint_format import KeypointFile, KeypointFormat
from estimator.data.formats.keypoints_names import named_landmarks
from estimator.data.formats.keypoints_people import Person, cleaned
from estimator.data.formats.keypoints_reading import MOST_FRAMES, Reading, checked_names, frame_of_pictures
from humanoid.support.errors import InputError, shown

_HEADS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
_COORDINATES = ("x", "y", "likelihood")
_UNIQUE = "single"  # DeepLabCut's individual that has the body parts of no animal


class _Table(NamedTuple):
    """parts (J): in the order they come in. individuals: columns (J, 3) of x, y, likelihood by name, -1 where there is
    none. first: the first column that is no index. lines: numbers of the file's lines, with their cells."""

    parts: tuple[str, ...]
    individuals: dict[str, np.ndarray]
    first: int
    lines: list[tuple[int, list[str]]]


def read_deeplabcut(reading: Reading) -> None:
    """Read a file of DeepLabCut's; a point without coordinates is missing, one without likelihood is sure.

    Raises
    ------
    InputError: with the line, where the file is none of DeepLabCut's, is cut short or has what is no number.
    """
    path = reading.source
    table = _table(path)
    reading.layout = "DeepLabCut"
    reading.names = named_landmarks(table.parts, reading)
    if _UNIQUE in table.individuals and len(table.individuals) > 1:
        table.individuals.pop(_UNIQUE)
        reading.notes.say(f"the individual {_UNIQUE!r}, points of no animal, is left out")
    width = max(len(cells) for _, cells in table.lines)
    values = np.full((len(table.lines), width + 1), np.nan)  # the last column stands for those that are not there
    for i, (line, cells) in enumerate(table.lines):
        values[i, table.first : width] = _numbers(cells[table.first :], path, line)
    frames = _frames([cells[: table.first] for _, cells in table.lines], [line for line, _ in table.lines], path)
    several = len(table.individuals) > 1
    for (line, _), frame, row in zip(table.lines, frames, values, strict=True):
        people = [
            _person(row[columns], columns, name if several else None, reading, f"line {line}")
            for name, columns in table.individuals.items()
        ]
        reading.add(frame, people)


def _person(points: np.ndarray, columns: np.ndarray, id: str | None, reading: Reading, place: str) -> Person | None:
    points = points.copy()
    missing = np.isnan(points[:, :2]).all(axis=1)
    points[columns[:, 2] < 0, 2] = 1.0
    points[missing, 2] = 0.0
    if missing.all():
        return None
    who = place if id is None else f"{place}, {id}"
    return Person(cleaned(points, reading.notes, reading.source, who), id)


def _table(path: Path) -> _Table:
    try:
        rows = list(csv.reader(io.StringIO(read_text(path), newline="")))
    except csv.Error as error:
        raise InputError(path, f"is no csv: {error}") from None
    lines = [(number, row) for number, row in enumerate(rows, 1) if any(cell.strip() for cell in row)]
    words = tuple(row[0].strip() for _, row in lines[:4])
    head = next((names for names in _HEADS if words[: len(names)] == names), None)
    if head is None:
        remedy = "DeepLabCut's are scorer, individuals (with several animals), bodyparts, coords"
        raise InputError(path, f"its lines begin with {shown(list(words))}", place="line 1", remedy=remedy)
    top = {name: row for name, (_, row) in zip(head, lines, strict=False)}
    width = len(top["coords"])
    for number, row in lines:
        if len(row) != width:
            raise InputError(path, f"has {len(row)} cells, {width} are expected", place=f"line {number}")
    if len(lines) == len(head):
        raise InputError(path, "has no frame after its head")
    cells = [cell.strip() for cell in top["bodyparts"]]
    first = next((i for i, cell in enumerate(cells) if i and cell), width)
    return _Table(*_columns(path, top, first), first, lines[len(head) :])


def _columns(path: Path, top: dict[str, list[str]], first: int) -> tuple[tuple[str, ...], dict[str, np.ndarray]]:
    """Body parts, and the columns of each individual."""
    places: dict[str, dict[tuple[str, str], int]] = {}
    parts: dict[str, None] = {}
    for column in range(first, len(top["coords"])):
        who, part, coordinate = (
            top[name][column].strip() if name in top else "" for name in ("individuals", "bodyparts", "coords")
        )
        if coordinate not in _COORDINATES:
            remedy = f"one of {', '.join(_COORDINATES)}"
            raise InputError(path, f"has {shown(coordinate)} in column {column + 1}", place="coords", remedy=remedy)
        of_one = places.setdefault(who, {})
        if (part, coordinate) in of_one:
            raise InputError(path, f"{shown(part)} has {coordinate} twice", place=f"column {column + 1}")
        of_one[part, coordinate] = column
        parts[part] = None
    names = checked_names(list(parts), path, "bodyparts")
    individuals: dict[str, np.ndarray] = {}
    for who, of_one in places.items():
        columns = np.array([[of_one.get((part, c), -1) for c in _COORDINATES] for part in names])
        if ((columns[:, 0] < 0) != (columns[:, 1] < 0)).any():
            part = names[int(np.flatnonzero((columns[:, 0] < 0) != (columns[:, 1] < 0))[0])]
            raise InputError(path, f"{shown(part)} needs both x and y", place="coords")
        individuals[who] = columns
    return names, individuals


def _numbers(cells: Sequence[str], path: Path, line: int) -> list[float]:
    try:
        return [float(cell) if cell.strip() else np.nan for cell in cells]
    except ValueError:
        raise InputError(path, "has a cell that is no number", place=f"line {line}") from None


def _frames(index: Sequence[Sequence[str]], lines: Sequence[int], path: Path) -> list[int]:
    """The frame of each line: the number it begins with, or the one its picture's name ends with."""
    texts = ["/".join(cell.strip() for cell in cells) for cells in index]
    if all(text.isascii() and text.isdigit() for text in texts):
        texts = [text.lstrip("0") or "0" for text in texts]
        for text, line in zip(texts, lines, strict=True):
            if len(text) > len(str(MOST_FRAMES)) or int(text) > MOST_FRAMES:
                raise InputError(path, f"{shown(text)} is no likely frame number", place=f"line {line}")
        frames = [int(text) for text in texts]
    else:
        of_picture = frame_of_pictures(texts, path)
        frames = [of_picture[text] for text in texts]
    seen: dict[int, int] = {}
    for frame, line in zip(frames, lines, strict=True):
        if frame in seen:
            raise InputError(path, f"frame {frame} is in line {seen[frame]} too", place=f"line {line}")
        seen[frame] = line
    return frames


def _is_deeplabcut(file: KeypointFile) -> bool:
    return file.start.removeprefix(b"\xef\xbb\xbf").startswith(b"scorer,")


DEEPLABCUT = KeypointFormat(
    "DeepLabCut csv", _is_deeplabcut, lambda file, reading: read_deeplabcut(reading), of_json=False
)
