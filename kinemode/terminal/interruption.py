"""Ctrl-C and other terminating signals, and the run to resume afterwards."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_SOON = 0.05  # s


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C while there is a run to resume; frames: how many it has at least."""

    def __init__(self, frames: int) -> None:
        super().__init__()
        self.frames = frames


def is_interruption(error: BaseException) -> bool:
    """Whether it is KeyboardInterrupt, or its replacement by compiled code that swallows it: numba's calls turn it
    into SystemError, those that return several arrays more than once."""
    cause: BaseException | None = error
    while isinstance(cause, SystemError):
        cause = cause.__cause__ or cause.__context__
    return isinstance(cause, KeyboardInterrupt)


@contextmanager
def kept_if_interrupted(frames: Callable[[], int | None]) -> Iterator[None]:
    """Makes KeyboardInterrupt a `RunInterrupted`; frames: how many there are, None where there is no run."""
    try:
        yield
    except (KeyboardInterrupt, SystemError) as stop:
        if not is_interruption(stop):
            raise
        counts = [frames(), stop.frames if isinstance(stop, RunInterrupted) else None]
        known = [count for count in counts if count is not None]
        if not known:
            raise
        raise RunInterrupted(max(known)) from stop


@contextmanager
def interrupted_by_signals() -> Iterator[list[int]]:
    """Within it the signals that end a program, of a terminal that closes or a batch system, raise KeyboardInterrupt
    as Ctrl-C does. Yields the list that those which came are added to.

    Only the first counts, or the cleaning up would be interrupted too; Ctrl-C always does. A signal that is ignored
    (`nohup`) stays so. Nothing changes outside of the main thread.
    """
    came: list[int] = []

    def interrupt(number: int, _: Any) -> None:
        came.append(number)
        if len(came) == 1 or number == signal.SIGINT:
            raise KeyboardInterrupt

    def once_more(what: sys.UnraisableHookArgs) -> None:
        if issubclass(what.exc_type, KeyboardInterrupt):
            threading.Timer(_SOON, again).start()
        else:
            sys.__unraisablehook__(what)

    def again() -> None:
        if sys.unraisablehook is once_more:
            os.kill(os.getpid(), signal.SIGINT)

    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    ours = [n for n in _SIGNALS if signal.getsignal(n) in (signal.SIG_DFL, signal.default_int_handler)]
    before = {number: signal.signal(number, interrupt) for number in ours}
    # in a finaliser or a callback from C nothing can be raised, and Python drops what is
    unraisable, sys.unraisablehook = sys.unraisablehook, once_more
    try:
        yield came
    finally:
        sys.unraisablehook = unraisable
        for number, handler in before.items():
            signal.signal(number, handler)
