"""A damaged input by name, and what came of it."""

from __future__ import annotations

import re
import resource
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import NamedTuple

MOST_SECONDS = 20.0
MOST_MEMORY = 1_000_000_000  # bytes, of a whole process
GOOD = ("read", "refused")
_OF_READERS = 300_000_000  # bytes, of a process that has loaded all readers


class Case(NamedTuple):
    """A damaged input by name: the same again on every machine. reader: of `READERS`, or a command."""

    reader: str
    seed: int
    number: int

    @property
    def random(self) -> Random:
        """Where all of the damage comes from."""
        return Random(f"{self.reader} {self.seed} {self.number}")

    def __str__(self) -> str:
        return f"{self.reader.replace(' ', '_')}-{self.seed}-{self.number}"


@dataclass(frozen=True)
class Verdict:
    """outcome: of `GOOD`, or what went wrong. message: the message or the fault. seconds; memory: of the process
    [B]."""

    outcome: str
    message: str = ""
    seconds: float = 0.0
    memory: int = 0

    @property
    def good(self) -> bool:
        return self.outcome in GOOD


def already_held() -> int:
    """Memory of this process beyond a worker that has only loaded the readers [B], not due to a damaged input."""
    return max(0, (_process_size("VmRSS") or 0) - _OF_READERS)


def forget_peak() -> None:
    """Reset the count of `peak_memory` where the system can."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory() -> int:
    """The largest resident size this process had since `forget_peak` [B]."""
    high_water = _process_size("VmHWM")
    if high_water is not None:
        return high_water
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _process_size(name: str) -> int | None:
    """A size of this process from the system [B], None where not available."""
    with suppress(OSError):
        line = re.search(rf"{name}:\s*(\d+) kB", Path("/proc/self/status").read_text())
        if line:
            return 1024 * int(line[1])
    return None
