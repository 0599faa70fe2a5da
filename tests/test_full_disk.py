"""A full disk: one line that names the file, nothing half written, nothing lost."""

from __future__ import annotations

import itertools
import json
import resource
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from estimator.data.formats.keypoints import load_keypoints, write_keypoints
from estimator.data.media.picture import WRITTEN, write_picture
from estimator.runs.run_file import RunWriter
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode import __main__ as front
from kinemode.batches.leader import PAGE, TABLE
from kinemode.batches.manifest import BatchRow
from kinemode.batches.outcome import ClipOutcome
from kinemode.batches.shown import ShownBatch
from kinemode.public.batches import Batch
from kinemode.shot import RenderedClip
from tests.conftest import ROOT
from tests.test_run_file import header, state_of, walk
from tests.tiny_clip import QUICK
from tests.waiting import DEADLINE
from viz.report.thumbnail import FAILED

FULL = "cannot be written: File too large (make room, or name a file on another disk)"


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Writing beyond `size` bytes fails, here and in processes started meanwhile, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope="module")
def made(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keypoints, cameras and a run of two frames."""
    folder: Path = tmp_path_factory.mktemp("made")
    (keypoints,) = clip.keypoints.values()
    shutil.copy(keypoints, folder / "keypoints.json")
    shutil.copy(clip.cameras, folder / "cameras.json")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        km.track(
            "human34", None, cameras=clip.cameras, keypoints=folder / "keypoints.json", out=folder / "a.run",
            settings=QUICK, fit="off", end=0.3,
        )  # fmt: skip
    return folder


COMMANDS = {
    "overlay, H.264": ("overlay {made}/a.run --out {out}/a.mp4", "a.mp4"),
    "overlay, VP9": ("overlay {made}/a.run --out {out}/a.webm", "a.webm"),
    "overlay, GIF": ("overlay {made}/a.run --out {out}/a.gif", "a.gif"),
    "view": ("view {made}/a.run --html {out}/a.html", "a.html"),
    "npz": ("export {made}/a.run {out}/a.npz", "a.npz"),
    "csv": ("export {made}/a.run {out}/a.csv", "a.csv"),
    "trc": ("export {made}/a.run {out}/a.trc", "a.trc"),
    "mot": ("export {made}/a.run {out}/a.mot", "a.mot"),
    "osim": ("export {made}/a.run {out}/a.osim", "a.osim"),
    "explain": ("explain {made}/a.run --frame 1 --out {out}", "reach_keypoints.png"),
    "settings": ("settings --out {out}/a.toml", "a.toml"),
    "render": ("render --motion arm --seconds 0.1 --out {out}", "truth.npz"),
    "track": ("track --keypoints {made}/keypoints.json --cameras {made}/cameras.json --overwrite --out {out}/a", "a"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_on_a_full_disk(made: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    text, name = COMMANDS[command]
    if command == "explain":
        name = f"{Run.open(made / 'a.run').header.cameras[0].name}_keypoints.png"
    out = tmp_path / "out"
    out.mkdir()
    expected = {} if command == "settings" else {name: "before"}  # settings never replace a file
    for old, content in expected.items():
        (out / old).write_text(content)
    arguments = [word.format(made=made, out=out) for word in text.split()]
    with files_of_at_most(1000):
        assert front.main(arguments) == front.BAD_INPUT
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith(("error", "internal", "Trace"))]
    assert len(lines) == 1
    assert lines[0].startswith(f"error: {out / name}: cannot be written: ")
    assert FULL in lines[0] or "the disk takes no more" in lines[0]
    left = {p.name: p.read_text() for p in out.iterdir() if p.is_file()}
    if command == "render":  # has written cameras.json, all of it
        assert json.loads(left.pop("cameras.json"))
    assert left == expected


WRITERS: dict[str, Callable[[Path], object]] = {
    "urdf": lambda path: load_subject("arm8").write(path),
    "png": lambda path: write_picture(path, np.random.default_rng(0).integers(0, 255, (90, 90, 3), np.uint8)),
    "json": lambda path: write_keypoints(path, load_keypoints(path.parent.parent / "keypoints.json")),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_on_a_full_disk(made: Path, tmp_path: Path, kind: str) -> None:
    shutil.copy(made / "keypoints.json", tmp_path)
    path = tmp_path / "out" / f"a.{kind}"
    path.parent.mkdir()
    with files_of_at_most(1000), pytest.raises(InputError) as error:
        WRITERS[kind](path)
    assert str(error.value) == f"{path}: {FULL}"
    assert not list(path.parent.iterdir())
    WRITERS[kind](path)
    assert path.stat().st_size > 1000


def test_a_run_keeps_what_was_tracked_and_resumes(tmp_path: Path) -> None:
    body = Body(load_subject("human34"))
    results, path = walk(body, 40), tmp_path / "a.run"
    with RunWriter.create(path, header(40)) as writer:
        writer.put_observations([])
        room = itertools.takewhile(lambda _: path.with_name("a.run-wal").stat().st_size < 500_000, results)
        for stored in room:
            writer.append(stored, state_of(stored))
        stored = results[len(Run.open(path))]
        with (
            files_of_at_most(path.with_name("a.run-wal").stat().st_size),
            pytest.raises(InputError, match=r"what was tracked is kept \(make room, --resume then continues it\)"),
        ):
            writer.append(stored, state_of(stored))
    kept = len(Run.open(path))
    assert 2 < kept < 40
    writer, state, position = RunWriter.resume(path, header(40))
    assert position == kept
    assert state is not None
    np.testing.assert_array_equal(state["q"], results[kept - 1].q)
    with writer:
        for stored in results[kept:]:
            writer.append(stored, state_of(stored))
        writer.finish()
    run = Run.open(path)
    assert len(run) == 40
    for t, stored in enumerate(results):
        np.testing.assert_array_equal(run.result(t).q, stored.q)
    assert [p.name for p in tmp_path.iterdir()] == ["a.run"]


@pytest.mark.parametrize("lost", [("table",), ("page",), ("table", "page")])
def test_a_batch_names_no_file_that_was_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], lost: tuple[str, ...]
) -> None:
    """Table and page are written separately, and the command names those that exist."""
    for what in lost:
        monkeypatch.setattr(f"kinemode.batches.shown.write_batch_{what}", no_room)
    row, failed = BatchRow("clip", "row 1"), ClipOutcome("clip", FAILED, "no room")
    shown = ShownBatch([row], tmp_path, "")
    shown.put(failed)
    names = {"table": TABLE, "page": PAGE}
    assert set(shown.write()) == {names[what] for what in lost}
    assert {path.name for path in tmp_path.iterdir()} == {names[what] for what in names if what not in lost}
    table, page = (None if what in lost else tmp_path / name for what, name in names.items())
    monkeypatch.setattr(km, "batch", lambda *_, **__: Batch(tmp_path, {"clip": failed}, table, page))
    assert front.main(["batch", "clips.csv", "--out", str(tmp_path)]) == front.BAD_INPUT
    printed = "".join(capsys.readouterr())
    assert "0 of 1 clips tracked" in printed
    assert (str(tmp_path / PAGE) in printed) == ("page" not in lost)
    assert (str(tmp_path / TABLE) in printed) == ("table" not in lost)


def no_room(path: Path, *_: object) -> None:
    raise InputError(path, "cannot be written: No space left on device")


ON_A_SMALL_DISK = """
import sys
from pathlib import Path
import numpy as np
from estimator.data.media.film import write_film
from estimator.data.media.picture import write_picture
from estimator.runs.run_store import create_store
from humanoid.support.files import replacing
from humanoid.support.errors import InputError

def text(path):
    with replacing(path) as temporary:
        temporary.write_text("x" * 300000)

def run(path):
    with replacing(path) as temporary:
        create_store(temporary, "x" * 300000, path)

disk, rng = Path(sys.argv[1]), np.random.default_rng(0)
noise = rng.integers(0, 255, (40, 240, 320, 3), np.uint8)
for name, write in {
    "a.mp4": lambda path: write_film(path, noise, 30.0),
    "a.gif": lambda path: write_film(path, noise, 30.0),
    "a.png": lambda path: write_picture(path, noise[0].repeat(3, axis=0)),
    "a.txt": text,
    "a.run": run,
}.items():
    (disk / name).write_text("before")
    try:
        write(disk / name)
    except InputError as error:
        print(error)
    assert (disk / name).read_text() == "before"
    assert [p.name for p in disk.iterdir()] == [name], list(disk.iterdir())
    (disk / name).unlink()
"""


def test_a_small_disk(tmp_path: Path) -> None:
    script = f'mount -t tmpfs -o size=256k none "{tmp_path}" && exec "$0" -c "$1" "{tmp_path}"'
    command = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script, sys.executable, ON_A_SMALL_DISK]
    if (
        not shutil.which("unshare")
        or subprocess.run([*command[:4], "true"], check=False, capture_output=True).returncode
    ):
        pytest.skip("needs Linux and user namespaces to mount a small disk")
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=DEADLINE, cwd=ROOT)
    assert done.stderr == ""
    remedy = "(make room, or name a file on another disk)"
    files = [tmp_path / name for name in ("a.mp4", "a.gif", "a.png", "a.txt")]
    expected = [f"{path}: cannot be written: No space left on device {remedy}" for path in files]
    assert done.stdout.splitlines() == [
        *expected,
        f"{tmp_path / 'a.run'}: cannot be written: the disk is full {remedy}",
    ]


def test_standard_output_on_a_full_disk(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    with open("/dev/full", "w") as full, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", full)
        assert front.main(["version"]) == front.BAD_INPUT
    assert capsys.readouterr().err.startswith("error: standard output: cannot be written: ")


def test_invalid_output_places(tmp_path: Path) -> None:
    for path, problem in (
        (tmp_path, "is a folder"),
        (Path("/dev/null"), "is a device"),  # which a rename would replace for every program
        (tmp_path / "none" / "a", r"cannot be written: No such file or directory \(does its folder exist\?\)"),
    ):
        with pytest.raises(InputError, match=problem), replacing(path) as temporary:
            temporary.write_text("x")
    assert Path("/dev/null").is_char_device()
    long = tmp_path / ("ö" * 120 + ".txt")
    with replacing(long) as temporary:
        temporary.write_text("x")
    (tmp_path / "other").touch()
    assert long.stat().st_mode == (tmp_path / "other").stat().st_mode
    for path in (tmp_path / "a.tif", tmp_path / "a"):
        with pytest.raises(InputError, match=f"one of {', '.join(WRITTEN)}"):
            write_picture(path, np.zeros((4, 4, 3), np.uint8))
