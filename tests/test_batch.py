"""Many clips: each tracked as by a single `track`, none twice, none stopped by another."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import kinemode as km
import kinemode.__main__ as front
from estimator.runs.run_reader import Run
from estimator.synthesis.detector import keypoints
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import motion_named
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.batches import engines
from kinemode.batches.clip_job import _around, work
from kinemode.batches.engines import DaskEngine, Engine, ProcessEngine, engine_of
from kinemode.batches.leader import BatchPlan, Leader, opened_root
from kinemode.batches.manifest import BatchRow
from kinemode.batches.outcome import ClipOutcome, input_files, stamped, unchanged
from kinemode.batches.shown import ShownBatch
from kinemode.batches.task import TOKEN, BatchTask, TaskAnswer, check_versions, versions
from tests.builders import body_of
from tests.deadly_square import square
from tests.inline_engine import Inline
from tests.made_runs import made_run
from tests.tiny_clip import QUICK_BY_KEYPOINTS
from tests.waiting import ended, kinemode_process, until
from viz.report.thumbnail import DONE, FAILED, BatchEntry, look_ranks

FRAMES, FPS = 5, 15.0


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A manifest of three clips of which one is broken."""
    folder, body = tmp_path_factory.mktemp("clips"), body_of("human34")
    q = authored_motion(body, np.arange(3 * FRAMES) / FPS, motion_named("turn_reach"))
    (camera,) = framing_cameras(body.landmarks_of(body.placed(q)), ViewSettings(count=1))
    km.write_cameras(folder / "cameras.json", [camera])
    quiet = DetectorSettings(noise_px=1.0, outlier_fraction=0.0, missing_fraction=0.0)
    (track,) = keypoints(body, q, [camera], np.random.default_rng(0), quiet, fps=FPS)
    for i, name in enumerate(("first", "second")):
        some = slice(i * FRAMES, (i + 1) * FRAMES)
        km.write_keypoints(
            folder / f"{name}.json", replace(track, pixels=track.pixels[some], confidence=track.confidence[some])
        )
    (folder / "broken.json").write_text("{")
    (folder / "quick.toml").write_text(tomli_w.dumps(QUICK_BY_KEYPOINTS))
    rows = [f"{name},{camera.name}={name}.json,cameras.json,quick.toml,off" for name in ("first", "broken", "second")]
    (folder / "clips.csv").write_text("\n".join(["name,keypoints,cameras,settings,fit", *rows, ""]))
    return folder


def single(clips: Path, name: str, out: Path) -> Run:
    """The clip tracked alone."""
    (keys,) = [f"{next(iter(km.load_cameras(clips / 'cameras.json')))}={clips / name}.json"]
    return km.track(
        "human34", (), keypoints=[keys], cameras=str(clips / "cameras.json"), settings=str(clips / "quick.toml"),
        fit="off", out=out,
    )  # fmt: skip


def content(run: Path) -> list[Any]:
    """All content of a run file but its creation time."""
    with sqlite3.connect(f"file:{run}?mode=ro", uri=True) as connection:
        tables = sorted(name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'"))
        return [(t, sorted(connection.execute(f"SELECT * FROM {t}"))) for t in tables if t != "finished"]


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Batches are tracked in this process; `test_a_batch_that_is_killed_goes_on` has processes of their own."""
    monkeypatch.setattr(engines, "engine_of", lambda *_: Inline())


@pytest.mark.usefixtures("inline")
def test_clips_are_tracked_as_alone_and_not_twice(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = km.batch(clips / "clips.csv", out=out, workers=2, export="csv")
    assert list(done.outcomes) == ["first", "broken", "second"]
    assert list(done.failed) == ["broken"]
    assert "broken.json" in done.failed["broken"]
    for name in ("first", "second"):
        run = out / "clips" / name / f"{name}.run"
        assert content(run) == content(single(clips, name, tmp_path / f"{name}.run").file)
        assert run.with_suffix(".csv").is_file()
        assert run.with_suffix(".jpg").is_file()
    assert done.table is not None
    assert done.page is not None
    assert done.table.read_text().count("\n") == 4
    assert "second.run" in done.page.read_text()
    before = {path: path.stat().st_mtime_ns for path in out.glob("clips/*/*") if path.parent.name != "broken"}
    os.utime(clips / "first.json")  # same content
    assert km.batch(clips / "clips.csv", out=out, workers=1, export="csv").outcomes["first"] == done.outcomes["first"]
    assert {path: path.stat().st_mtime_ns for path in before} == before
    other = (clips / "clips.csv").read_text().splitlines()
    (clips / "other.csv").write_text("\n".join([f"{other[0]},seed", f"{other[1]},3", f"{other[3]},"]))
    run = (out / "clips" / "second" / "second.run").stat().st_mtime_ns
    changed = km.batch(clips / "other.csv", out=out, workers=1, export="csv,trc")
    assert set(changed.outcomes["second"].runs[0].exports) == {"csv", "trc"}  # of the current run
    assert (out / "clips" / "second" / "second.run").stat().st_mtime_ns == run
    assert km.open_run(out / changed.outcomes["first"].runs[0].run).header.seed == 3


@pytest.mark.usefixtures("few_figures")
def test_a_clip_without_a_person_is_done_and_reviewed_first(tmp_path: Path) -> None:
    """It has no picture and no report, which show poses, but everything else."""
    root, subject, body = tmp_path.resolve(), load_subject("human34"), body_of("human34")
    task = BatchTask(BatchRow("clip", "row 1"), root, "", exports=("csv",), report=True)
    task.clip_folder.mkdir(parents=True)
    q = np.tile(body.neutral, (3, 1, 1))
    seen = made_run(task.clip_folder / "seen.run", subject, q)
    nobody = made_run(task.clip_folder / "nobody.run", subject, np.nan * q, status=["unobserved"] * 3)
    made = [_around(task, run, run.file.stem) for run in (seen, nobody)]
    assert [faults for _, faults in made] == [[], []]
    assert [(bool(run.thumbnail), bool(run.report), set(run.exports)) for run, _ in made] == [
        (True, True, {"csv"}),
        (False, False, {"csv"}),
    ]
    assert {file.stem for file in root.rglob("*.jpg")} == {"seen"}
    shown = ShownBatch([task.row], root, "")
    shown.put(ClipOutcome("clip", DONE, runs=tuple(run for run, _ in made)))
    assert [entry.status for entry in shown.entries()] == [DONE, DONE]
    assert look_ranks(shown.entries()) == (None, 1)


@pytest.mark.usefixtures("inline")
def test_a_killed_batch_resumes(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """SIGKILL of the leader as soon as the first clip is done: its workers end too, and the rest is as alone."""
    line = ["batch", str(clips / "clips.csv"), "--out", str(tmp_path / "out"), "--workers", "1"]
    process = kinemode_process(line)
    first = tmp_path / "out" / "clips" / "first" / "outcome.json"
    until(first.is_file, "the first clip is done")
    kept = first.stat().st_mtime_ns
    process.send_signal(signal.SIGKILL)
    ended(process)  # and its workers, which have its pipes
    assert front.main(line) == 2
    out, errors = capsys.readouterr()
    assert "2 of 3 clips tracked" in out
    assert "1 clip failed" in errors
    assert first.stat().st_mtime_ns == kept
    second = tmp_path / "out" / "clips" / "second" / "second.run"
    assert content(second) == content(single(clips, "second", tmp_path / "second.run").file)


def test_a_person_is_fitted_once(clips: Path, tmp_path: Path) -> None:
    camera = next(iter(km.load_cameras(clips / "cameras.json")))
    rows = [
        {
            "name": name, "person": "Ann B", "keypoints": f"{camera}={name}.json", "cameras": "cameras.json",
            "settings": "quick.toml", "height": 1.7,
        }
        for name in ("first", "second")
    ]  # fmt: skip
    task = BatchTask(km_rows(rows, clips)[0], tmp_path, "x", fits=True)
    (tmp_path / TOKEN).write_text("x")
    answer = work(task)
    assert answer.outcome.status == DONE
    assert answer.subject == task.subject_file.read_text()
    assert task.is_done(ClipOutcome.kept(task.folder))
    clip = replace(task, fits=False, subject=answer.subject)
    assert "height" not in clip.options
    assert "height" in task.options
    outcome = work(replace(clip, row=km_rows(rows, clips)[1])).outcome
    assert km.open_run(tmp_path / outcome.runs[0].run).header.subject_source == str(task.subject_file)


def km_rows(rows: Sequence[dict[str, Any]], folder: Path) -> tuple[BatchRow, ...]:
    from kinemode.batches.manifest import rows_of

    return rows_of(rows, folder=folder)


def outcomes_of(rows: Sequence[BatchRow], root: Path, job: Callable[[BatchTask], TaskAnswer]) -> dict[str, ClipOutcome]:
    outcomes: dict[str, ClipOutcome] = {}
    with opened_root(root) as token:
        Leader(
            BatchPlan(rows, root), Inline(), token, lambda outcome: outcomes.update({outcome.name: outcome}), job
        ).run()
    return outcomes


def done_answer(task: BatchTask) -> TaskAnswer:
    return TaskAnswer(ClipOutcome(task.row.name, DONE, options=task.digest), "<robot/>" if task.fits else "")


def test_a_clip_that_kills_its_workers_fails_and_the_others_finish(tmp_path: Path) -> None:
    tries: list[str] = []

    def job(task: BatchTask) -> TaskAnswer:
        tries.append(task.row.name)
        if task.row.name == "deadly":
            raise KeyError("signal 9")
        return done_answer(task)

    rows = [BatchRow(name, "row 2") for name in ("a", "deadly", "b")]
    outcomes = outcomes_of(rows, tmp_path, job)
    assert {name: outcome.status for name, outcome in outcomes.items()} == {"a": DONE, "deadly": FAILED, "b": DONE}
    assert tries.count("deadly") == 3
    assert tries.count("a") == 1
    assert "every process that worked on it was killed" in outcomes["deadly"].message


@pytest.mark.parametrize("fits", [True, False])
def test_clips_wait_for_their_person(tmp_path: Path, fits: bool) -> None:
    order: list[tuple[str, bool, str]] = []

    def job(task: BatchTask) -> TaskAnswer:
        order.append((task.row.name, task.fits, task.subject))
        if task.fits and not fits:
            return TaskAnswer(ClipOutcome(task.row.name, FAILED, "no person is seen"))
        return done_answer(task)

    rows = [
        BatchRow("a", "row 2", person="ann"),
        BatchRow("b", "row 3", person="ann", fits=True),
        BatchRow("c", "row 4"),
    ]
    outcomes = outcomes_of(rows, tmp_path, job)
    assert set(outcomes) == {"a", "b", "c"}
    assert order[0] == ("b", True, "")
    if fits:
        assert {("a", False, "<robot/>"), ("b", False, "<robot/>"), ("c", False, "")} == set(order[1:])
    else:
        assert [name for name, *_ in order[1:]] == ["c"]
        assert "fit from b failed: no person is seen" in outcomes["a"].message


def test_a_worker_that_does_not_see_the_folder_sends_its_files(clips: Path, tmp_path: Path) -> None:
    root, seen = tmp_path / "out", tmp_path / "elsewhere"

    def job(task: BatchTask) -> TaskAnswer:
        return work(replace(task, root=seen))  # no token is there

    (row,) = km_rows([{"keypoints": "broken.json", "cameras": "cameras.json"}], clips)
    outcome = outcomes_of([row], root, job)["broken"]
    assert outcome.status == FAILED
    assert "broken.json" in outcome.message
    assert ClipOutcome.kept(root / "clips" / "broken") == outcome
    assert not seen.exists()


def test_files_of_others_are_left_alone(clips: Path, tmp_path: Path) -> None:
    own = tmp_path / "clips" / "broken" / "broken.run"
    own.parent.mkdir(parents=True)
    own.write_text("mine")
    (row,) = km_rows([{"keypoints": "broken.json", "cameras": "cameras.json"}], clips)
    outcome = outcomes_of([row], tmp_path, work)["broken"]
    assert "has files that no batch has made" in outcome.message
    assert [path.name for path in own.parent.iterdir()] == ["broken.run"]
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "index.html").write_text("mine")
    with pytest.raises(InputError, match=r"index\.html.* exists already"), opened_root(tmp_path / "site"):
        pass


def test_two_batches_do_not_share_a_folder(tmp_path: Path) -> None:
    with opened_root(tmp_path), pytest.raises(InputError, match="another batch"), opened_root(tmp_path):
        pass


def test_inputs_are_known_by_their_content(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    for name in ("a=b.mp4", "pictures/1.png", "pictures/2.png"):
        (tmp_path / name).write_text(name)
    files = input_files([f"cam={tmp_path}/a=b.mp4", "auto"], {"masks": f"{tmp_path}/pictures"}, 3, None)
    assert [path.name for path in files] == ["a=b.mp4", "1.png", "2.png"]
    stamps = stamped(files)
    assert unchanged(files, stamps)
    os.utime(files[0], (1, 1))
    assert unchanged(files, stamps)
    files[0].write_text("a=c.mp4")
    assert not unchanged(files, stamps)
    assert not unchanged(files[1:], stamps)


def test_an_outcome_is_kept_whole(tmp_path: Path) -> None:
    run = BatchEntry("a", run="clips/a/a.run", exports={"csv": "clips/a/a.csv"}, frames=4, doubtful=0.25, error=0.03)
    whole = ClipOutcome("a", DONE, runs=(run,), options="x", inputs=stamped([Path(__file__)]), notes=("a note",))
    whole.written(tmp_path)
    assert ClipOutcome.kept(tmp_path) == whole
    (tmp_path / "outcome.json").write_text(json.dumps({"name": "a"}))
    assert ClipOutcome.kept(tmp_path) is None


@contextmanager
def dask_engine() -> Iterator[Engine]:
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        DaskEngine(cluster.scheduler_address) as engine,
    ):
        yield engine


@pytest.mark.parametrize("kind", ["processes", "dask"])
def test_an_engine_survives_what_kills_its_workers(kind: str) -> None:
    with ProcessEngine(1) if kind == "processes" else dask_engine() as engine:
        assert engine.workers() == 1
        assert [engine.submit(square, n).result(60.0) for n in (2, 3)] == [4, 9]
        with pytest.raises(engine.died):
            engine.submit(square, -1).result(60.0)
        assert engine.submit(square, 4).result(60.0) == 16


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"name": "slurm"}, "one of processes, dask"),
        ({"name": "dask"}, "is needed"),
        ({"name": "dask", "scheduler": "tcp://127.0.0.1:1"}, "cannot be reached"),
        ({"name": "dask", "scheduler": "nonsense://x", "workers": 2}, "are the scheduler's"),
        ({"scheduler": "tcp://127.0.0.1:1"}, "--engine dask"),
        ({"workers": 0}, "1 to"),
    ],
)
def test_unknown_engines(how: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinemode.batches.engines._PATIENCE", 0.5)
    with pytest.raises(InputError, match=message):
        engine_of(**{"name": "processes", "workers": None, "scheduler": None, **how})


def test_workers_of_other_versions_are_refused() -> None:
    own = versions()
    check_versions(own, own, "a")
    with pytest.raises(InputError, match=r"worker a: has numpy 1\.0, and the leader has"):
        check_versions(own, {**own, "numpy": "1.0"}, "a")


def test_the_command_reports_failures_and_errors(clips: Path, tmp_path: Path, capsys: Any) -> None:
    assert front.main(["batch", "--make", str(clips), "--out", str(tmp_path / "made.csv")]) == 2  # no video
    assert "no clip is in it" in capsys.readouterr().err
    (tmp_path / "bad.csv").write_text("name,clips\na,missing.mp4\n")
    assert front.main(["batch", str(tmp_path / "bad.csv"), "--out", str(tmp_path / "out")]) == 2
    assert "row 2" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert front.main(["batch", "--out", str(tmp_path / "out")]) == 2
    assert "--make FOLDER" in capsys.readouterr().err
