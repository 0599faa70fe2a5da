"""Which clip is done next: what is finished is left, a person is fitted before that person's clips are tracked, and who
dies is followed by another."""

from __future__ import annotations

import secrets
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from humanoid.support.errors import InputError, shortened
from humanoid.support.files import replacing
from humanoid.support.locks import held
from kinemode.batches.clip_job import work
from kinemode.batches.engines import Engine
from kinemode.batches.manifest import BatchRow
from kinemode.batches.outcome import ClipOutcome
from kinemode.batches.task import TOKEN, BatchTask, TaskAnswer, own_folder, versions
from kinemode.compilation import are_made, made_kernels
from kinemode.progress import Reporter, unreported
from kinemode.target import check_absent, made_folder
from viz.report.thumbnail import DONE, FAILED

TABLE, PAGE = SHOWN = ("summary.csv", "index.html")
"""The display of all clips."""
_AHEAD = 2  # tasks a worker, that none waits for the leader
_LONGEST = 200  # characters of why a process died
_LOOK = 1.0  # s

Told = Callable[[ClipOutcome], None]
"""Takes the outcome of a clip as soon as there is one."""


@dataclass(frozen=True)
class BatchPlan:
    """The plan of a batch. rows: the clips. root: the batch's folder, absolute. exports, report: for every clip."""

    rows: Sequence[BatchRow]
    root: Path
    exports: tuple[str, ...] = ()
    report: bool = False


@contextmanager
def opened_root(root: Path) -> Iterator[str]:
    """The folder of a batch, made and held against another batch; the token that its workers know it by.

    Raises InputError where it cannot be written to, another batch works in it, or it has files of others in the places
    of its own.
    """
    made_folder(root)
    if not (root / TOKEN).exists():
        check_absent([root / name for name in SHOWN], False, False, "name another folder for the batch")
    with held(root / f"{TOKEN}.lock") as ours:
        if not ours:
            raise InputError(root, "another batch works in it", remedy="wait for it, or name another folder")
        token = secrets.token_hex(8)
        with replacing(root / TOKEN) as temporary:
            temporary.write_text(token, encoding="utf-8")
        yield token


class Leader:
    """Hands the tasks of a plan to an engine.

    A reported clip leaves nothing in memory, so that a batch may have any length.
    """

    def __init__(
        self, plan: BatchPlan, engine: Engine, token: str, told: Told, job: Callable[[BatchTask], TaskAnswer] = work
    ) -> None:
        self._engine, self._told, self._job = engine, told, job
        self._base = BatchTask(
            plan.rows[0], plan.root, token, exports=plan.exports, report=plan.report, versions=versions()
        )
        self._rows = plan.rows
        self._subjects: dict[str, str] = {}  # of the persons that are fitted
        self._unfitted: dict[str, str] = {}  # why persons are not
        self._waiting: dict[str, list[BatchRow]] = {}
        self._tasks, self._again = self._planned(), deque[BatchTask]()
        self._deaths: Counter[tuple[str, bool]] = Counter()

    def run(self, after: Callable[[], None] = lambda: None) -> None:
        """Until every clip has an outcome; after: called at first, and whenever something was answered."""
        after()
        pending: dict[Future[TaskAnswer], BatchTask] = {}
        while True:
            while len(pending) < _AHEAD * self._engine.workers() and (task := self._next()) is not None:
                pending[self._engine.submit(self._job, task)] = task
            if not pending:
                return
            done, _ = wait(pending, timeout=_LOOK, return_when=FIRST_COMPLETED)
            for future in done:
                self._answered(pending.pop(future), future)
            after()

    def prepare(self, progress: Reporter) -> None:
        """Report what is done already; where there is more to do compile functions before all workers need them."""
        first = self._next()
        if first is None:
            return
        self._again.append(first)
        with (unreported if are_made() else progress)("compiling, once") as report, suppress(Exception):
            report(0, 1)
            self._engine.once_a_machine(made_kernels)  # what is wrong with it is reported by the clips
            report(1, 1)

    def _next(self) -> BatchTask | None:
        return self._again.popleft() if self._again else next(self._tasks, None)

    def _planned(self) -> Iterator[BatchTask]:
        """Persons first, so that no clip waits for them at the end; then the clips that have their subjects."""
        fitted_from = {row.person: row for row in self._rows if row.fits}
        self._waiting = {person: [] for person in fitted_from}
        for row in fitted_from.values():
            task = replace(self._base, row=row, fits=True)
            if task.is_done(ClipOutcome.kept(task.folder)):
                self._fitted(row.person, task.subject_file.read_text(encoding="utf-8"))
            else:
                yield task
        for row in self._rows:
            if row.person in self._waiting:
                self._waiting[row.person].append(row)
            else:
                yield from self._clip(row)

    def _clip(self, row: BatchRow) -> Iterator[BatchTask]:
        """The task of a clip, unless it is done, or impossible."""
        if row.person in self._unfitted:
            why = f"{row.person} has no subject: {self._unfitted[row.person]}"
            self._told(ClipOutcome(row.name, FAILED, why))
            return
        task = replace(self._base, row=row, subject=self._subjects.get(row.person, ""))
        kept = ClipOutcome.kept(task.folder)
        if kept is not None and task.is_done(kept):
            self._told(kept)
        else:
            yield task

    def _fitted(self, person: str, subject: str) -> None:
        """Queue a person's clips once the fit has ended, with its subject unless that is empty."""
        if subject:
            self._subjects[person] = subject
        for row in self._waiting.pop(person, []):
            self._again.extend(self._clip(row))

    def _answered(self, task: BatchTask, future: Future[TaskAnswer]) -> None:
        try:
            answer = future.result()
        except self._engine.died as error:
            last = self._died(task, error)
            if last is None:
                return
            answer = last
        except Exception as error:  # the answer was lost on its way
            answer = TaskAnswer(ClipOutcome(task.row.name, FAILED, f"no answer: {type(error).__name__}: {error}"))
        outcome = self._with_files(task, answer)
        if not task.fits:
            self._told(outcome)
        elif outcome.status == DONE:
            self._fitted(task.row.person, answer.subject)
        else:
            self._unfitted[task.row.person] = f"the fit from {task.row.name} failed: {outcome.message}"
            self._fitted(task.row.person, "")

    def _died(self, task: BatchTask, error: Exception) -> TaskAnswer | None:
        """None where the task is done once more."""
        key = (task.row.name, task.fits)
        self._deaths[key] += 1
        if self._deaths[key] < self._engine.deaths:
            self._again.append(task)
            return None
        why = f"every process that worked on it was killed (is there memory for it?): {' '.join(str(error).split())}"
        outcome = ClipOutcome(task.row.name, FAILED, shortened(why, _LONGEST))
        with suppress(InputError, OSError):
            outcome.written(own_folder(task.folder))
        return TaskAnswer(outcome)

    def _with_files(self, task: BatchTask, answer: TaskAnswer) -> ClipOutcome:
        """The outcome, with the files of a worker elsewhere in their places."""
        try:
            if answer.files:
                own_folder(task.folder)
                own_folder(task.clip_folder)
            for name, content in answer.files.items():
                file = task.root / name
                made_folder(file.parent)
                with replacing(file) as temporary:
                    temporary.write_bytes(content)
        except InputError as error:
            return replace(answer.outcome, status=FAILED, message=str(error))
        return answer.outcome
