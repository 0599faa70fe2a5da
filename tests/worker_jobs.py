"""What worker processes do in tests; they import it themselves, so it is light."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle

import numpy as np

from estimator.parallel.worker import Worker


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

    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers, self.offset = numbers, 0.0

    def row(self, i: int) -> tuple[float, int]:
        """Work: the sum of a row, and who added it up."""
        time.sleep(0.005)  # long enough for everybody to get some
        return float(self.numbers[i].sum()) + self.offset, os.getpid()

    def shift(self, by: float) -> None:
        """Work for everywhere."""
        self.offset += by


class TableJob:
    """Tables as the context of a pool (see `estimator.parallel.job.Job`). factor: of what is shown."""

    def __init__(self, factor: float) -> None:
        self.factor = factor

    def message(self, context: Table) -> np.ndarray:
        return context.numbers / self.factor

    def opener(self) -> Callable[[np.ndarray], Table]:
        return lambda numbers: Table(numbers * self.factor)


if __name__ == "__main__":  # a leader, for a test to end
    workers = [Worker(work_on), Worker(work_on)]
    print(*(worker.receive() for worker in workers), flush=True)
    time.sleep(60.0)
