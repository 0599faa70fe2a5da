"""One damaged input through its reader, and whether what comes of it will do."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from pathlib import Path

from benchmarks.robustness.fuzz_cases import (
    GOOD,
    MOST_MEMORY,
    MOST_SECONDS,
    Case,
    Verdict,
    already_held,
    forget_peak,
    peak_memory,
)
from benchmarks.robustness.fuzz_corpus import Files
from benchmarks.robustness.fuzz_readers import CORPUS_OF, READERS, damaged
from humanoid.support.errors import LONGEST, InputError


def write(files: Files, folder: Path) -> None:
    """Put the files into a folder, and nothing else."""
    folder.mkdir(exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    for name, content in files.items():
        (folder / name).write_bytes(content)


def prepare(case: Case, corpus: Mapping[str, list[Files]], folder: Path) -> Path:
    """Write the damaged files of a case; the path that is read."""
    files, main = damaged(case.reader, corpus[CORPUS_OF.get(case.reader, case.reader)], case.random)
    write(files, folder)
    return folder / main


def judge(reader: str, path: Path, most_seconds: float = MOST_SECONDS) -> Verdict:
    """The verdict on a reader with a file: a result, or an InputError that can be read; anything else is a fault, and
    so is more than `most_seconds`."""
    forget_peak()
    held, began = already_held(), time.perf_counter()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            READERS[reader].read(path)
            outcome, message = "read", ""
        except InputError as error:
            outcome, message = classify_message(str(error), path)
        except Exception as error:  # any other exception is a fault
            outcome, message = type(error).__name__, f"{_origin(error)}: {error}"[:1000]
    numeric = [w for w in warned if issubclass(w.category, RuntimeWarning)]
    if numeric and outcome in GOOD:
        where = "/".join(Path(numeric[0].filename).parts[-2:])
        outcome, message = "warned", f"{where}:{numeric[0].lineno}: {numeric[0].message}"
    return timed(outcome, message, time.perf_counter() - began, held, most_seconds)


def timed(outcome: str, message: str, seconds: float, held: int = 0, most_seconds: float = MOST_SECONDS) -> Verdict:
    """A verdict, which is bad where the time or the memory was too much; held: of the memory before, see
    `already_held`."""
    memory = peak_memory() - held
    if outcome in GOOD and seconds > most_seconds:
        outcome = "slow"
    if outcome in GOOD and memory > MOST_MEMORY:
        outcome = "memory"
    return Verdict(outcome, message, seconds, memory)


def classify_message(message: str, path: Path) -> tuple[str, str]:
    """Whether an InputError's message is short, one line, and names its file once."""
    if len(message) > LONGEST:
        return "long message", f"{len(message)} characters: {message[:300]}"
    if "\n" in message or not message.isprintable():
        return "message of several lines", repr(message)
    if max(message.count(f"{path}: "), message.count(f"{path.parent}: ")) > 1:
        return "wrapped twice", message
    return "refused", message


def _origin(error: BaseException) -> str:
    """File and line of our code that the exception left last."""
    trace, place = error.__traceback__, ""
    while trace is not None:
        path = Path(trace.tb_frame.f_code.co_filename)
        if any(part in path.parts for part in ("humanoid", "estimator", "kinemode", "viz")):
            place = f"{'/'.join(path.parts[-2:])}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place
