"""A process that works for this one: it ends with it, says what went wrong in it, and leaves Ctrl-C to it.

It ends with this one also where that is killed, and in the middle of its work: a thread waits for that.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler, send_handle
from typing import Any, NamedTuple, NoReturn

from threadpoolctl import threadpool_limits

from humanoid.support.errors import InputError

_PARTING = 1.0  # s given to a process to end by itself
_FOR_THE_LEADER = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # a terminal and a batch system send them to all
_GUARD = 'a script needs `if __name__ == "__main__":` around what it runs'


class Failure(NamedTuple):
    """The last thing a process says: what went wrong, and where, as text."""

    error: Exception
    trace: str


class Companion:
    """A spawned process that runs `serve(connection, *arguments)` until the connection ends.

    `serve` is a function of a module. It has to take EOFError from the connection for the end; what else it raises is
    raised by `receive` here.
    """

    def __init__(self, serve: Callable[..., None], *arguments: Any) -> None:
        spawn = multiprocessing.get_context("spawn")  # a forked child would inherit threads that stand still
        self.connection, there = spawn.Pipe()
        self._process = spawn.Process(target=_attend, args=(there, _Sealed((serve, arguments))), daemon=True)
        try:
            with _uninterrupted():
                self._process.start()
        except BaseException:
            self._give_up()
            raise
        finally:
            there.close()  # or nobody would hear of its end

    def send(self, message: Any) -> None:
        """Tell it something; raises what `receive` raises where it is gone."""
        try:
            self.connection.send(message)
        except OSError:
            self._lost()

    def hand_over(self, descriptor: int) -> None:
        """Give it an open file, which it has to take (`multiprocessing.reduction.recv_handle`) next of all."""
        assert self._process.pid is not None
        try:
            send_handle(self.connection, descriptor, self._process.pid)
        except (OSError, RuntimeError):  # the latter on macOS, where it has to acknowledge
            self._lost()

    def receive(self) -> Any:
        """Its answer. Raises what went wrong there, or InputError where it has ended without a word."""
        wait([self.connection, self._process.sentinel])
        try:
            answer = self.connection.recv()
        except (EOFError, OSError):
            self._lost()
        return _checked(answer)

    def close(self) -> None:
        """Let it end: at once if it waits, after what it is at if it does not, by force if that takes long."""
        self.connection.close()
        self._process.join(_PARTING)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self._process.close()

    def _give_up(self) -> None:
        if self._process.pid is None:
            self.connection.close()
        else:
            self.close()

    def _lost(self) -> NoReturn:
        while self.connection.poll():
            try:
                _checked(self.connection.recv())
            except (EOFError, OSError):
                break
        self._process.join(_PARTING)
        code = self._process.exitcode
        remedy = _GUARD if code == 1 else "too little memory is the usual cause; --workers 1 does without"
        raise InputError("workers", f"a worker process has ended (exit code {code})", remedy=remedy) from None


def check_not_imported_again() -> None:
    """Raises InputError where a spawned process runs the script that spawned it once more, for want of a guard."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError("workers", "a worker process runs the whole script again", remedy=_GUARD)


def _checked(answer: Any) -> Any:
    if isinstance(answer, Failure):
        raise answer.error from RuntimeError(f"in a worker process:\n{answer.trace}")
    return answer


class _Sealed:
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


def _attend(connection: Connection, sealed: _Sealed) -> None:
    """Ctrl-C reaches every process of a terminal; the one that leads decides."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end_soon)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _FOR_THE_LEADER)
    threading.Thread(target=_end_with_the_leader, daemon=True).start()
    _work(connection, sealed)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # the leader waits, and an interpreter with all that was imported ends slowly


def _work(connection: Connection, sealed: _Sealed) -> None:
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
    """However it ends; whatever this process is at has nobody to be told to any more."""
    leader = multiprocessing.parent_process()
    assert leader is not None
    leader.join()
    os._exit(1)


def _end_soon(*_: object) -> None:
    """Unless the leader is faster, which has heard of it too where all were meant."""
    signal.setitimer(signal.ITIMER_REAL, _PARTING)  # nobody takes its signal, so it ends the process


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Signals wait until the block's end, and processes started within hear of them only when they are ready to."""
    resource_tracker.ensure_running()  # it would end the blocking if it had to start
    came: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():  # another thread may take what this one blocks
        ours = [number for number in _FOR_THE_LEADER if callable(signal.getsignal(number))]
        handlers = {number: signal.signal(number, lambda n, _: came.append(n)) for number in ours}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _FOR_THE_LEADER)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for late in came:
            signal.raise_signal(late)
