"""A pool of worker processes; nothing but the time it takes depends on how many there are."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Generic, Protocol, TypeVar

from estimator.numerics.broadcast import Broadcaster
from estimator.numerics.job import NUMBER, Everywhere, NewContext, SharedItems, WorkerJob, serve, taken
from estimator.numerics.worker import Worker, check_not_imported_again
from humanoid.support.errors import InputError

MOST = 64
_MOST_PIECES = 8192  # their numbers fit into any system's pipe

Context = TypeVar("Context")
Item = TypeVar("Item")
Result = TypeVar("Result")


class Workers(Protocol[Context]):
    """Who does pieces of work, functions of a context (see `WorkerJob`) and of an item. size: how many processes they
    are."""

    size: int

    def show(self, context: Context) -> None:
        """What the work is done in from now on, until another is shown."""
        ...

    def each(self, work: Callable[[Context, Item], Result], items: Sequence[Item]) -> list[Result]:
        """What the work makes of every item, in their order."""
        ...

    def everywhere(self, work: Callable[[Context, Item], None], item: Item) -> None:
        """Have it done in every process."""
        ...


class OneProcess(Generic[Context]):
    """This process does all the work; see `Workers`."""

    size = 1

    def __init__(self) -> None:
        self._context: Context | None = None

    def show(self, context: Context) -> None:
        """See `Workers`."""
        self._context = context

    def each(self, work: Callable[[Context, Item], Result], items: Sequence[Item]) -> list[Result]:
        """See `Workers`."""
        return [work(self._shown, item) for item in items]

    def everywhere(self, work: Callable[[Context, Item], None], item: Item) -> None:
        """See `Workers`."""
        work(self._shown, item)

    @property
    def _shown(self) -> Context:
        if self._context is None:
            raise RuntimeError("nothing to work on has been shown")
        return self._context


class WorkerPool(OneProcess[Context]):
    """This process and its workers (see `Workers`); a context manager that ends them.

    Pieces are not dealt out in advance: their numbers lie in a pipe, and every process takes the next one when done
    with the last. So all are done at the same time, and a process that dies leaves nothing locked.
    """

    def __init__(self, job: WorkerJob[Context], processes: int) -> None:
        super().__init__()
        self.size = processes
        self._job = job
        self._workers: list[Worker] = []
        self._known: Context | None = None  # to the workers
        self._broadcaster = Broadcaster()
        self._numbers, self._more = multiprocessing.Pipe(duplex=False)
        os.set_blocking(self._numbers.fileno(), False)

    def __enter__(self) -> WorkerPool[Context]:
        try:
            for _ in range(self.size - 1):
                self._workers.append(Worker(serve, self._numbers, self._job))
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def each(self, work: Callable[[Context, Item], Result], items: Sequence[Item]) -> list[Result]:
        """See `Workers`. A worker's failure is raised here and ends them all; this process then works alone."""
        if not self._workers or not 1 < len(items) <= _MOST_PIECES:
            return super().each(work, items)
        try:
            self._let_know()
            os.write(self._more.fileno(), b"".join(k.to_bytes(NUMBER, "little") for k in range(len(items))))
            self._tell(SharedItems(work, items))
            results: dict[int, Result] = dict(taken(self._numbers, self._shown, work, items))
            for worker in self._workers:
                results.update(worker.receive())
        except BaseException:
            self.close()  # answers on their way belong to no question any more
            raise
        return [results[k] for k in range(len(items))]

    def everywhere(self, work: Callable[[Context, Item], None], item: Item) -> None:
        """See `Workers`."""
        if self._workers:
            self._let_know()
            self._tell(Everywhere(work, item))
        super().everywhere(work, item)

    def close(self) -> None:
        """End the workers and give back what they shared; afterwards this process works alone."""
        workers, self._workers = self._workers, []
        for worker in workers:
            worker.connection.close()  # all learn of it before the first is waited for
        for worker in workers:
            worker.close()
        self._known = None
        self._broadcaster.close()
        self._numbers.close()
        self._more.close()

    def _let_know(self) -> None:
        """Show the workers the context, unless they know it."""
        if self._known is not self._shown:
            notice = self._broadcaster.show(self._job.message(self._shown))
            for worker in self._workers:
                worker.send(NewContext(notice))
                if notice.moved:
                    worker.hand_over(self._broadcaster.descriptor)
            self._known = self._shown

    def _tell(self, message: Any) -> None:
        for worker in self._workers:
            worker.send(message)


@contextmanager
def worker_pool(job: WorkerJob[Context], processes: int) -> Iterator[Workers[Context]]:
    """So many processes, this one among them, that share the work of a job within the block; one is this process alone.

    The others end with the block and with this process, however these end. They are spawned: a script that uses them
    needs `if __name__ == "__main__":` around what it runs.

    Raises
    ------
    InputError: a number of processes that cannot be; later, from the work, that one of them has ended by itself.
    """
    if checked_count(processes) == 1:
        yield OneProcess()
        return
    with WorkerPool(job, processes) as pool:
        yield pool


def checked_count(processes: int) -> int:
    """A number of processes as it was given; InputError where it cannot be."""
    if not 1 <= processes <= MOST:
        raise InputError("workers", f"{processes} processes cannot share the work", remedy=f"1 to {MOST}")
    if processes > 1:
        check_not_imported_again()
    return processes
