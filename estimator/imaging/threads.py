"""Equal bits from OpenCV on any machine.

Where it cuts work into one stripe a thread, the number of threads shows in the last bits of results.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np


def length(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Lengths of vectors (x, y); cv2.magnitude's last bits depend on where in memory its arguments lie."""
    return np.asarray(np.sqrt(x * x + y * y))


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it (a context or a decorator) OpenCV uses one thread, so that results are the same on any machine."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
