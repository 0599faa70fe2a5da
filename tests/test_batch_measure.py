"""The measure of batches is right: it sees runs that differ by a bit, clips that were done twice, and times on free
processors."""

from __future__ import annotations

import multiprocessing
import os
from pathlib import Path

import numpy as np
import pytest
from builders import body_of

from benchmarks.robustness.batch import new_folder
from benchmarks.robustness.batch_clips import batch_run, unequal_runs, write_csv
from benchmarks.robustness.batch_engines import ONE, TWO, BatchTimes, ratio
from benchmarks.robustness.batch_kills import WORKERS, done_again, finished_clips, message_of, moments_of
from benchmarks.robustness.batch_overhead import more_ms
from benchmarks.robustness.batch_soak import WorkerSample, grown, measure_soak
from benchmarks.robustness.batch_stubs import LeaderCost, answer_alone, written_outcome
from benchmarks.support.proc import ResidentMemory, is_alive, memory, seconds_until_gone, spawned_workers
from humanoid.support.errors import InputError
from kinemode.batches.engines import processors
from kinemode.batches.manifest import read_manifest, rows_of
from kinemode.batches.outcome import ClipOutcome
from kinemode.batches.task import BatchTask
from tests.made_runs import made_run
from tests.waiting import until
from viz.report.thumbnail import DONE, FAILED

SUBJECT = body_of("human34").subject


def poses(last_bit: bool = False) -> np.ndarray:
    q = np.tile(body_of("human34").neutral, (2, 1, 1))
    if last_bit:
        q[1, 0, -1] = np.nextafter(q[1, 0, -1], 1.0)
    return q


def run_of(root: Path, name: str, *, last_bit: bool = False) -> Path:
    file = batch_run(root, name)
    file.parent.mkdir(parents=True)
    made_run(file, SUBJECT, poses(last_bit))
    return file


def test_differing_and_missing_runs_are_reported(tmp_path: Path) -> None:
    alone, root = tmp_path / "alone", tmp_path / "batch"
    single = {name: run_of(alone, name) for name in "abc"}
    run_of(root, "a")
    run_of(root, "b", last_bit=True)
    wrong = unequal_runs(single, root)
    assert len(wrong) == 2
    assert wrong[0].startswith("b: different from frame 1 on")
    assert wrong[1] == "c: there is no run"
    assert unequal_runs(single, root, ["a"]) == []


def task_of(root: Path, keypoints: Path) -> BatchTask:
    (row,) = rows_of([{"name": "walk", "keypoints": str(keypoints)}])
    return BatchTask(row, root, "")


def test_a_stub_is_finished_and_one_that_is_done_again_is_seen(tmp_path: Path) -> None:
    keypoints = tmp_path / "walk.json"
    keypoints.write_text("[]")
    task = task_of(tmp_path / "batch", keypoints)
    assert answer_alone(task).outcome.status == DONE
    assert finished_clips(task.root) == {}
    written_outcome(task)
    assert task.is_done(ClipOutcome.kept(task.folder))
    before = finished_clips(task.root)
    assert done_again(before, finished_clips(task.root)) == []
    ClipOutcome("walk", FAILED, "no keypoints").written(task.folder)
    assert done_again(before, finished_clips(task.root)) == ["walk was done again"]
    assert message_of(task.root, "walk") == "no keypoints"
    assert message_of(task.root, "run") == ""
    assert done_again(before, {}) == ["walk was done again"]


def test_a_manifest_of_names_with_spaces_is_read_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "two words.json"
    file.write_text("[]")
    (row,) = read_manifest(write_csv(tmp_path / "a.csv", [{"name": "walk", "keypoints": str(file)}]))
    assert row.options["keypoints"] == [str(file)]


def test_times_on_free_processors() -> None:
    single, double = BatchTimes(14.0, 4.0, (9.0,), 0.5), BatchTimes(9.0, 4.0, (4.0, 5.0), 1.0)
    assert single.clock == 10.0
    assert single.bound == max(9.0, 9.5 / processors())
    assert double.bound == max(5.0, 10.0 / processors())
    assert ratio({ONE: single, TWO: double}, ONE, TWO, "clock") == 2.0
    assert ratio({ONE: single}, ONE, TWO, "clock") is None


def test_the_start_is_not_counted_in_one_more_clip() -> None:
    listed = [LeaderCost(rows, 4.0 + 0.003 * rows, 0.0, 0.0, 0.0, 0.0) for rows in (100, 1000)]
    assert listed[0].each == pytest.approx(43.0)
    assert more_ms(listed) == pytest.approx(3.0)


def test_moments_are_in_order_and_before_the_end() -> None:
    when = moments_of(np.random.default_rng(0), 10, 24, 2.0)
    counts = [count for count, _ in when]
    assert len(when) == 10
    assert counts == sorted(counts)
    assert counts[:2] == [0, 0]
    assert counts[-1] < 24 - WORKERS


def test_growth_counts_living_workers_alone() -> None:
    first = WorkerSample(10, {1: ResidentMemory(90.0, 100.0), 2: ResidentMemory(90.0, 100.0)})
    last = WorkerSample(200, {1: ResidentMemory(80.0, 110.0), 3: ResidentMemory(500.0, 500.0)})
    assert grown([first, last]) == [pytest.approx(1.1)]


@pytest.mark.parametrize("window", [2, 51])
def test_a_soak_of_less_than_two_windows_is_refused(tmp_path: Path, window: int) -> None:
    with pytest.raises(InputError, match="must be 3 to 50"):
        measure_soak(tmp_path, 100, window, "off", None)


def test_processes_are_read_from_the_system() -> None:
    own = memory()
    assert 0.0 < own.now <= own.peak
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    worker = context.Process(target=theirs.recv)
    worker.start()
    until(lambda: worker.pid in spawned_workers(), "the worker's program has begun")
    assert worker.pid is not None
    assert is_alive(worker.pid)
    worker.kill()
    worker.join()
    assert not is_alive(worker.pid)
    assert worker.pid not in spawned_workers()
    assert seconds_until_gone([worker.pid], 0.0) < float("inf")
    assert seconds_until_gone([os.getpid()], 0.0) == float("inf")
    ours.close()


def test_a_folder_of_another_time_is_refused(tmp_path: Path) -> None:
    assert new_folder(tmp_path / "new").is_dir()
    with pytest.raises(InputError, match="another time"):
        new_folder(tmp_path / "new")
