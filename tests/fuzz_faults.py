"""Judges for the measure of damaged files: what such files may do to a process, and files without damage.

They are apart from the tests because workers import them.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path

from benchmarks import fuzz_judge
from benchmarks.fuzz_cases import Case, Verdict
from benchmarks.fuzz_corpus import Files
from benchmarks.fuzz_readers import CORPUS_OF


def judge(case: Case, corpus: object, folder: Path) -> Verdict:
    """End the process, hang, print, or do well, as the case's name says."""
    if case.reader == "crash":
        os._exit(3)
    if case.reader == "hang":
        time.sleep(60.0)
    if case.reader == "print":
        os.write(2, b"libfoo: never mind\n")
    return Verdict("read", str(corpus))


def judge_undamaged(case: Case, corpus: Mapping[str, list[Files]], folder: Path) -> Verdict:
    """Give a reader the valid files of its corpus that the case's number names."""
    files = corpus[CORPUS_OF.get(case.reader, case.reader)][case.number]
    fuzz_judge.write(files, folder)
    return fuzz_judge.judge(case.reader, folder / next(iter(files)))
