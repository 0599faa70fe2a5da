"""A tracking process ended at some point of its life, and what it leaves behind."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import NamedTuple

from benchmarks.support.common import ROOT
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError

PATIENCE = 300.0  # s for a frame, or for an end; then something is wrong
SOON = 2.0  # s after its leader until a helper, and what is shared with it, has to be gone
BEFORE_THE_FILE = -1


class Moment(NamedTuple):
    """When a process is ended: frames in its run, `BEFORE_THE_FILE` for the start-up and the fit, and seconds beyond
    that; by which signal; whether its helpers are sent it too, as a terminal and a batch system do."""

    wanted: int
    delay: float = 0.0
    number: signal.Signals = signal.SIGKILL
    to_all: bool = False


@dataclass(frozen=True)
class Kill:
    """The outcome of a kill.

    resumed_from: frames the process began with. before, after: frames that could be read just before, and after it.
    code: exit code, 0 where it had ended by itself. seconds: until it had ended. lingered [s]: longer than it anything
    that it had started or that held its caller's pipes was there. left: processes, and names of shared memory, that
    were there for longer than allowed. message: its last line on standard error.
    """

    moment: Moment
    resumed_from: int
    before: int
    after: int
    code: int
    seconds: float
    lingered: float
    left: tuple[str, ...]
    message: str

    @property
    def too_late(self) -> bool:
        """Whether it had ended by itself."""
        return self.code == 0

    @property
    def lost(self) -> int:
        """Frames that were readable before and are not after it."""
        return max(0, self.before - self.after)

    @property
    def well(self) -> bool:
        """Whether it ended as it should: by the signal, or with the code that shells have for it."""
        return self.code in (0, -self.moment.number, 128 + self.moment.number) and not self.left and not self.lost

    @property
    def fault(self) -> str:
        """The fault where it did not end well."""
        left = ", ".join(self.left) or "nothing"
        return f"code {self.code}, {self.lost} frames lost, left: {left}; last message: {self.message}"


def command(inputs: Sequence[str | Path], out: Path) -> list[str]:
    """The command line that starts and resumes."""
    return [sys.executable, "-m", "kinemode", "track", *map(str, inputs), "--out", str(out), "--resume"]


def frames_in(path: Path) -> int:
    """Frames that another process can read from a run that is being written; 0 where there is no file yet."""
    return Run.open(path).frame_count if path.exists() else 0


def started(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    """A process with a group of its own, so that all it starts can be identified."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    return subprocess.Popen(
        arguments, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment, start_new_session=True
    )


def finish(arguments: Sequence[str]) -> None:
    """Run to the end; raises InputError with its output where it fails."""
    process = started(arguments)
    _, output = process.communicate()
    check_ended_well(process.returncode, output)


def check_ended_well(code: int, output: bytes) -> None:
    """Raises InputError with a process' output where its exit code is a failure."""
    if code:
        raise InputError("track", f"ended with code {code}: {output.decode().strip()}")


def kill_at(
    arguments: Sequence[str],
    out: Path,
    moment: Moment,
    *,
    announced: bool = False,
    patience: float = PATIENCE,
    soon: float = SOON,
) -> Kill:
    """Start or resume, wait for a moment and end it.

    announced: the process itself announces the frames in a line. patience [s]: for a frame, or for an end.
    soon [s]: after its leader until a helper, and what is shared with it, has to be gone.
    Raises InputError where the process fails by itself, or does not get there in time.
    """
    first = frames_in(out)
    process = started(arguments)
    try:
        ended = (_wait_for_announcement if announced else _wait_for_frames)(process, out, moment, patience)
        before, names = frames_in(out), _shared_memory(process.pid)
        if ended is None:
            (os.killpg if moment.to_all else os.kill)(process.pid, moment.number)
        sent = time.monotonic()
        code = process.wait(patience)
        seconds, ended_at = time.monotonic() - sent, time.monotonic()
        output = _read_to_the_end(process, soon)
        lingered, left = _what_is_left(process.pid, names, ended_at, soon)
    finally:
        if _alive(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
    if ended is not None:
        check_ended_well(code, output)
    last = (output.decode(errors="replace").strip().splitlines() or [""])[-1]
    return Kill(moment, first, before, frames_in(out), code, seconds, lingered, left, last)


def _wait_for_frames(process: subprocess.Popen[bytes], out: Path, moment: Moment, patience: float) -> int | None:
    """Wait for a moment in the life of a process; its exit code if that comes first."""

    def there() -> bool:
        return moment.wanted == BEFORE_THE_FILE or (out.exists() and frames_in(out) >= moment.wanted)

    deadline = time.monotonic() + patience
    while not there() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.004)
    if not there() and process.poll() is None:
        raise InputError("track", f"did not come to {moment.wanted} frames in {patience:.0f} s")
    time.sleep(moment.delay)
    return process.poll()


def _wait_for_announcement(process: subprocess.Popen[bytes], out: Path, moment: Moment, patience: float) -> int | None:
    """Wait until a process announces the moment; its exit code if it ends instead."""
    assert process.stdout is not None
    if not wait([process.stdout.fileno()], patience):
        raise InputError("track", f"did not come to {moment.wanted} frames in {patience:.0f} s")
    return None if process.stdout.readline() else process.wait(patience)


def _read_to_the_end(process: subprocess.Popen[bytes], soon: float) -> bytes:
    """Its last output; a process that keeps its pipes open is given some time."""
    try:
        return process.communicate(timeout=soon)[1]
    except subprocess.TimeoutExpired as late:
        return late.stderr or b""


def _what_is_left(group: int, names: set[str], ended_at: float, soon: float) -> tuple[float, tuple[str, ...]]:
    """How long something remained after the leader's end [s], and what remains for longer than allowed."""
    while True:
        left = [f"process {pid}" for pid in _alive(group)]
        left += [name for name in names if Path(name).exists()]
        lingered = time.monotonic() - ended_at
        if not left or lingered > soon:
            return lingered, tuple(left)
        time.sleep(0.01)


def _alive(group: int) -> list[int]:
    """The processes of a group, but not those that only wait for their exit code to be read."""
    listed = subprocess.run(["ps", "-A", "-o", "pid=,pgid=,stat="], capture_output=True, text=True, check=True).stdout
    rows = (line.split() for line in listed.splitlines())
    return [int(pid) for pid, of, state, *_ in rows if int(of) == group and not state.startswith("Z")]


def _shared_memory(group: int) -> set[str]:
    """Files in /dev/shm that the processes of a group use, where the system reports them."""
    names: set[str] = set()
    for pid in _alive(group):
        try:
            names.update(re.findall(r"/dev/shm/\S+", Path(f"/proc/{pid}/maps").read_text()))
        except OSError:
            continue
    return {name for name in names if Path(name).exists()}
