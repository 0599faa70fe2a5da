"""Work for other processes, in a module that is soon imported."""

from __future__ import annotations

import os
import signal


def square(number: int) -> int:
    """Kills the process that is to square a negative number."""
    if number < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number
