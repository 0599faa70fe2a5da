"""What processes do in tests; they import it themselves, so it is light."""

from __future__ import annotations

import os


def numbered(task: int) -> tuple[int, int]:
    """A task, and the process that has done it."""
    return task, os.getpid()
