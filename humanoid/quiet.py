"""Keeping what C++ libraries print off the terminal."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Send the process's file descriptors 1 and 2 nowhere for a while.

    urdfdom prints its complaints below Python's sys.stderr. Descriptors belong to the process: keep the block short.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # a closed or replaced stream has nothing to flush
            stream.flush()
    saved: list[tuple[int, int]] = []
    try:
        sink = os.open(os.devnull, os.O_WRONLY)
        try:
            for descriptor in (1, 2):
                with contextlib.suppress(OSError):  # closed, as in some daemons
                    saved.append((descriptor, os.dup(descriptor)))
                    os.dup2(sink, descriptor)
        finally:
            os.close(sink)
        yield
    finally:
        for descriptor, copy in saved:
            os.dup2(copy, descriptor)
            os.close(copy)
