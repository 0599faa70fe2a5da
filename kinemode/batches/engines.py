"""The engines of a batch: processes of this machine, by pebble, or the workers of a Dask scheduler. Both answer a
task with a future of `concurrent.futures`."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager
from typing import Any, Protocol

from estimator.numerics.processes import GUARD, begin_as_worker, checked_count, one_thread_each, processors
from humanoid.support.errors import InputError
from humanoid.support.extras import optional
from kinemode.batches.task import check_versions, versions

ENGINES = ("processes", "dask")
_PATIENCE = 15.0  # s, until a scheduler has answered
_DASK = "a batch on several machines"


class Engine(Protocol):
    """Runs work while it is entered; unfinished work is stopped at its end. deaths: after so many of processes
    that worked on a task it is the task's fault."""

    deaths: int

    def workers(self) -> int:
        """The current number of workers."""
        ...

    def submit(self, work: Callable[[Any], Any], task: Any) -> Future[Any]:
        """Submit it. The future raises one of `died` where its process is gone."""
        ...

    def once_a_machine(self, work: Callable[[], None]) -> None:
        """Have it done by one worker of each machine, and wait for it."""
        ...

    @property
    def died(self) -> tuple[type[Exception], ...]:
        """The exceptions of futures whose process is gone."""
        ...


class ProcessEngine:
    """Processes of this machine, each with one thread; see `Engine`."""

    deaths = 3

    def __init__(self, count: int) -> None:
        from pebble import ProcessExpired, ProcessPool

        self._count, self._died = count, (ProcessExpired,)
        # spawned: what a process has compiled or opened is not to be shared by halves
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPool(max_workers=count, initializer=begin_as_worker, context=context)
        self._threads: AbstractContextManager[None] = one_thread_each()

    def __enter__(self) -> ProcessEngine:
        self._threads.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.stop()
        self._pool.join()
        self._threads.__exit__(None, None, None)

    @property
    def died(self) -> tuple[type[Exception], ...]:
        """See `Engine`."""
        return self._died

    def workers(self) -> int:
        """See `Engine`."""
        return self._count

    def submit(self, work: Callable[[Any], Any], task: Any) -> Future[Any]:
        """See `Engine`."""
        return self._scheduled(work, task)

    def once_a_machine(self, work: Callable[[], None]) -> None:
        """See `Engine`."""
        self._scheduled(work).result()

    def _scheduled(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        try:
            future: Future[Any] = self._pool.schedule(work, args=arguments)
        except RuntimeError as error:  # a script without its guard runs again in every process, which then ends
            raise InputError("workers", f"end as soon as they start ({error})", remedy=GUARD) from None
        return future


class DaskEngine:
    """The workers of a Dask scheduler that runs already; see `Engine`.

    Raises
    ------
    InputError: no such scheduler, or none of the versions here; a worker with other versions, or of several threads.
    """

    deaths = 1  # the scheduler has tried several workers before it fails

    def __init__(self, scheduler: str) -> None:
        distributed = optional("distributed", "dask", _DASK)
        self._died = (distributed.KilledWorker,)
        try:
            self._client = distributed.Client(scheduler, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            remedy = "start one with dask scheduler; addresses are as tcp://192.168.0.5:8786"
            problem = f"cannot be reached: {' '.join(str(error).split())}"
            raise InputError(f"scheduler {scheduler}", problem, remedy=remedy) from None
        self._executor = self._client.get_executor(pure=False)

    def __enter__(self) -> DaskEngine:
        try:
            self._check()
        except BaseException:
            self._client.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close()

    def _check(self) -> None:
        for worker, threads in self._client.nthreads().items():
            if threads != 1:
                problem = f"has {threads} threads, of which one would change what another does"
                raise InputError(f"worker {worker}", problem, remedy="start it with --nthreads 1 --nworkers N")
        own = versions()
        theirs: Mapping[str, Any] = self._client.run(versions, on_error="return")
        for worker, found_there in theirs.items():
            if isinstance(found_there, Exception):
                raise InputError(f"worker {worker}", f"cannot work: {found_there}", remedy="install kinemode there")
            check_versions(own, found_there, worker)

    @property
    def died(self) -> tuple[type[Exception], ...]:
        """See `Engine`."""
        return self._died

    def workers(self) -> int:
        """See `Engine`."""
        return max(1, len(self._client.nthreads()))

    def submit(self, work: Callable[[Any], Any], task: Any) -> Future[Any]:
        """See `Engine`."""
        future: Future[Any] = self._executor.submit(work, task)
        return future

    def once_a_machine(self, work: Callable[[], None]) -> None:
        """See `Engine`."""
        by_machine = {address.rpartition(":")[0]: address for address in self._client.nthreads()}
        self._client.run(work, workers=list(by_machine.values()))


def engine_of(name: str, workers: int | None, scheduler: str | None) -> ProcessEngine | DaskEngine:
    """An engine by the arguments of `kinemode.batch`. Raises InputError for invalid ones."""
    if name not in ENGINES:
        raise InputError("engine", f"{name!r} is unknown", remedy=f"one of {', '.join(ENGINES)}")
    if name == "dask":
        if scheduler is None:
            raise InputError(
                "scheduler", "is needed by the engine dask", remedy="its address, as tcp://192.168.0.5:8786"
            )
        if workers is not None:
            raise InputError("workers", "are the scheduler's", remedy="leave it out")
        return DaskEngine(scheduler)
    if scheduler is not None:
        raise InputError("scheduler", "is of the engine dask", remedy="--engine dask, or leave it out")
    return ProcessEngine(checked_count(processors() if workers is None else workers))
