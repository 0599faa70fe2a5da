"""What runs in a worker process: it serves until its connection ends, leaves Ctrl-C to its leader, says what went wrong
and ends with its leader, also where that is killed and in the middle of its work: a thread waits for that."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any, NamedTuple

from threadpoolctl import threadpool_limits

PARTING = 1.0  # s given to a process to end by itself


class Failure(NamedTuple):
    """The last thing a process says: what went wrong, and where, as text."""

    error: Exception
    trace: str


class Sealed:
    """Something to send along that is not unpacked on arrival: that imports all it is made of, which takes seconds."""

    def __init__(self, thing: Any) -> None:
        self._thing = thing

    def __getstate__(self) -> bytes:
        return bytes(ForkingPickler.dumps(self._thing))

    def __setstate__(self, packed: bytes) -> None:
        self._packed = packed

    def opened(self) -> Any:
        """The thing, where it was sent to."""
        return pickle.loads(self._packed)


def main(connection: Connection, sealed: Sealed) -> None:
    """Run the sealed (function, arguments) as `function(connection, *arguments)`, then end this process."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end_soon)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, FOR_THE_LEADER)
    threading.Thread(target=_end_with_the_leader, daemon=True).start()
    _serve(connection, sealed)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # the leader waits, and an interpreter with all that was imported ends slowly


def _serve(connection: Connection, sealed: Sealed) -> None:
    try:
        serve, arguments = sealed.opened()
        with threadpool_limits(limits=1):
            serve(connection, *arguments)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    except Exception as error:
        trace = traceback.format_exc()
        try:
            connection.send(Failure(error, trace))
        except OSError:
            return
        except Exception:  # not everything that is raised can travel
            connection.send(Failure(RuntimeError(str(error)), trace))


def _end_with_the_leader() -> None:
    """However the leader ends; there is no one left to take results."""
    leader = multiprocessing.parent_process()
    assert leader is not None
    leader.join()
    os._exit(1)


def _end_soon(*_: object) -> None:
    """Unless the leader is faster, which was sent the signal too where all were meant."""
    signal.setitimer(signal.ITIMER_REAL, PARTING)  # no handler takes its signal, so it ends the process


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
