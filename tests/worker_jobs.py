"""What worker processes do in tests; they import it themselves, so it is light."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from multiprocessing.synchronize import Barrier

import numpy as np

from estimator.numerics.worker import Worker


def work_on(connection: Connection) -> None:
    """Say who this is, and work for ever without ever looking up."""
    connection.send(os.getpid())
    while True:
        pass


def fill(connection: Connection, size: int) -> None:
    """Take an open file, as memory is handed over, and write to all of it."""
    descriptor = recv_handle(connection)
    connection.send(os.pwrite(descriptor, bytes(size), 0))


class Table:
    """A context that is no search: numbers (N, 2), and an offset that work may change."""

    def __init__(self, numbers: np.ndarray, meeting: Barrier) -> None:
        self.numbers, self.meeting, self.offset = numbers, meeting, 0.0

    def row(self, i: int) -> tuple[float, int]:
        """Work: the sum of a row, and who added it up."""
        return float(self.numbers[i].sum()) + self.offset, os.getpid()

    def row_of_each(self, i: int) -> tuple[float, int]:
        """Work that nobody is done with before as many pieces are begun as there are processes: each has one."""
        self.meeting.wait()
        return self.row(i)

    def shift(self, by: float) -> None:
        """Work for everywhere."""
        self.offset += by


class TableJob:
    """Tables as the context of a pool (see `estimator.numerics.job.WorkerJob`). factor: of what is shown. meeting: of
    the processes."""

    def __init__(self, factor: float, meeting: Barrier) -> None:
        self.factor, self.meeting = factor, meeting

    def message(self, context: Table) -> np.ndarray:
        return context.numbers / self.factor

    def opener(self) -> Callable[[np.ndarray], Table]:
        return lambda numbers: Table(numbers * self.factor, self.meeting)


if __name__ == "__main__":  # a leader, for a test to end
    workers = [Worker(work_on), Worker(work_on)]
    print(*(worker.receive() for worker in workers), flush=True)
    while True:
        signal.pause()


def numbered(task: int) -> tuple[int, int]:
    """A task, and the process that has done it."""
    return task, os.getpid()
