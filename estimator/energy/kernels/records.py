"""Terms as records: the numbers that a term's kernel needs, one after the other, so that one call evaluates any sum.

A record is made in Python and read by a compiled kernel; both stand side by side in the module of the term's kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

KEYPOINTS, TARGETS, SOLES, TILT, STABILISERS, MIXTURE, TRANSITION, BALANCE, REPULSION, FLOOR, TRUNK = range(11)


class Record(NamedTuple):
    """One term. kind: which kernel. integers (I,) int64, numbers (F,) float64: what it reads."""

    kind: int
    integers: np.ndarray
    numbers: np.ndarray


class Records(NamedTuple):
    """Several records in a row. starts (N, 3) int64: kind, first integer and first number of each. integers (I,),
    numbers (F,): those of all."""

    starts: np.ndarray
    integers: np.ndarray
    numbers: np.ndarray


NO_RECORDS = Records(np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))


def record_of(kind: int, integers: Sequence[int | np.ndarray], numbers: Sequence[float | np.ndarray]) -> Record:
    """A record of numbers and arrays, which are flattened."""
    return Record(kind, _flat(integers, np.int64), _flat(numbers, np.float64))


def joined(records: Sequence[Record], after: Records = NO_RECORDS) -> Records:
    """Records in a row, `after` others."""
    first_integer, first_number = len(after.integers), len(after.numbers)
    starts = []
    for record in records:
        starts.append((record.kind, first_integer, first_number))
        first_integer, first_number = first_integer + len(record.integers), first_number + len(record.numbers)
    rows = np.array(starts, dtype=np.int64).reshape(-1, 3)
    return Records(
        np.concatenate((after.starts, rows)),
        np.concatenate((after.integers, *[record.integers for record in records])),
        np.concatenate((after.numbers, *[record.numbers for record in records])),
    )


def _flat(values: Sequence[float | np.ndarray], kind: type) -> np.ndarray:
    parts: list[np.ndarray] = [np.asarray(value, dtype=kind).ravel() for value in values]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=kind)
