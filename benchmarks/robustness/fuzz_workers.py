"""Worker processes for inputs that may crash, hang or eat up the memory: after any of them the next is tried."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from benchmarks.robustness.fuzz_cases import MOST_MEMORY, MOST_SECONDS, Case, Verdict, forget_peak

Judge = Callable[[Case, Any, Path], Verdict]
_BATCH = 50
_PATIENCE = 1.5 * MOST_SECONDS
_ROOM = 4 * MOST_MEMORY  # address space beyond the start's: what is over it is refused by the system
_START = 120.0  # s that a worker may take to come up


class _Worker:
    """One process and the cases it was given; deadline: by when something has to come of it."""

    def __init__(self, judge: Judge, corpus: Path, deadline: float) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_serve, args=(theirs, judge, corpus), daemon=True)
        self.process.start()
        theirs.close()
        self.cases: list[Case] = []
        self.deadline = deadline

    def give(self, cases: list[Case]) -> None:
        self.cases = cases
        self.connection.send(cases)

    def end(self, patience: float = 0.0) -> int | None:
        """Kill it; its exit code where it had ended by itself, or does so in the time that it is given [s]."""
        self.process.join(patience)
        code = self.process.exitcode
        self.process.kill()
        self.process.join()
        self.connection.close()
        return code


def verdicts(
    judge: Judge,
    corpus: object,
    cases: Sequence[Case],
    jobs: int,
    batch: int = _BATCH,
    patience: float = _PATIENCE,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[tuple[Case, Verdict]]:
    """The verdict on each case, as they come.

    judge: a function of a module. corpus: what it needs, once a process. batch: cases that are sent together.
    patience [s]: a worker without an answer for so long, by the clock, is killed.
    """
    waiting = [list(cases[i : i + batch]) for i in range(0, len(cases), batch)][::-1]
    with tempfile.TemporaryDirectory(prefix="kinemode-fuzz-") as folder:
        stored = Path(folder) / "corpus"
        stored.write_bytes(pickle.dumps(corpus))

        def another() -> _Worker:
            return _Worker(judge, stored, clock() + max(_START, patience))

        workers = [another() for _ in range(min(jobs, len(waiting)))]
        try:
            for worker in workers:
                worker.give(waiting.pop())
            while workers:
                yield from _round(workers, waiting, another, patience, clock)
        finally:
            for worker in workers:
                worker.end()


def _round(
    workers: list[_Worker],
    waiting: list[list[Case]],
    another: Callable[[], _Worker],
    patience: float,
    clock: Callable[[], float],
) -> Iterator[tuple[Case, Verdict]]:
    """Pending answers of the workers; dead ones are replaced, late ones killed."""
    ready = wait([w.connection for w in workers], timeout=0.5)
    for worker in list(workers):
        bad: Verdict | None = None
        if worker.connection in ready:
            try:
                verdict = worker.connection.recv()
            except (EOFError, OSError):
                bad = Verdict("crash", f"exit code {worker.end(patience)}")
            else:
                yield worker.cases.pop(0), verdict
                worker.deadline = clock() + patience
        elif clock() > worker.deadline and not worker.connection.poll():  # or it was we who were late
            worker.end()
            bad = Verdict("hang", f"nothing for {patience:.0f} s", patience)
        if bad is not None:
            yield worker.cases.pop(0), bad
        if not worker.cases and not waiting:
            workers.remove(worker)
            worker.end()
            continue
        if bad is not None:
            rest = worker.cases
            workers[workers.index(worker)] = worker = another()
            worker.give(rest or waiting.pop())
        elif not worker.cases:
            worker.give(waiting.pop())


def _serve(connection: Connection, judge: Judge, stored: Path) -> None:
    """A worker's life: cases in, verdicts out, until its leader is gone."""
    corpus = pickle.loads(stored.read_bytes())
    printed = _captured()
    limit_memory()
    with tempfile.TemporaryDirectory(prefix="kinemode-fuzz-") as folder, suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            for case in connection.recv():
                forget_peak()
                verdict = judge(case, corpus, Path(folder) / "case")
                connection.send(_with_printed(verdict, printed))


def _captured() -> int:
    """A file that takes what is printed on descriptors 1 and 2."""
    handle, name = tempfile.mkstemp(prefix="kinemode-fuzz-")
    os.unlink(name)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    return handle


def _with_printed(verdict: Verdict, handle: int) -> Verdict:
    """A reader that prints is at fault; commands capture their own output and leave nothing here."""
    sys.stdout.flush()
    sys.stderr.flush()
    size = os.lseek(handle, 0, os.SEEK_END)
    if not size:
        return verdict
    text = os.pread(handle, 600, 0).decode("utf-8", "replace")
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    return Verdict("printed", text, verdict.seconds, verdict.memory) if verdict.good else verdict


def limit_memory() -> None:
    """Refuse far more memory than is allowed, so that the machine does not suffer."""
    with suppress(ValueError, OSError):
        status = Path("/proc/self/statm").read_text().split() if sys.platform == "linux" else ["0"]
        size = int(status[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + _ROOM, size + _ROOM))
