"""An engine of batches that works at once, in this process, where none has to be started, loaded and ended."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any


class Inline:
    """See `kinemode.batches.engines.Engine`."""

    died = (KeyError,)
    deaths = 3

    def __enter__(self) -> Inline:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def workers(self) -> int:
        return 2

    def submit(self, work: Callable[[Any], Any], task: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(work(task))
        except Exception as error:
            future.set_exception(error)
        return future

    def once_a_machine(self, work: Callable[[], None]) -> None:
        pass
