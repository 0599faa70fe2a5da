"""DeepLabCut's h5, with what its csv has: a table of pandas in HDF5, of either of the layouts that pandas writes.

"frame_table": rows with an index and blocks of values, whose columns stand pickled beside them. "frame": blocks of
values, whose columns are words and numbers of words. Pickled words are read as plain lists alone.
The layouts: pandas, `pandas.io.pytables`; the tables: `estimator.data.formats.keypoints_deeplabcut`.
"""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.data.formats.hdf5 import array, is_hdf5, members, numeric, opened, plain_pickle, text, texts
from estimator.data.formats.keypoint_format import KeypointFile, KeypointFormat
from estimator.data.formats.keypoints_deeplabcut import HEADS, HEADS_REMEDY, DeepLabCutTable, column_of, fill
from estimator.data.formats.keypoints_reading import Reading
from humanoid.support.errors import InputError, shown

if TYPE_CHECKING:
    import h5py

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


def _is_deeplabcut(file: KeypointFile) -> bool:
    if not is_hdf5(file.start):
        return False
    with opened(file.path) as content:
        return bool(_tables(content))


DEEPLABCUT_H5 = KeypointFormat(
    "DeepLabCut h5", _is_deeplabcut, lambda file, reading: read_deeplabcut_h5(reading), of_json=False
)
