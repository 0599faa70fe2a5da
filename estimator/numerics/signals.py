"""Signals that a terminal and a batch system send to all processes: the one that leads decides what comes of them."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

FOR_THE_LEADER = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals wait until the block's end, and processes started within get them only when they are ready to."""
    resource_tracker.ensure_running()  # it would end the blocking if it had to start
    came: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():  # another thread may take what this one blocks
        ours = [number for number in FOR_THE_LEADER if callable(signal.getsignal(number))]
        handlers = {number: signal.signal(number, lambda n, _: came.append(n)) for number in ours}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, FOR_THE_LEADER)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for late in came:
            signal.raise_signal(late)
