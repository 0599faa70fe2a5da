"""A batch as CSV, one row a clip."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from humanoid.support.atomic import replacing
from viz.batch.entry import BatchEntry, known, look_ranks

COLUMNS = {
    "name": "name",
    "status": "status",
    "person": "person",
    "look_first": "",
    "frames": "frames",
    "hard": "hard",
    "unobserved": "unobserved",
    "doubtful_share": "doubtful",
    "error_m": "error",
    "time_s": "seconds",
    "processor_time_s": "processor_seconds",
    "subject": "subject",
    "tracker": "tracker",
    "message": "message",
    "report": "report",
    "run": "run",
    "thumbnail": "thumbnail",
}
"""The field of `BatchEntry` in each column; look_first is of all clips together, see `look_ranks`."""


def batch_table(entries: Sequence[BatchEntry]) -> str:
    """The text of the table: a head, and the clips in the order that is given; nothing stands where a number is not
    known."""
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for entry, rank in zip(entries, look_ranks(entries), strict=True):
        rows.writerow([_cell(getattr(entry, field) if field else rank) for field in COLUMNS.values()])
    return text.getvalue()


def _cell(value: str | float | None) -> str:
    if isinstance(value, str):
        return value
    if value is None or not known(value):
        return ""
    return str(value) if isinstance(value, int) else f"{value:.6g}"


def write_batch_table(path: str | Path, entries: Sequence[BatchEntry]) -> Path:
    """Write the table and return its path. The file is there whole or not at all.

    Raises InputError where it cannot be written.
    """
    with replacing(path) as temporary:
        # names of files need not be text; the table has them byte for byte
        temporary.write_bytes(batch_table(entries).encode("utf-8", "surrogateescape"))
    return Path(path)
