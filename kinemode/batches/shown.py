"""The table and the page of a batch, written again and again while it runs."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode.batches.leader import PAGE, TABLE
from kinemode.batches.manifest import BatchRow
from kinemode.batches.outcome import ClipOutcome
from viz.report.batch_page import write_batch_page
from viz.report.thumbnail import WAITING, BatchEntry, known, look_ranks

_SELDOM = 3.0  # s between two pages at least
_SHARE = 0.02  # of the time, that is spent with writing them
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


class ShownBatch:
    """The page and table of the clips so far. rows: all of them. root: the batch's folder."""

    def __init__(self, rows: Sequence[BatchRow], root: Path, title: str) -> None:
        self._root, self._title = root, title
        self._persons = {row.name: row.person for row in rows}
        self._entries: dict[str, tuple[BatchEntry, ...]] = {}
        self._next = 0.0

    def put(self, outcome: ClipOutcome) -> None:
        """Show what became of a clip, soon."""
        self._entries[outcome.name] = tuple(_entries(outcome, self._persons[outcome.name]))
        begin = time.monotonic()
        if begin >= self._next:
            self.write()  # a full disk may get room: files that could not be written are reported at the end
            now = time.monotonic()
            self._next = now + max(_SELDOM, (now - begin) / _SHARE)

    def entries(self) -> list[BatchEntry]:
        """Entries of all clips, in the order of the manifest."""
        return [
            entry
            for name, person in self._persons.items()
            for entry in self._entries.get(name, (BatchEntry(name, WAITING, person),))
        ]

    def write(self) -> dict[str, InputError]:
        """Write table and page, each by itself; why one could not be written, by its name."""
        entries, faults = self.entries(), dict[str, InputError]()
        for name, write in (
            (TABLE, lambda path: write_batch_table(path, entries)),
            (PAGE, lambda path: write_batch_page(path, entries, self._title)),
        ):
            try:
                write(self._root / name)
            except InputError as error:
                faults[name] = error
        return faults


def _entries(outcome: ClipOutcome, person: str) -> Iterator[BatchEntry]:
    """One for each run, one for a clip without any; time is that of the clip, in its first."""
    runs = outcome.runs or (BatchEntry(outcome.name),)
    for i, run in enumerate(runs):
        spent = (outcome.seconds, outcome.processor_seconds) if i == 0 else (None, None)
        yield replace(
            run, status=outcome.status, person=person, message=outcome.message or run.message, seconds=spent[0],
            processor_seconds=spent[1],
        )  # fmt: skip


def batch_table(entries: Sequence[BatchEntry]) -> str:
    """The text of the table: a head, and the clips in the given order; cells are empty where a number is not
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
    """Write the table and return its path. The file is written whole or not at all.

    Raises InputError where it cannot be written.
    """
    with replacing(path) as temporary:
        # names of files need not be text; the table has them byte for byte
        temporary.write_bytes(batch_table(entries).encode("utf-8", "surrogateescape"))
    return Path(path)
