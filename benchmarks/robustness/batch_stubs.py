"""Batches whose jobs do nothing, led by a process that loads only what the command `kinemode batch` does: time and
memory of what is done beside the clips."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import kinemode as km
from benchmarks.support.proc import memory
from kinemode.batches import leader
from kinemode.batches.engines import ProcessEngine
from kinemode.batches.leader import BatchPlan, Leader, opened_root
from kinemode.batches.manifest import rows_of
from kinemode.batches.outcome import ClipOutcome, stamped
from kinemode.batches.task import BatchTask, TaskAnswer
from kinemode.target import made_folder
from viz.report.thumbnail import DONE, BatchEntry

WORKERS = 2
FRAMES = 60
Stub = Callable[[BatchTask], TaskAnswer]


@dataclass(frozen=True)
class LeaderCost:
    """The cost of a batch of stubs. rows: their number. clock, processor [s]: of all, and processor time of the leader.
    before, after, peak [MB]: memory of the leader before and after it, and the most."""

    rows: int
    clock: float
    processor: float
    before: float
    after: float
    peak: float

    @property
    def each(self) -> float:
        """Time a clip [ms]."""
        return 1e3 * self.clock / self.rows


def answer_alone(task: BatchTask) -> TaskAnswer:
    """A job that writes nothing."""
    return TaskAnswer(ClipOutcome(task.row.name, DONE))


def written_outcome(task: BatchTask) -> TaskAnswer:
    """A job that leaves an empty run and an outcome like that of a clip."""
    folder = made_folder(task.folder)
    file = folder / f"{task.row.name}.run"
    file.touch()
    run = BatchEntry(task.row.name, run=file.relative_to(task.root).as_posix(), frames=FRAMES, tracker="css")
    inputs = stamped(task.inputs)
    outcome = ClipOutcome(task.row.name, DONE, runs=(run,), options=task.digest, inputs=inputs, seconds=1.0)
    outcome.written(folder)
    return TaskAnswer(outcome)


def ready(_: None) -> None:
    """The first task of a process, which loads this module."""
    time.sleep(0.5)  # that another takes the next


def lead_alone(mappings: Sequence[Mapping[str, Any]], root: Path, job: Stub) -> LeaderCost:
    """The leader and its processes, without manifest, table and page."""
    plan = BatchPlan(rows_of(mappings), root)
    count = 0

    def counted(_: ClipOutcome) -> None:
        nonlocal count
        count += 1

    with opened_root(root) as token, ProcessEngine(WORKERS) as crew:
        for future in [crew.submit(ready, None) for _ in range(WORKERS)]:
            future.result()
        cost = _costs(len(mappings), lambda: Leader(plan, crew, token, counted, job).run())
    assert count == len(mappings)
    return cost


def whole_batch(manifest: Path, rows: int, root: Path, job: Stub) -> LeaderCost:
    """`kinemode.batch` with manifest, table, page and the start of its processes."""
    with patch.object(leader, "Leader", partial(Leader, job=job)):
        return _costs(rows, lambda: km.batch(manifest, out=root, workers=WORKERS))


def _costs(rows: int, work: Callable[[], object]) -> LeaderCost:
    before, begin = memory(), (time.perf_counter(), time.process_time())
    work()
    clock, processor = time.perf_counter() - begin[0], time.process_time() - begin[1]
    after = memory()
    return LeaderCost(rows, clock, processor, before.now, after.now, after.peak)
