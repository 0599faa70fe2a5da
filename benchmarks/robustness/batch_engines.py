"""A batch by one process, by two, and by two workers of Dask, beside single calls: time, and the same bits.

The start is timed apart: until each worker has loaded everything and tracked a clip of its own. What is compiled is
compiled before.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import patch

import kinemode as km
from benchmarks.robustness.batch_clips import Mappings, short_clips, single_runs, unequal_runs
from benchmarks.support.common import tell
from benchmarks.support.proc import processor_seconds
from humanoid.support.errors import InputError
from kinemode.batches import engines
from kinemode.batches.clip_job import work
from kinemode.batches.engines import Engine, processors
from kinemode.batches.manifest import rows_of
from kinemode.batches.task import BatchTask, TaskAnswer
from kinemode.compilation import made_kernels
from kinemode.terminal import report

ONE, TWO, DASK = "one process", "two processes", "dask, two workers"
TWO_TO_ONE, DASK_TO_TWO = 1.8, 0.9  # targets
WARM_FRAMES = 8
_PATIENCE = 300.0  # s, until all workers are ready


@dataclass(frozen=True)
class BatchTimes:
    """The times of one batch.

    whole [s]: the call of `kinemode.batch`. start [s]: of it, until every worker was ready. workers, leader: processor
    time [s] after that, of each worker and of the process that leads. unequal: what is not as in the single runs.
    """

    whole: float
    start: float
    workers: tuple[float, ...]
    leader: float
    unequal: tuple[str, ...] = ()

    @property
    def clock(self) -> float:
        """The time without the start [s]."""
        return self.whole - self.start

    @property
    def bound(self) -> float:
        """The wall-clock time on free processors [s]: the busiest worker's processor time, or that of all and the
        leader over as many processors as there are, whichever is more."""
        return max(*self.workers, (sum(self.workers) + self.leader) / processors())


@dataclass(frozen=True)
class WarmUp:
    """The preparation of a worker. task: a clip to be tracked. folder: for its announcement. count: of the workers, for
    all of which it waits, so that each does it once."""

    task: BatchTask
    folder: Path
    count: int


def warmed(given: WarmUp) -> TaskAnswer:
    """Track the clip, whose root is not there, in a folder of this process's own, and wait for the other workers."""
    answer = work(given.task)
    (given.folder / str(os.getpid())).touch()
    deadline = time.monotonic() + _PATIENCE
    while len(list(given.folder.iterdir())) < given.count and time.monotonic() < deadline:
        time.sleep(0.01)
    return answer


class WarmEngine:
    """An engine whose workers are ready once it is entered, and that reads their clocks then and before it ends."""

    def __init__(self, engine: AbstractContextManager[Engine], task: BatchTask, folder: Path) -> None:
        self._engine, self._task, self._folder = engine, task, folder

    def __enter__(self) -> Engine:
        crew = self._engine.__enter__()
        try:
            self._warm(crew)
        except BaseException as error:
            self._engine.__exit__(type(error), error, error.__traceback__)
            raise
        self.entered = time.perf_counter()
        self._before = self._clocks()
        return crew

    def __exit__(self, *error: Any) -> None:
        after = self._clocks()
        *self.workers, self.leader = (b - a for a, b in zip(self._before, after, strict=True))
        self._engine.__exit__(*error)

    def _warm(self, crew: Engine) -> None:
        count = crew.workers()
        given = WarmUp(self._task, self._folder, count)
        for future in [crew.submit(warmed, given) for _ in range(count)]:
            outcome = future.result().outcome
            if outcome.message:
                raise InputError("a worker", f"could not track the first clip: {outcome.message}")
        self._processes = sorted(int(mark.name) for mark in self._folder.iterdir())
        if len(self._processes) != count:
            raise InputError("workers", f"{len(self._processes)} of {count} were ready in {_PATIENCE:.0f} s")

    def _clocks(self) -> list[float]:
        """Processor time of each worker [s], and of this process."""
        return [*map(processor_seconds, self._processes), time.process_time()]


def timed_batch(rows: Mappings, root: Path, warm: BatchTask, **how: Any) -> BatchTimes:
    """A batch by `kinemode.batch`, how: its engine, with workers that are ready before the first clip."""
    marks = root.with_name(f"{root.name}-ready")
    marks.mkdir()
    made: list[WarmEngine] = []
    plain = engines.engine_of

    def warm_engine(*arguments: Any) -> WarmEngine:
        made.append(WarmEngine(plain(*arguments), warm, marks))
        return made[0]

    begin = time.perf_counter()
    with patch.object(engines, "engine_of", warm_engine):
        km.batch(rows, out=root, **how)
    end = time.perf_counter()
    (engine,) = made
    return BatchTimes(end - begin, engine.entered - begin, tuple(engine.workers), engine.leader)


@contextmanager
def dask_cluster(count: int) -> Iterator[str]:
    """The address of a scheduler with so many workers on this machine, each a process with one thread."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        yield str(cluster.scheduler_address)


def measure_engines(folder: Path, clips: int, frames: int, settings: Path | None) -> dict[str, Any]:
    """Print the table; the figures."""
    rows = short_clips(folder / "inputs", clips, frames, settings)
    (row,) = rows_of(short_clips(folder / "first", 1, WARM_FRAMES, settings))
    warm = BatchTask(row, folder / "no_such_folder", "")
    made_kernels()
    begin = time.perf_counter(), time.process_time()
    single = single_runs(rows, folder / "single")
    alone = time.perf_counter() - begin[0], time.process_time() - begin[1]
    times: dict[str, BatchTimes] = {}

    def measure(name: str, **how: Any) -> None:
        root = folder / f"batch{len(times)}"
        measured = timed_batch(rows, root, warm, **how)
        times[name] = replace(measured, unequal=tuple(unequal_runs(single, root)))
        tell(f"{name}: {times[name].clock:.1f} s")

    measure(ONE, workers=1)
    measure(TWO, workers=2)
    if find_spec("distributed") is not None:
        with dask_cluster(2) as scheduler:
            measure(DASK, engine="dask", scheduler=scheduler)
    show_engines(times, alone, f"{clips} clips of {frames} frames")
    ratios = {name: {kind: ratio(times, *pair, kind) for kind in KINDS} for name, pair in RATIOS.items()}
    listed = {name: {**asdict(each), "clock": each.clock, "bound": each.bound} for name, each in times.items()}
    return {"clips": clips, "frames": frames, "single": alone, "engines": listed, "ratios": ratios}


KINDS = ("whole", "clock", "bound")
RATIOS = {"two to one": (ONE, TWO), "dask to two": (TWO, DASK)}
"""Speeds: that of the second in terms of the first's."""


def ratio(times: Mapping[str, BatchTimes], slow: str, fast: str, kind: str) -> float | None:
    """The speed of the second relative to the first; None where one was not measured."""
    if slow not in times or fast not in times:
        return None
    return float(getattr(times[slow], kind) / getattr(times[fast], kind))


def show_engines(times: Mapping[str, BatchTimes], alone: tuple[float, float], title: str) -> None:
    """Times, ratios and what is not equal."""
    columns = ("[s]", "whole", "start", "without start", "workers, processor", "leader, processor", "on free cores")
    made = report.table(title, *columns)
    made.add_row("single calls", f"{alone[0]:.1f}", "", "", f"{alone[1]:.1f}", "", "")
    for name in (ONE, TWO, DASK):
        if name not in times:
            made.add_row(name, "not installed", "", "", "", "", "")
            continue
        each = times[name]
        workers = " + ".join(f"{seconds:.1f}" for seconds in each.workers)
        numbers = (f"{seconds:.1f}" for seconds in (each.whole, each.start, each.clock))
        made.add_row(name, *numbers, workers, f"{each.leader:.1f}", f"{each.bound:.1f}")
    out = report.console()
    out.print(made)
    out.print(
        "whole: the call of km.batch; start: of it, until each worker has loaded all and tracked a clip of its own, at"
        " Dask without that of its workers; on free cores: processor time of the busiest worker, or of all and the"
        f" leader over {processors()} processors, whichever is more"
    )
    for (name, pair), target in zip(RATIOS.items(), (TWO_TO_ONE, DASK_TO_TWO), strict=True):
        found_ratios = {kind: ratio(times, *pair, kind) for kind in KINDS}
        if None not in found_ratios.values():
            said = ", ".join(
                f"{value:.2f} {words}"
                for value, words in zip(found_ratios.values(), ("whole", "without start", "on free cores"), strict=True)
            )
            out.print(f"{name}: {said} (target: at least {target:g})")
    for name, each in times.items():
        equal = "equal to single calls to the last bit" if not each.unequal else "\n  ".join(each.unequal)
        out.print(f"{name}: {equal}")
