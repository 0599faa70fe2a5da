"""DeepLabCut's csv and h5: of one animal, of several with a row of individuals, and of labelled pictures.

The first lines of a csv are `scorer`, with several animals `individuals`, `bodyparts` and `coords` (x, y and, of a
network, likelihood); the others begin with the frame's number or the picture's path, in one cell or in three. The
format: A. Mathis et al., DeepLabCut, Nature Neuroscience 21, 2018; J. Lauer et al., Nature Methods 19, 2022 (several
animals). Lightning Pose and Anipose write the same.

The h5 has the same as a table of pandas in HDF5, in either of the layouts that pandas writes (`pandas.io.pytables`).
"frame_table": rows with an index and blocks of values, whose columns stand pickled beside them. "frame": blocks of
values, whose columns are words and numbers of words. Pickled words are read as plain lists alone.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from estimator.data.formats.checked_json import read_text
from estimator.data.formats.hdf5 import array, is_hdf5, members, numeric, opened, plain_pickle, text, texts
from estimator.data.formats.keypoints_names import named_landmarks
from estimator.data.formats.keypoints_reading import (
    MOST_FRAMES,
    KeypointFile,
    KeypointFormat,
    Person,
    Reading,
    checked_names,
    cleaned,
    frame_of_pictures,
)
from humanoid.support.errors import InputError, shown

if TYPE_CHECKING:
    import h5py


HEADS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
HEADS_REMEDY = "DeepLabCut's are scorer, individuals (with several animals), bodyparts, coords"
_COORDINATES = ("x", "y", "likelihood")
_UNIQUE = "single"  # DeepLabCut's individual whose points belong to no animal


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
    absent = np.full((len(table.values), 1), np.nan)  # the last column represents missing ones
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


_KINDS = ("frame_table", "frame")
_MOST_LEVELS = 8


def read_deeplabcut_h5(reading: Reading) -> None:
    """Read an h5 of DeepLabCut's, as its csv is read.

    Raises
    ------
    InputError: it has no table, or several; its content is not as pandas writes it, or not DeepLabCut's.
    """
    path = reading.source
    with opened(path) as file:
        tables = _tables(file)
        if len(tables) != 1:
            names = ", ".join(tables) or members(file)
            raise InputError(path, f"has {len(tables)} tables of pandas, one is needed: {names}")
        group = file[tables[0]]
        in_rows = text(group.attrs.get("pandas_type")) == "frame_table"
        columns, values, index = (_frame_table if in_rows else _frame)(group, path)
    if len(values) == 0:
        raise InputError(path, "has no frame")
    if len(index) != len(values):
        raise InputError(path, f"has {len(values)} rows, its index {len(index)}")
    rows, heads = (
        tuple(f"{kind} {i}" for i in range(n)) for kind, n in zip(("row", "column"), values.shape, strict=True)
    )
    fill(reading, DeepLabCutTable(tuple(columns), values, index, rows, heads))


_Content = tuple[list[tuple[str, str, str]], np.ndarray, tuple[str, ...]]  # columns (W), values (T, W), index (T)


def _tables(file: h5py.File) -> list[str]:
    """Names of the tables of pandas."""
    return [name for name, member in file.items() if text(member.attrs.get("pandas_type")) in _KINDS]


def _frame_table(group: h5py.Group, path: Path) -> _Content:
    table = array(group, "table", path)
    fields = table.dtype.names or ()
    if "index" not in fields:
        raise InputError(path, f"has no index but {shown(list(fields))}", place="table")
    info = plain_pickle(group.attrs.get("info"), path, "info")
    try:
        levels = list(info[1]["names"])
    except (KeyError, TypeError, IndexError):
        levels = []
    head = _checked_head(levels, path)
    columns: list[tuple[str, str, str]] = []
    blocks: list[np.ndarray] = []
    attributes = group["table"].attrs
    for name in (name for name in fields if name != "index"):
        words = plain_pickle(attributes.get(f"{name}_kind"), path, f"{name}_kind")
        if not isinstance(words, list):
            raise InputError(path, "is not a list of columns", place=f"{name}_kind")
        columns += [_column(head, names, path) for names in words]
        blocks.append(_block(table[name].reshape(len(table), -1), len(words), path, name))
    return columns, _joined(blocks, len(table)), _index(table["index"], path)


def _frame(group: h5py.Group, path: Path) -> _Content:
    levels = [_level_name(group, f"axis0_level{i}") for i in range(_level_count(group, "axis0"))]
    head = _checked_head(levels, path)
    columns: list[tuple[str, str, str]] = []
    blocks: list[np.ndarray] = []
    for i in count():
        if f"block{i}_values" not in group:
            break
        words = list(zip(*(_words(group, f"block{i}_items", j, path) for j in range(len(head))), strict=True))
        columns += [_column(head, names, path) for names in words]
        blocks.append(_block(array(group, f"block{i}_values", path), len(words), path, f"block{i}_values"))
    if "axis1" in group:
        index = _index(array(group, "axis1", path), path)
    else:
        parts = [_words(group, "axis1", j, path) for j in range(_level_count(group, "axis1"))]
        index = tuple("/".join(words) for words in zip(*parts, strict=True))
    return columns, _joined(blocks, len(index)), index


def _level_count(group: h5py.Group, axis: str) -> int:
    return next(i for i in range(_MOST_LEVELS + 1) if i == _MOST_LEVELS or f"{axis}_level{i}" not in group)


def _level_name(group: h5py.Group, name: str) -> str | None:
    return text(group[name].attrs.get("name"))


def _words(group: h5py.Group, axis: str, level: int, path: Path) -> list[str]:
    """The word of a level at each place of an axis."""
    words = texts(array(group, f"{axis}_level{level}", path), path, f"{axis}_level{level}")
    numbers = array(group, f"{axis}_label{level}", path)
    if numbers.dtype.kind not in "iu" or numbers.ndim != 1 or ((numbers < 0) | (numbers >= len(words))).any():
        raise InputError(path, f"are not numbers of its {len(words)} words", place=f"{axis}_label{level}")
    return [words[i] for i in numbers.tolist()]


def _checked_head(levels: list[Any], path: Path) -> tuple[str, ...]:
    head = tuple(levels)
    if head not in HEADS:
        raise InputError(path, f"its columns have the levels {shown(levels)}", remedy=HEADS_REMEDY)
    return head


def _column(head: tuple[str, ...], words: Any, path: Path) -> tuple[str, str, str]:
    if not isinstance(words, tuple) or len(words) != len(head) or not all(isinstance(word, str) for word in words):
        raise InputError(path, f"has a column {shown(words)}", remedy=f"its {', '.join(head)} are needed")
    return column_of({level: word.strip() for level, word in zip(head, words, strict=True)})


def _block(values: np.ndarray, width: int, path: Path, place: str) -> np.ndarray:
    """Values (T, width)."""
    if values.ndim != 2 or values.shape[1] != width:
        raise InputError(path, f"{width} columns do not fit an array of shape {values.shape}", place=place)
    return numeric(values, path, place)


def _joined(blocks: list[np.ndarray], rows: int) -> np.ndarray:
    """Blocks beside each other, (T, W); whether they have the index's rows is seen to where both are known."""
    return np.concatenate([np.zeros((rows, 0)), *blocks], axis=1)


def _index(values: np.ndarray, path: Path) -> tuple[str, ...]:
    """Name of each row: the number of a frame, or the path of a picture."""
    if values.ndim == 1 and values.dtype.kind in "iu" and (values >= 0).all():
        return tuple(map(str, values.tolist()))
    return texts(values, path, "index")


def _is_deeplabcut_h5(file: KeypointFile) -> bool:
    if not is_hdf5(file.start):
        return False
    with opened(file.path) as content:
        return bool(_tables(content))


DEEPLABCUT_H5 = KeypointFormat(
    "DeepLabCut h5", _is_deeplabcut_h5, lambda file, reading: read_deeplabcut_h5(reading), of_json=False
)
