"""Keeping what C and C++ libraries print off the terminal.

They print below Python's sys.stderr, to descriptors that belong to the whole process: keep the blocks short. One thread
at a time has a block; what others print meanwhile goes the same way.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator, Sequence

_ALONE = threading.RLock()  # two threads would put back each other's descriptors


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Send descriptors 1 and 2 nowhere for a while: urdfdom's complaints."""
    sink = os.open(os.devnull, os.O_WRONLY)
    with _sent_to(sink, (1, 2)):
        yield


@contextlib.contextmanager
def captured_output() -> Iterator[list[str]]:
    """Collect what is printed to descriptor 2 for a while; the list has it, if anything, when the block has ended."""
    said: list[str] = []
    reading, writing = os.pipe()
    for end in (reading, writing):
        os.set_blocking(end, False)  # what does not fit into the pipe is lost
    try:
        with _sent_to(writing, (2,)):
            yield said
    finally:
        with contextlib.suppress(BlockingIOError):
            said.append(os.read(reading, 1 << 16).decode(errors="replace"))
        os.close(reading)


@contextlib.contextmanager
def _sent_to(sink: int, descriptors: Sequence[int]) -> Iterator[None]:
    """Point descriptors at an open one, which is closed."""
    with _ALONE:
        saved: list[tuple[int, int]] = []
        try:
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(Exception):  # a closed or replaced stream has nothing to flush
                    stream.flush()
            for descriptor in descriptors:
                with contextlib.suppress(OSError):  # closed, as in some daemons
                    saved.append((descriptor, os.dup(descriptor)))
                    os.dup2(sink, descriptor)
            yield
        finally:
            os.close(sink)
            for descriptor, copy in saved:
                os.dup2(copy, descriptor)
                os.close(copy)
