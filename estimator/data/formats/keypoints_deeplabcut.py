"""DeepLabCut's csv: of one animal, of several with a row of individuals, and of labelled pictures.

The first lines are `scorer`, with several animals `individuals`, `bodyparts` and `coords` (x, y and, of a network,
likelihood); the others begin with the frame's number or the picture's path, in one cell or in three. The format:
A. Mathis et al., DeepLabCut, Nature Neuroscience 21, 2018; J. Lauer et al., Nature Methods 19, 2022 (several animals).
Lightning Pose and Anipose write the same.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.formats.checked_json import read_text
from estimator.data.formats.keypoint_format import KeypointFile, KeypointFormat
from estimator.data.formats.keypoints_names import named_landmarks
from estimator.data.formats.keypoints_people import Person, cleaned
from estimator.data.formats.keypoints_reading import MOST_FRAMES, Reading, checked_names, frame_of_pictures
from humanoid.support.errors import InputError, shown

HEADS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
HEADS_REMEDY = "DeepLabCut's are scorer, individuals (with several animals), bodyparts, coords"
_COORDINATES = ("x", "y", "likelihood")
_UNIQUE = "single"  # DeepLabCut's individual that has the body parts of no animal


class DeepLabCutTable(NamedTuple):
    """Content of DeepLabCut's files of any kind.

    columns (W): individual ("" where the file has none), body part and coordinate of each. values (T, W): NaN where
    missing. rows (T): name of each row, a frame's number or a picture's path. places (T), heads (W): places of rows and
    columns, for messages.
    """

    columns: tuple[tuple[str, str, str], ...]
    values: np.ndarray
    rows: tuple[str, ...]
    places: tuple[str, ...]
    heads: tuple[str, ...]


def read_deeplabcut(reading: Reading) -> None:
    """Read a csv of DeepLabCut's; a point without coordinates is missing, one without likelihood is sure.

    Raises
    ------
    InputError: with the line, where the file is not one of DeepLabCut's, is truncated or has a cell that is not a
    number.
    """
    fill(reading, _table(reading.source))


def fill(reading: Reading, table: DeepLabCutTable) -> None:
    """Add the people of a table to the reading; raises InputError as `read_deeplabcut` does."""
    path = reading.source
    parts, individuals = _parts(path, table)
    reading.layout = "DeepLabCut"
    reading.names = named_landmarks(parts, reading)
    if _UNIQUE in individuals and len(individuals) > 1:
        individuals.pop(_UNIQUE)
        reading.notes.say(f"the individual {_UNIQUE!r}, points of no animal, is left out")
    absent = np.full((len(table.values), 1), np.nan)  # the last column stands for missing ones
    values = np.concatenate([table.values, absent], axis=1)
    several = len(individuals) > 1
    for place, frame, row in zip(table.places, _frames(table, path), values, strict=True):
        people = [
            _person(row[columns], columns, name if several else None, reading, place)
            for name, columns in individuals.items()
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


def _table(path: Path) -> DeepLabCutTable:
    try:
        rows = list(csv.reader(io.StringIO(read_text(path), newline="")))
    except csv.Error as error:
        raise InputError(path, f"is not a csv: {error}") from None
    lines = [(number, row) for number, row in enumerate(rows, 1) if any(cell.strip() for cell in row)]
    words = tuple(row[0].strip() for _, row in lines[:4])
    head = next((names for names in HEADS if words[: len(names)] == names), None)
    if head is None:
        raise InputError(path, f"its lines begin with {shown(list(words))}", place="line 1", remedy=HEADS_REMEDY)
    top = {name: row for name, (_, row) in zip(head, lines, strict=False)}
    width = len(top["coords"])
    for number, row in lines:
        if len(row) != width:
            raise InputError(path, f"has {len(row)} cells, {width} are expected", place=f"line {number}")
    if len(lines) == len(head):
        raise InputError(path, "has no frame after its head")
    first = next((i for i, cell in enumerate(top["bodyparts"]) if i and cell.strip()), width)
    lines = lines[len(head) :]
    return DeepLabCutTable(
        tuple(column_of({name: row[i].strip() for name, row in top.items()}) for i in range(first, width)),
        np.array([_numbers(cells[first:], path, line) for line, cells in lines]).reshape(len(lines), width - first),
        tuple("/".join(cell.strip() for cell in cells[:first]) for _, cells in lines),
        tuple(f"line {line}" for line, _ in lines),
        tuple(f"column {i + 1}" for i in range(first, width)),
    )


def column_of(words: Mapping[str, str]) -> tuple[str, str, str]:
    """Individual, body part and coordinate of a column, from the rows of the header."""
    return words.get("individuals", ""), words["bodyparts"], words["coords"]


def _parts(path: Path, table: DeepLabCutTable) -> tuple[tuple[str, ...], dict[str, np.ndarray]]:
    """Body parts (J) in the order they come in, and columns (J, 3) of each individual's x, y, likelihood, -1 where
    there is none."""
    places: dict[str, dict[tuple[str, str], int]] = {}
    for i, (who, part, coordinate) in enumerate(table.columns):
        if coordinate not in _COORDINATES:
            remedy = f"one of {', '.join(_COORDINATES)}"
            raise InputError(path, f"has {shown(coordinate)} in {table.heads[i]}", place="coords", remedy=remedy)
        of_one = places.setdefault(who, {})
        if (part, coordinate) in of_one:
            raise InputError(path, f"{shown(part)} has {coordinate} twice", place=table.heads[i])
        of_one[part, coordinate] = i
    names = checked_names(list(dict.fromkeys(part for _, part, _ in table.columns)), path, "bodyparts")
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
        raise InputError(path, "has a cell that is not a number", place=f"line {line}") from None


def _frames(table: DeepLabCutTable, path: Path) -> list[int]:
    """The frame of each row: the number it begins with, or the one its picture's name ends with."""
    texts = list(table.rows)
    if all(text.isascii() and text.isdigit() for text in texts):
        texts = [text.lstrip("0") or "0" for text in texts]
        for text, place in zip(texts, table.places, strict=True):
            if len(text) > len(str(MOST_FRAMES)) or int(text) > MOST_FRAMES:
                raise InputError(path, f"{shown(text)} is not a likely frame number", place=place)
        frames = [int(text) for text in texts]
    else:
        of_picture = frame_of_pictures(texts, path)
        frames = [of_picture[text] for text in texts]
    seen: dict[int, str] = {}
    for frame, place in zip(frames, table.places, strict=True):
        if frame in seen:
            raise InputError(path, f"frame {frame} is in {seen[frame]} too", place=place)
        seen[frame] = place
    return frames


def _is_deeplabcut(file: KeypointFile) -> bool:
    return file.start.removeprefix(b"\xef\xbb\xbf").startswith(b"scorer,")


DEEPLABCUT = KeypointFormat(
    "DeepLabCut csv", _is_deeplabcut, lambda file, reading: read_deeplabcut(reading), of_json=False
)
