"""Jobs of worker processes in tests; workers import this module, so it is light."""

from __future__ import annotations

import os


def numbered(task: int) -> tuple[int, int]:
    """A task, and the process that did it."""
    return task, os.getpid()
