"""Data of a process in Linux' /proc: its children, its memory, and the processor time it has used."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

_TICKS = os.sysconf("SC_CLK_TCK")
_KILOBYTE = 1024 / 1e6  # in MB


class ResidentMemory(NamedTuple):
    """Memory of a process [MB]: now, and the most that it has had."""

    now: float
    peak: float


def memory(process: int | str = "self") -> ResidentMemory:
    """Memory of a running process. Not from getrusage, whose maximum is inherited from the parent."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    said = dict(line.split(":", 1) for line in lines if ":" in line)
    return ResidentMemory(*(_KILOBYTE * int(said[name].split()[0]) for name in ("VmRSS", "VmHWM")))


def processor_seconds(process: int) -> float:
    """Processor time [s] of a process that is there, of all its threads, without its children."""
    user, system = _stat(process)[11:13]
    return (int(user) + int(system)) / _TICKS


def spawned_workers(process: int | None = None) -> list[int]:
    """The children of a process, this one unless given, that `multiprocessing` has spawned to work."""
    children: set[int] = set()
    for listed in Path(f"/proc/{process or os.getpid()}/task").glob("*/children"):
        try:
            children.update(map(int, listed.read_text().split()))
        except OSError:  # a thread that has ended
            continue
    return sorted(child for child in children if b"spawn_main" in _command_line(child))


def is_alive(process: int) -> bool:
    """Whether it runs; a zombie does not."""
    try:
        return _stat(process)[0] not in ("Z", "X")
    except OSError:
        return False


def seconds_until_gone(processes: Iterable[int], patience: float) -> float:
    """The time until all processes are gone [s], infinite where longer than allowed."""
    begin = time.monotonic()
    left = list(processes)
    while left := [process for process in left if is_alive(process)]:
        if time.monotonic() - begin > patience:
            return float("inf")
        time.sleep(0.01)
    return time.monotonic() - begin


def _stat(process: int) -> list[str]:
    """The fields of /proc/PID/stat from the state on; the name before it may have anything in it."""
    return Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()


def _command_line(process: int) -> bytes:
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return b""
