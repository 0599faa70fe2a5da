"""Processes of this machine that work for this one: how many there may be, and what keeps them from outliving it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from humanoid.support.errors import InputError

MOST = 256
GUARD = 'a script needs `if __name__ == "__main__":` around what it runs'
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS")


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def checked_count(processes: int) -> int:
    """The given number of processes, checked. Raises InputError where it is outside its range, or where a spawned
    process runs its parent's script once more because a guard is missing."""
    if not 1 <= processes <= MOST:
        raise InputError("workers", f"{processes} processes cannot share the work", remedy=f"1 to {MOST}")
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError("workers", "a worker process runs the whole script again", remedy=GUARD)
    return processes


def begin_as_worker() -> None:
    """Setup of a worker process: Ctrl-C is handled by the leader, and the worker ends with its leader."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    leader = multiprocessing.parent_process()

    def watch() -> None:
        if leader is not None:
            leader.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes that are started within it have one thread each, as libraries read it when they are loaded."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
