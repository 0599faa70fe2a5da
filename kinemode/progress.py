"""Progress of a long job: a bar with the remaining time on a terminal, now and then a plain line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TextIO

Progress = Callable[[int, int], None]
"""Called with (frames done, frames in all)."""

Reporter = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress report under a label, for one stage of a job; `reported` is one."""

_PLAIN_SECONDS = 10.0


@contextmanager
def reported(label: str, stream: TextIO | None = None) -> Iterator[Progress]:
    """A progress callback that reports on `stream` (standard error unless given) until the block ends."""
    stream = sys.stderr if stream is None else stream
    if not stream.isatty():
        yield _PlainLines(label, stream)
        return
    with _bar(label, stream) as progress:
        yield progress


@contextmanager
def _bar(label: str, stream: TextIO) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress as Bars,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Bars(*columns, console=Console(file=stream)) as bars:
        task = bars.add_task(label, total=None)
        yield lambda done, total: bars.update(task, completed=done, total=total)


class _PlainLines:
    """One line at the start, every ten seconds and at the end: readable in a log."""

    def __init__(self, label: str, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._label, self._stream, self._clock = label, stream, clock
        self._start = self._last = clock()
        self._first: int | None = None

    def __call__(self, done: int, total: int) -> None:
        now = self._clock()
        starts, self._first = self._first is None, done if self._first is None else self._first
        if not starts and done < total and now - self._last < _PLAIN_SECONDS:
            return
        self._last = now
        worked = done - self._first  # a resumed run starts part of the way
        left = (
            f", {_duration((now - self._start) / worked * (total - done))} left"
            if 0 < worked < total - self._first
            else ""
        )
        print(f"{self._label}: {done}/{total}{left}", file=self._stream, flush=True)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


@contextmanager
def unreported(label: str) -> Iterator[Progress]:
    """A reporter that does nothing."""
    yield lambda done, total: None
