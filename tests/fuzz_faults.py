"""A judge that does what damaged files may do to a process; apart, because workers import it."""

from __future__ import annotations

import os
import time
from pathlib import Path

from benchmarks.fuzz_cases import Case, Verdict


def judge(case: Case, corpus: object, folder: Path) -> Verdict:
    """End the process, hang, print, or do well, as the case's name says."""
    if case.reader == "crash":
        os._exit(3)
    if case.reader == "hang":
        time.sleep(60.0)
    if case.reader == "print":
        os.write(2, b"libfoo: never mind\n")
    return Verdict("read", str(corpus))
