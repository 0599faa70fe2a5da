"""A worker process as its leader sees it: it ends with the leader, and says what went wrong in it."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import wait
from multiprocessing.reduction import send_handle
from typing import Any, NoReturn

from estimator.numerics.worker_main import PARTING, Failure, Sealed, main, uninterrupted
from humanoid.support.errors import InputError

GUARD = 'a script needs `if __name__ == "__main__":` around what it runs'


class Worker:
    """A spawned process that runs `serve(connection, *arguments)` until the connection ends.

    `serve` is a function of a module. It has to take EOFError from the connection for the end; what else it raises is
    raised by `receive` here.
    """

    def __init__(self, serve: Callable[..., None], *arguments: Any) -> None:
        spawn = multiprocessing.get_context("spawn")  # a forked child would inherit threads that stand still
        self.connection, there = spawn.Pipe()
        self._process = spawn.Process(target=main, args=(there, Sealed((serve, arguments))), daemon=True)
        try:
            with uninterrupted():
                self._process.start()
        except BaseException:
            self._give_up()
            raise
        finally:
            there.close()  # or its end would go unnoticed

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

    def close(self, parting: float = PARTING) -> None:
        """Let it end: at once if it waits, after what it is at if it does not, by force if that takes longer than
        `parting` [s]."""
        self.connection.close()
        self._process.join(parting)
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
        self._process.join(PARTING)
        code = self._process.exitcode
        remedy = GUARD if code == 1 else "too little memory is the usual cause; --workers 1 does without"
        raise InputError("workers", f"a worker process has ended (exit code {code})", remedy=remedy) from None


def check_not_imported_again() -> None:
    """Raises InputError where a spawned process runs the script that spawned it once more, for want of a guard."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError("workers", "a worker process runs the whole script again", remedy=GUARD)


def _checked(answer: Any) -> Any:
    if isinstance(answer, Failure):
        raise answer.error from RuntimeError(f"in a worker process:\n{answer.trace}")
    return answer
