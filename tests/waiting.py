"""How tests wait: for events, pipes and exits, never for a length of time.

`tests/test_waiting.py` fails where a test compares clocks, sleeps or waits less than `DEADLINE`.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from benchmarks.support.common import ROOT

DEADLINE = 600.0
"""Seconds after which a wait counts as hung. It keeps a broken test from waiting forever and does not measure speed: a
machine a hundred times slower is within it."""

ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def default_signals() -> Iterator[None]:
    """Signals that end a program have their default handlers, here and in the processes started meanwhile.

    A suite that was started in the background (`nohup`, `&` in a script) inherits some of them as ignored, and so would
    every command it starts.
    """
    before = {number: signal.getsignal(number) for number in ENDINGS}
    try:
        for number in ENDINGS:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def until(holds: Callable[[], Any], what: str) -> None:
    """Return as soon as `holds()` is true, for conditions without an event: the state of another process, of a page.
    AssertionError with the missing condition after the deadline."""
    end = time.monotonic() + DEADLINE
    while not holds():
        assert time.monotonic() < end, f"not within {DEADLINE:g} s: {what}"
        time.sleep(0.01)


def kinemode_process(line: Sequence[object], **how: Any) -> subprocess.Popen[str]:
    """`python -m kinemode LINE` in a process of its own, its output on pipes, with default signal handlers; `how` is
    passed to `subprocess.Popen`."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | how.pop("env", {})
    how = {"text": True, "stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **how}
    with default_signals():
        return subprocess.Popen([sys.executable, "-m", "kinemode", *map(str, line)], env=environment, **how)


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code, output and errors of a process; it is killed if it does not end by the deadline."""
    try:
        out, errors = process.communicate(timeout=DEADLINE)
    except subprocess.TimeoutExpired:
        process.kill()
        out, errors = process.communicate()
        raise AssertionError(f"{process.args} does not end: {out}{errors}") from None
    return process.returncode, out, errors
