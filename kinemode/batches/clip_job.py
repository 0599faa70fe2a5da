"""A worker's work on one clip: what a single `kinemode track`, or `fit`, does, in a folder of the clip's own."""

from __future__ import annotations

import json
import os
import platform
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import HARD, TRACKED
from humanoid.support.errors import InputError, shortened
from humanoid.support.files import replacing
from humanoid.support.locks import locked
from kinemode.batches.outcome import FILE, ClipOutcome, FileStamp, stamped
from kinemode.batches.task import LOCK, TOKEN, BatchTask, TaskAnswer, check_versions, own_folder, versions
from kinemode.notices import InputWarning
from kinemode.target import made_folder
from viz.report.thumbnail import DONE, FAILED, BatchEntry

BEGUN, ERROR = "begun.json", "error.txt"


def work(task: BatchTask) -> TaskAnswer:
    """Do a task; what goes wrong is its outcome. Whoever comes with the same task meanwhile waits, and takes the
    outcome."""
    begin, used = time.perf_counter(), _processor_time()
    with _seen_root(task) as (own, shared), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")

        def ended(outcome: ClipOutcome) -> ClipOutcome:
            notes = dict.fromkeys(str(w.message) for w in caught if issubclass(w.category, InputWarning))
            seconds, spent = time.perf_counter() - begin, _processor_time() - used
            return replace(outcome, seconds=seconds, processor_seconds=spent, notes=tuple(notes))

        outcome, subject = _attempted(own, ended)
        return TaskAnswer(outcome, subject, {} if shared else _files_below(own.root))


def _processor_time() -> float:
    """Processor time of this process and of the programs that it has run [s]."""
    return sum(os.times()[:4])


@contextmanager
def _seen_root(task: BatchTask) -> Iterator[tuple[BatchTask, bool]]:
    """The task in the batch's folder where this machine sees it, in a temporary one elsewhere; and whether it does."""
    token = ""
    with suppress(OSError):
        token = _text(task.root / TOKEN)
    if token == task.token:
        yield task, True
        return
    with tempfile.TemporaryDirectory(prefix="kinemode-") as folder:
        yield replace(task, root=Path(folder)), False


def _files_below(root: Path) -> dict[str, bytes]:
    files = [path for path in root.rglob("*") if path.is_file() and path.name != LOCK]
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in files}


def _attempted(task: BatchTask, ended: Callable[[ClipOutcome], ClipOutcome]) -> tuple[ClipOutcome, str]:
    """The outcome, kept where it can be, and the subject of one that fits; ended: adds what the work took."""
    try:
        check_versions(task.versions, versions(), platform.node())
        folder = own_folder(task.folder)
        with locked(folder / LOCK):
            kept = ClipOutcome.kept(folder)
            if kept is not None and task.is_done(kept):
                return kept, _text(task.subject_file) if task.fits else ""
            outcome, subject = _fitted(task) if task.fits else (_tracked(task), "")
            outcome = ended(outcome)
            outcome.written(folder)
            return outcome, subject
    except InputError as error:
        failed = ended(ClipOutcome(task.row.name, FAILED, str(error)))
    except Exception as error:  # an unforeseen one of a clip; the others continue
        failed = ended(ClipOutcome(task.row.name, FAILED, _internal(task, error)))
    with suppress(OSError, InputError):
        if (task.folder / LOCK).exists():
            failed.written(task.folder)
    return failed, ""


def _internal(task: BatchTask, error: Exception) -> str:
    where = ""
    with suppress(OSError, InputError):
        (own_folder(task.folder) / ERROR).write_text("".join(traceback.format_exception(error)), encoding="utf-8")
        where = f"; {ERROR} in its folder shows where"
    return shortened(" ".join(f"internal error: {type(error).__name__}: {error}{where}".split()))


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def _fitted(task: BatchTask) -> tuple[ClipOutcome, str]:
    import kinemode as km

    inputs = stamped(task.inputs)
    file = own_folder(task.clip_folder) / f"{task.row.name}.urdf"  # the track takes the keypoints beside it too
    km.fit(task.row.subject, task.row.clips, **task.options, out=file)
    subject = _text(file)
    with replacing(task.subject_file) as temporary:
        temporary.write_text(subject, encoding="utf-8")
    return ClipOutcome(task.row.name, DONE, options=task.digest, inputs=inputs), subject


def _tracked(task: BatchTask) -> ClipOutcome:
    inputs = stamped(task.inputs)
    runs = _runs(task, inputs)
    several = len(runs) > 1
    tracked, faults = [], []
    for run in runs:
        facts, wrong = _around(task, run, run.file.stem if several else task.row.name)
        tracked.append(facts)
        faults += wrong
    message = "; ".join(dict.fromkeys(faults))
    status = FAILED if faults else DONE
    return ClipOutcome(task.row.name, status, message, tuple(tracked), task.digest, inputs, stamped(task.reference))


def _runs(task: BatchTask, inputs: dict[str, FileStamp]) -> Sequence[Run]:
    """The clip's runs: resumed where they started from the same inputs and options, otherwise started again."""
    import kinemode as km

    state = {"options": task.digest, "inputs": {name: stamp.digest for name, stamp in inputs.items()}, **versions()}
    begun, note = json.dumps(state, sort_keys=True), task.clip_folder / BEGUN
    file = task.clip_folder / f"{task.row.name}.run"
    goes_on = note.is_file() and _text(note) == begun and _opens(file)
    if not goes_on:
        _clear(task)
        with replacing(note) as temporary:
            temporary.write_text(begun, encoding="utf-8")
    if goes_on and file.is_file() and (run := km.open_run(file)).complete:
        return [run]
    subject = task.row.subject
    if task.subject:
        if not task.subject_file.is_file():
            made_folder(task.subject_file.parent)
            task.subject_file.write_text(task.subject, encoding="utf-8")
        subject = str(task.subject_file)
    tracked = km.track(subject, task.row.clips, **task.options, out=file, resume=goes_on, overwrite=not goes_on)
    return list(tracked.values()) if isinstance(tracked, dict) else [tracked]


def _opens(file: Path) -> bool:
    """Whether a run can be resumed, or none exists yet."""
    import kinemode as km

    with suppress(InputError):
        return not file.exists() or km.open_run(file) is not None
    return False


def _clear(task: BatchTask) -> None:
    """Remove what was made of the clip when it was another, and no other file; keypoints know themselves what they
    were made from."""
    kept = ClipOutcome.kept(task.clip_folder)
    for run in kept.runs if kept is not None else ():
        for name in (run.run, run.report, run.thumbnail, *run.exports.values()):
            if name:
                (task.root / name).unlink(missing_ok=True)
    for name in (FILE, ERROR):
        (task.clip_folder / name).unlink(missing_ok=True)


def _around(task: BatchTask, run: Run, name: str) -> tuple[BatchEntry, list[str]]:
    """The facts and files of a run, and messages on what could not be made."""
    import kinemode as km
    from viz.report.thumbnail import write_thumbnail

    faults: list[str] = []
    stem = run.file.with_suffix("")

    def made(what: str, file: Path) -> str:
        try:
            if what == "report":
                km.report(run, file)
            elif what == "thumbnail":
                write_thumbnail(run, file)
            else:
                km.export(run, file, format=what)
        except InputError as error:
            faults.append(f"tracked, but its {what} was not written: {error}")
            return ""
        return file.relative_to(task.root).as_posix()

    exports = {format: made(format, exported_file(stem, format)) for format in task.exports}
    anybody = bool(np.isfinite(run.q).all(axis=1).any())  # without a person there is nothing to draw
    report = made("report", beside(stem, "html")) if task.report and anybody else ""
    thumbnail = made("thumbnail", beside(stem, "jpg")) if anybody else ""
    error: float | None = None
    if task.row.reference is not None:
        try:
            error = float(km.evaluate(run, task.row.reference).mpjpe)
        except InputError as wrong:
            faults.append(f"tracked, but not compared: {wrong}")
    where = run.file.relative_to(task.root).as_posix()
    given = {format: file for format, file in exports.items() if file}
    entry = BatchEntry(
        name, run=where, report=report, thumbnail=thumbnail, exports=given, error=error, **run_facts(run)._asdict()
    )
    return entry, faults


def exported_file(stem: Path, format: str) -> Path:
    """Where a format goes beside a run: its own ending, or named where several formats have one ending."""
    ending = format.rpartition("-")[2]
    return beside(stem, ending if ending == format else f"{format[: -len(ending) - 1]}.{ending}")


def beside(stem: Path, ending: str) -> Path:
    """A file of the same name but its ending; names of clips may have dots."""
    return stem.with_name(f"{stem.name}.{ending}")


class RunFacts(NamedTuple):
    """Facts of a run, by the names of `BatchEntry`'s fields.

    frames: those that are tracked so far. hard, unobserved: how many have that status (`Run.status`, where frames that
    contradict the findings are hard; for the meanings see `STATUS_MEANINGS`). doubtful: the share of frames, 0 to 1,
    that plots and the report mark as unreliable: their status is not "tracked"; None of no frame. message: the
    first of the findings that were stored when it was finished, "" where it has none.
    """

    subject: str
    tracker: str
    frames: int
    hard: int
    unobserved: int
    doubtful: float | None
    message: str


def run_facts(run: Run) -> RunFacts:
    """Entry of a run in a batch: `BatchEntry(name, "done", **run_facts(run)._asdict())`."""
    status, count = run.status, len(run)
    hard, unobserved, tracked = (int(np.count_nonzero(status == name)) for name in (HARD, "unobserved", TRACKED))
    doubtful = 1.0 - tracked / count if count else None
    message = next(iter(run.header.findings or ()), "")
    return RunFacts(run.subject.name, run.header.tracker, count, hard, unobserved, doubtful, message)
