"""A batch one of whose workers is killed and one of whose clips is broken, and a batch that is killed and started
again: every run that of a single call to the last bit, and nothing done twice."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.robustness.batch_clips import Mappings, short_clips, single_runs, unequal_runs, write_csv
from benchmarks.robustness.resume_kills import PATIENCE, SOON, check_ended_well, started
from benchmarks.support.common import tell
from benchmarks.support.proc import seconds_until_gone, spawned_workers
from humanoid.support.errors import InputError
from kinemode.batches.clip_job import BEGUN
from kinemode.batches.outcome import FILE
from kinemode.terminal import report

WORKERS = 2
MOST_LETTERS = 500  # of an error that is readable
_STEP = 0.01  # s between two looks


class BatchKill(NamedTuple):
    """A batch that was killed. due: so many clips finished, and seconds beyond that. finished, at_hand: clips that were
    finished then, and begun but not finished. lingered [s]: longer than the batch its workers were there."""

    due: tuple[int, float]
    finished: int
    at_hand: int
    lingered: float


@dataclass(frozen=True)
class KilledWorker:
    """The outcome of a batch with one worker killed and one clip broken. finished: clips when it was killed. code: exit
    code of the batch. error: message about the broken clip. faults: everything wrong."""

    finished: int
    code: int
    seconds: float
    error: str
    faults: tuple[str, ...]


def batch_command(manifest: Path, out: Path, workers: int = WORKERS) -> list[str]:
    """The command line that starts a batch and starts it again."""
    words = ["batch", str(manifest), "--out", str(out), "--workers", str(workers)]
    return [sys.executable, "-m", "kinemode", *words]


def finished_clips(out: Path) -> dict[str, tuple[int, int]]:
    """By clip, which file its outcome is and when it was written [ns]."""
    files = sorted((out / "clips").glob(f"*/{FILE}"))
    return {file.parent.name: (state.st_ino, state.st_mtime_ns) for file in files if (state := file.stat())}


def begun_clips(out: Path) -> set[str]:
    """The clips that were started."""
    return {file.parent.name for file in (out / "clips").glob(f"*/{BEGUN}")}


def wait_until(reached: Callable[[], bool], process: subprocess.Popen[bytes]) -> bool:
    """Whether something was reached before a process ended. Raises InputError where neither comes."""
    deadline = time.monotonic() + PATIENCE
    while not reached():
        if process.poll() is not None:
            return False
        if time.monotonic() > deadline:
            raise InputError("batch", f"no clip was finished for {PATIENCE:.0f} s")
        time.sleep(_STEP)
    return True


def killed_worker(rows: Mappings, single: Mapping[str, Path], folder: Path) -> KilledWorker:
    """A batch whose last clip is broken once the manifest was read, and one of whose workers is killed when half of the
    clips are finished."""
    manifest, out = write_csv(folder / "broken.csv", rows), folder / "broken"
    broken, keypoints = rows[-1]["name"], Path(rows[-1]["keypoints"])
    whole = keypoints.read_bytes()
    process = started(batch_command(manifest, out))
    begin = time.monotonic()
    faults = []
    try:
        wait_until(lambda: len(finished_clips(out)) > 0, process)
        keypoints.write_bytes(whole[: len(whole) // 2])
        there = wait_until(lambda: len(finished_clips(out)) >= len(rows) // 2, process)
        workers, finished = spawned_workers(process.pid), len(finished_clips(out))
        if there and workers:
            os.kill(workers[0], signal.SIGKILL)
        else:
            faults.append("no worker was killed: the batch had ended")
        printed, said = (text.decode() for text in process.communicate(timeout=None))
    finally:
        keypoints.write_bytes(whole)
        end(process)
    faults += unequal_runs(single, out, [name for name in single if name != broken])
    error = message_of(out, broken)
    if not error or "\n" in error or len(error) > MOST_LETTERS or "internal" in error:
        faults.append(f"{broken}: no readable error: {error!r}")
    wanted = f"{len(rows) - 1} of {len(rows)} clips tracked"
    if wanted not in printed or f"{broken}: " not in printed or "Traceback" in said:
        faults.append(f"the command did not print {wanted!r} but: {printed.strip()} {said.strip()}")
    if process.returncode == 0:
        faults.append("the command's exit code reports success")
    return KilledWorker(finished, process.returncode, time.monotonic() - begin, error, tuple(faults))


def message_of(out: Path, name: str) -> str:
    """The reason why a clip failed, empty where unknown."""
    file = out / "clips" / name / FILE
    return str(json.loads(file.read_text(encoding="utf-8"))["message"]) if file.is_file() else ""


def end(process: subprocess.Popen[bytes]) -> None:
    """Kill a batch that is still there; its workers end with it."""
    if process.poll() is None:
        process.kill()
        process.communicate()


def killed_at(manifest: Path, out: Path, due: tuple[int, float]) -> tuple[BatchKill, dict[str, tuple[int, int]]] | None:
    """Start a batch or start it again, kill it when so many clips are finished, and seconds later; what was finished
    then. None where it had ended."""
    count, delay = due
    process = started(batch_command(manifest, out))
    try:
        if wait_until(lambda: len(finished_clips(out)) >= count, process):
            time.sleep(delay)
        workers = spawned_workers(process.pid)
        process.kill()
        code = process.wait()
        lingered = seconds_until_gone(workers, SOON)
        _, said = process.communicate(timeout=PATIENCE)
    finally:
        end(process)
    if code != -signal.SIGKILL:
        check_ended_well(code, said)
        return None
    finished = finished_clips(out)
    return BatchKill(due, len(finished), len(begun_clips(out) - finished.keys()), lingered), finished


def killed_batch(
    rows: Mappings, single: Mapping[str, Path], folder: Path, when: Sequence[tuple[int, float]]
) -> tuple[list[BatchKill], list[str]]:
    """A batch killed at each of the moments and started again: the kills, and all that is not as it should be."""
    manifest, out = write_csv(folder / "whole.csv", rows), folder / "killed"
    kills, faults = [], []
    outcomes: dict[str, tuple[int, int]] = {}
    for due in when:
        killed = killed_at(manifest, out, due)
        if killed is None:
            faults.append(f"kill at {due[0]} clips + {due[1]:.1f} s: the batch had ended")
            continue
        kill, now = killed
        tell(f"killed at {due[0]} clips + {due[1]:.1f} s: {kill.finished} finished, {kill.at_hand} at hand")
        faults += done_again(outcomes, now)
        if kill.lingered > SOON:
            faults.append(f"a worker was there {SOON:.0f} s after the batch")
        if kill.at_hand > WORKERS:
            faults.append(f"{kill.at_hand} clips were begun and not finished")
        kills.append(kill)
        outcomes = outcomes | now
    process = started(batch_command(manifest, out))
    _, said = process.communicate()
    check_ended_well(process.returncode, said)
    faults += done_again(outcomes, finished_clips(out)) + unequal_runs(single, out)
    faults += [f"left over: {file.name}" for file in sorted(out.rglob("*.part"))]
    return kills, faults


def done_again(before: Mapping[str, tuple[int, int]], now: Mapping[str, tuple[int, int]]) -> list[str]:
    """The clips that were finished before, and have another outcome now."""
    return [f"{name} was done again" for name, state in before.items() if now.get(name) != state]


def moments_of(rng: np.random.Generator, count: int, clips: int, pace: float) -> list[tuple[int, float]]:
    """When to kill, in order: a fifth during the start, the others after as many clips each; pace [s]: of a clip."""
    early = count // 5
    between = np.linspace(0, clips - WORKERS - 1, count - early).astype(int).tolist()
    starts = [(0, float(rng.uniform(0.0, 3.0))) for _ in range(early)]
    # before the first clip is finished there is nothing to wait for but the start
    return starts + [(n, float(rng.uniform(0.0, pace) + (4.0 if n == 0 else 0.0))) for n in between]


def measure_kills(
    folder: Path, clips: int, frames: int, kills: int, settings: Path | None, seed: int
) -> dict[str, Any]:
    """Print what became of both; the figures."""
    rows = short_clips(folder / "inputs", clips, frames, settings)
    single = single_runs(rows, folder / "single")
    broken = killed_worker(rows, single, folder)
    tell(f"one worker killed, one clip broken: {len(broken.faults)} faults")
    when = moments_of(np.random.default_rng(seed), kills, clips, broken.seconds / clips)
    done, faults = killed_batch(rows, single, folder, when)
    out = report.console()
    out.print(
        f"one of {WORKERS} workers killed when {broken.finished} of {clips} clips were finished, one clip broken:"
        f" {broken.seconds:.1f} s, exit code {broken.code}"
    )
    out.print(f"  error of the broken clip: {broken.error}")
    out.print(f"  {said_of(broken.faults, f'{clips - 1} runs equal to single calls to the last bit')}")
    made = report.table(
        f"the batch killed {len(done)} times", "due: finished", "+ s", "finished", "at hand", "gone [s]"
    )
    for kill in done:
        count, delay = kill.due
        made.add_row(str(count), f"{delay:.2f}", str(kill.finished), str(kill.at_hand), f"{kill.lingered:.2f}")
    out.print(made)
    out.print(said_of(faults, f"{clips} runs equal to single calls to the last bit, no finished clip done again"))
    return {
        "clips": clips, "frames": frames, "worker": asdict(broken),
        "batch": {"kills": [kill._asdict() for kill in done], "faults": faults},
    }  # fmt: skip


def said_of(faults: Sequence[str], well: str) -> str:
    """The faults, or a confirmation."""
    return "\n".join(faults) if faults else well
