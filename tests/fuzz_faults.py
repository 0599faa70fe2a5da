"""A judge for the measure of damaged files: what such files may do to a process.

It is apart from the tests because workers import it.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path

from benchmarks.robustness.fuzz_cases import Case, Verdict


def judge(case: Case, corpus: Path, folder: Path) -> Verdict:
    """End the process, hang, print, or succeed, depending on the case's name."""
    if case.reader == "crash":
        os._exit(3)
    if case.reader == "hang":
        signal.alarm(600)  # in case nothing else ends it
        while True:
            signal.pause()
    if case.reader == "print":
        os.write(2, b"libfoo: never mind\n")
    return Verdict("read", corpus.name)
