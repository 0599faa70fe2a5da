"""What companions do in the tests of processes; they import it themselves, so it is light."""

from __future__ import annotations

import os
import time
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle

from estimator.parallel.companion import Companion


def work_on(connection: Connection) -> None:
    """Say who this is, and work for ever without ever looking up."""
    connection.send(os.getpid())
    while True:
        pass


def fill(connection: Connection, size: int) -> None:
    """Take an open file, as memory is handed over, and write to all of it."""
    descriptor = recv_handle(connection)
    connection.send(os.pwrite(descriptor, bytes(size), 0))


if __name__ == "__main__":  # a leader, for a test to end
    companions = [Companion(work_on), Companion(work_on)]
    print(*(companion.receive() for companion in companions), flush=True)
    time.sleep(60.0)
