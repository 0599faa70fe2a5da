"""Command lines, each in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.common import ROOT
from benchmarks.resume_kills import Moment, command, kill_at
from estimator.results.run_file import Run


def killed_after(frames: int, inputs: Sequence[str | Path], out: Path) -> list[str]:
    """Track into a run and kill the process, without warning, when it has so many frames; returns the command line that
    goes on. Tried again where the machine stalls until the process has ended by itself. AssertionError where it ended
    otherwise, left anything, or has not lost its end."""
    for _ in range(3):
        out.unlink(missing_ok=True)
        kill = kill_at(command(inputs, out), out, Moment(frames))
        if not kill.too_late:
            break
    assert (kill.code, kill.lost, kill.left) == (-9, 0, ()), kill.fault
    run = Run.open(out)
    assert frames <= len(run) < run.planned_count
    assert not run.complete
    return command(inputs, out)


def printed_by(lines: Mapping[str, Sequence[object]]) -> dict[str, str]:
    """What each command line prints; all at the same time, since most of theirs is importing. AssertionError with what
    they said unless each ends with 0."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    processes = {
        name: subprocess.Popen(
            [sys.executable, "-m", "kinemode", *map(str, line)], env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )
        for name, line in lines.items()
    }  # fmt: skip
    said = {name: process.communicate() for name, process in processes.items()}
    wrong = {name: said[name] for name, process in processes.items() if process.returncode}
    assert not wrong, wrong
    return {name: out for name, (out, _) in said.items()}


def readers(path: Path, frame: int) -> dict[str, list[object]]:
    """Every command that takes a run alone, by its name or by the format exported; what they write lies beside it."""
    return {
        **{kind: ["export", path, path.with_suffix(f".{kind}")] for kind in ("npz", "csv", "trc", "mot", "osim")},
        "view": ["view", path, "--html", path.with_suffix(".html")],
        "overlay": ["overlay", path, "--out", path.with_suffix(".mp4")],
        "explain": ["explain", path, "--frame", frame, "--hypothesis", 0, "--out", path.parent / "pictures"],
    }


def check_written(path: Path, frames: int) -> None:
    """AssertionError unless what `readers` write of a run of so many frames is there, and not empty."""
    for kind in ("csv", "trc", "mot"):
        assert len(path.with_suffix(f".{kind}").read_text().splitlines()) > frames
    assert path.with_suffix(".npz").stat().st_size > 1000
    assert path.with_suffix(".html").read_text().startswith("<!DOCTYPE html>")
    assert path.with_suffix(".mp4").stat().st_size > 1000
    assert len(list((path.parent / "pictures").iterdir())) >= 1
