"""The table and the page of a batch, written again and again while it runs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from humanoid.support.errors import InputError
from kinemode.batches.leader import PAGE, TABLE
from kinemode.batches.outcome import ClipOutcome
from kinemode.batches.row import BatchRow
from viz.batch.entry import WAITING, BatchEntry
from viz.batch.page import write_batch_page
from viz.batch.table import write_batch_table

_SELDOM = 3.0  # s between two pages at least
_SHARE = 0.02  # of the time, that is spent with writing them


class ShownBatch:
    """What is shown of the clips so far. rows: all of them. root: the batch's folder."""

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
            self.write()  # a full disk may be emptied: what is not written is reported at the end
            now = time.monotonic()
            self._next = now + max(_SELDOM, (now - begin) / _SHARE)

    def entries(self) -> list[BatchEntry]:
        """Of all clips, in the order of the manifest."""
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
    spent = (outcome.seconds, outcome.processor_seconds)
    if not outcome.runs:
        yield BatchEntry(
            outcome.name, outcome.status, person, outcome.message, seconds=spent[0], processor_seconds=spent[1]
        )
    for i, run in enumerate(outcome.runs):
        seconds, used = spent if i == 0 else (None, None)
        yield BatchEntry(
            run.name, outcome.status, person, outcome.message or run.message, run.subject, run.tracker, run.frames,
            run.hard, run.unobserved, run.doubtful, run.error, seconds, used, run.thumbnail, run.report, run.run,
        )  # fmt: skip
