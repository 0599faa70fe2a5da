"""Equal bits from OpenCV on any machine.

Where it cuts work into one stripe a thread, the number of threads shows in the last bits of results.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

import cv2
import numpy as np


def length(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Lengths of vectors (x, y); cv2.magnitude's last bits depend on where in memory its arguments lie."""
    return np.asarray(np.sqrt(x * x + y * y))


class _Limit:
    """OpenCV's number of threads is one for the whole process: the last of several users gives it back."""

    def __init__(self) -> None:
        self._lock, self._users, self._threads = Lock(), 0, 0

    def enter(self) -> None:
        with self._lock:
            if self._users == 0:
                self._threads = cv2.getNumThreads()
                cv2.setNumThreads(1)
            self._users += 1

    def leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                cv2.setNumThreads(self._threads)


_limit = _Limit()


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it (a context or a decorator) OpenCV uses one thread, so that results are the same on any machine."""
    _limit.enter()
    try:
        yield
    finally:
        _limit.leave()
