"""Processor time by parts of the work, each without the parts inside it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import process_time
from typing import Any


class Stopwatch:
    """Seconds by part. A call counts for its own part alone: what a part inside it takes is that part's.

    clock: gives the time [s].
    """

    def __init__(self, clock: Callable[[], float] = process_time) -> None:
        self._clock = clock
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._inside = [0.0]  # taken by parts within the running ones, outermost first

    def timed(self, part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, with its time added to `part`."""

        def measured(*args: Any, **kwargs: Any) -> Any:
            self._inside.append(0.0)
            start = self._clock()
            try:
                return call(*args, **kwargs)
            finally:
                passed = self._clock() - start
                self.seconds[part] += passed - self._inside.pop()
                self._inside[-1] += passed

        return measured

    @contextmanager
    def installed(self, parts: dict[str, list[tuple[type, str]]]) -> Iterator[None]:
        """Within it the methods of each part are timed."""
        before = [(owner, name, getattr(owner, name)) for methods in parts.values() for owner, name in methods]
        for part, methods in parts.items():
            for owner, name in methods:
                setattr(owner, name, self.timed(part, getattr(owner, name)))
        try:
            yield
        finally:
            for owner, name, method in before:
                setattr(owner, name, method)
