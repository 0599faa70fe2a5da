"""Command lines: in this process, many in another one, and in one that is killed."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from benchmarks.robustness.resume_kills import Kill, Moment, kill_at
from benchmarks.support.common import ROOT
from estimator.data.formats.cameras import CAMERA_FORMATS
from estimator.data.formats.keypoints import KEYPOINT_FORMATS
from estimator.runs.export import EXPORTERS
from estimator.runs.run_reader import Run
from estimator.search.cost_terms import TERMS
from estimator.tracking.registry import TRACKERS
from estimator.vision.cues.settings import CUES
from humanoid.support import plugins
from humanoid.support.plugins import VARIABLE, Registry
from kinemode import jobs
from kinemode.__main__ import INTERRUPTED, main
from kinemode.inputs.motions import MOTION_FORMATS
from tests.waiting import DEADLINE, default_signals

_BLOCKED = """
import signal, sys
from kinemode import jobs
from kinemode.__main__ import main

run_into, wanted = jobs.run_into, int(sys.argv[1])

def progress(done, total):
    if done == wanted:
        print(done, "frames are stored", flush=True)
        while True:
            signal.pause()

jobs.run_into = lambda *arguments, **how: run_into(*arguments, **{**how, "progress": progress})
sys.exit(main(sys.argv[2:]))
"""
FAMILIES: tuple[Registry[Any], ...] = (
    TRACKERS, CUES, TERMS, EXPORTERS, KEYPOINT_FORMATS, CAMERA_FORMATS, MOTION_FORMATS,
)  # fmt: skip


class CommandResult(NamedTuple):
    """How a command line ended."""

    code: int
    out: str
    error: str


def track_line(inputs: Sequence[object], out: Path) -> list[str]:
    """The command line that starts a run and continues it."""
    return ["track", *map(str, inputs), "--out", str(out), "--resume"]


def killed_at(moment: Moment, line: Sequence[str], out: Path) -> Kill:
    """A process of a command line that tracks into `out`, and its result. It prints when it has stored `wanted` frames
    and then blocks until it is killed."""
    arguments = [sys.executable, "-c", _BLOCKED, str(moment.wanted), *line]
    with default_signals():
        return kill_at(arguments, out, moment, announced=True, patience=DEADLINE, soon=DEADLINE)


@contextlib.contextmanager
def interrupted_after(frames: int) -> Iterator[None]:
    """Within this context Ctrl-C arrives once a run has stored so many frames."""
    original = jobs.run_into

    def interrupt(done: int, total: int) -> None:
        if done == frames:
            raise KeyboardInterrupt

    def run_into(*arguments: Any, **how: Any) -> None:
        original(*arguments, **{**how, "progress": interrupt})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "run_into", run_into)
        yield


def interrupt_after(frames: int, line: Sequence[object], out: Path) -> None:
    """Track into a run and interrupt the command line, in this process, after so many frames. AssertionError where it
    ends in another way or has lost a frame."""
    with interrupted_after(frames):
        result = run_here(line)
        assert result.code == INTERRUPTED, result.error
    run = Run.open(out)
    assert frames == len(run) < run.planned_count
    assert not run.complete


def ran(code: str, *arguments: str, names: str, path: Path = ROOT) -> str:
    """What a Python program prints in a process of its own, which finds plugins in a folder; it warns of nothing."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(path)]), VARIABLE: names}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, env=environment, check=False,
        stdin=subprocess.DEVNULL, timeout=DEADLINE,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout


@contextlib.contextmanager
def plugins_here(names: str, folder: Path) -> Iterator[None]:
    """Within it this process finds plugins as a new process would."""
    with contextlib.ExitStack() as stack:
        for family in FAMILIES:
            stack.enter_context(family.restored())
        patched = stack.enter_context(pytest.MonkeyPatch.context())
        patched.setattr(plugins, "_plugins", plugins._Plugins())
        patched.setenv(VARIABLE, names)
        patched.syspath_prepend(str(folder))
        before = {name: sys.modules.pop(name, None) for name in names.split(",")}
        yield
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module


def run_with_plugins(*lines: Sequence[str], names: str, path: Path = ROOT) -> list[CommandResult]:
    """Command lines of a process that finds plugins in a folder."""
    with plugins_here(names, path):
        return [run_here(line) for line in lines]


def printed_by(line: Sequence[object]) -> str:
    """What a command line prints, in this process. AssertionError with its output unless it exits with 0."""
    ended = run_here(line)
    assert ended.code == 0, ended.error
    return ended.out


def run_here(line: Sequence[object]) -> CommandResult:
    """A command line in this process."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        code = main([*map(str, line)])
    return CommandResult(code, out.getvalue(), error.getvalue())


def output_of_readers(path: Path, frame: int) -> Mapping[str, str]:
    """The output of every command that takes a run alone, by command name or export format; files are written beside
    the run."""
    lines: dict[str, list[object]] = {
        **{kind: ["export", path, path.with_suffix(f".{kind}")] for kind in ("npz", "csv", "trc", "mot", "osim")},
        "view": ["view", path, "--html", path.with_suffix(".html")],
        "overlay": ["overlay", path, "--out", path.with_suffix(".mp4")],
        "explain": ["explain", path, "--frame", frame, "--hypothesis", 0, "--out", path.parent / "pictures"],
    }
    return {name: printed_by(line) for name, line in lines.items()}


def check_written(path: Path, frames: int) -> None:
    """AssertionError unless the files that `output_of_readers` wrote for a run of so many frames exist and are not
    empty."""
    for kind in ("csv", "trc", "mot"):
        assert len(path.with_suffix(f".{kind}").read_text().splitlines()) > frames
    assert path.with_suffix(".npz").stat().st_size > 1000
    assert path.with_suffix(".html").read_text().startswith("<!DOCTYPE html>")
    assert path.with_suffix(".mp4").stat().st_size > 1000
    assert len(list((path.parent / "pictures").iterdir())) >= 1
