"""Runs killed without warning and resumed, against a run that nothing disturbed: every array equal to the last bit."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from cyclopts import Parameter

from benchmarks.common import ROOT, beam_folder, save, start
from estimator.formats.run_file import Run
from humanoid.errors import InputError
from kinemode import api, demo, report
from kinemode.progress import unreported

PATIENCE = 300.0  # s for a frame; then something is wrong


@dataclass(frozen=True)
class Kill:
    """One kill -9.

    wanted: frames after which it was due, -1 for the start-up before the first. delay [s]: waited beyond that.
    before, after: frames that could be read just before, and after it. resumed_from: frames the killed process began
    with. too_late: it had ended by itself. lost: frames that were readable before and are not after it.
    """

    wanted: int
    delay: float
    resumed_from: int
    before: int
    after: int
    too_late: bool = False

    @property
    def lost(self) -> int:
        return max(0, self.before - self.after)


def command(inputs: Sequence[str | Path], out: Path) -> list[str]:
    """The command line that starts and resumes."""
    return [sys.executable, "-m", "kinemode", "track", *map(str, inputs), "--out", str(out), "--resume"]


def frames_in(path: Path) -> int:
    """Frames that another process can read from a run that is being written; 0 where there is no file yet."""
    return Run.open(path).frame_count if path.exists() else 0


def kill_at(arguments: Sequence[str], out: Path, wanted: int, delay: float) -> Kill:
    """Start or resume, wait for a number of frames and a moment longer, kill -9.

    Raises InputError where the process fails by itself, or does not get there in time.
    """
    first = frames_in(out)
    process = subprocess.Popen(
        arguments, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=_environment()
    )
    try:
        deadline = time.monotonic() + PATIENCE
        while frames_in(out) < wanted and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.004)
        time.sleep(delay)
        before = frames_in(out)
        ended = process.poll()
        if frames_in(out) < wanted and ended is None:
            raise InputError("track", f"did not come to {wanted} frames in {PATIENCE:.0f} s")
    finally:
        process.kill()
        _, said = process.communicate()
    if ended:
        raise InputError("track", f"ended with code {ended}: {said.decode().strip()}")
    return Kill(wanted, delay, first, before, frames_in(out), ended == 0)


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}


def finish(arguments: Sequence[str]) -> None:
    """Run to the end; raises InputError with what it said where it fails."""
    done = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, env=_environment(), check=False)
    if done.returncode:
        raise InputError("track", f"ended with code {done.returncode}: {done.stderr.strip()}")


class Pace(NamedTuple):
    """Seconds of an undisturbed run: until the first frame, from frame to frame, and from the last to the end."""

    startup: float
    period: float
    after: float


def moments(rng: np.random.Generator, count: int, frames: int, pace: Pace) -> list[tuple[int, float]]:
    """When to kill, in order, as frames and seconds beyond: some during start-up, most after random frames and a
    random while, the last one while all frames are there and the trajectory is being smoothed."""
    starts = max(1, count // 5) if count > 2 else 0
    during = [(-1, float(rng.uniform(0.0, pace.startup))) for _ in range(starts)]
    last = max(1, frames - max(2, frames // 10))
    after = sorted(int(f) for f in rng.integers(1, last + 1, max(0, count - starts - 1)))
    between = [(f, float(rng.uniform(0.0, 1.5 * pace.period))) for f in after]
    return [*during, *between, (frames, float(rng.uniform(0.0, 0.5 * pace.after)))]


def differences(run: Run, other: Run) -> list[str]:
    """Arrays and facts in which two runs are not equal to the last bit."""
    names = [n for n in dir(Run) if isinstance(getattr(Run, n), cached_property) and not n.startswith("_")]
    names = [n for n in names if n not in ("subject", "body")] + ["pixels", "confidence"]
    found = [n for n in names if not _same(getattr(run, n), getattr(other, n))]
    facts: dict[str, Callable[[Run], object]] = {
        "frame_count": lambda r: r.frame_count,
        "complete": lambda r: r.complete,
        "subject_urdf": lambda r: r.header.subject_urdf,
    }
    return found + [name for name, fact in facts.items() if fact(run) != fact(other)]


def first_difference(run: Run, other: Run) -> str:
    """Where the modes of two runs part, and by how much."""
    count = min(len(run), len(other))
    for t in range(count):
        a, b = run.mode_q[t], other.mode_q[t]
        if not _same(a, b):
            by = float(np.nanmax(np.abs(a - b), initial=0.0)) if a.shape == b.shape else float("nan")
            return f"from frame {t} on, where q differs by {by:.1e}"
    return "not in q"


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def main(
    *,
    data: Path | None = None,
    camera: str | None = None,
    kills: int = 10,
    seed: int = 0,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Kill a tracking process at random moments, resume it each time, and compare the end with an undisturbed run.

    The clip is the built-in one, unless a camera of beam4cam is named.

    Parameters
    ----------
    data
        Folder with beam4cam in it; KINEMODE_DATA, or ../shared/data next to the checkout, by default.
    camera
        A camera of beam4cam.
    kills
        How many.
    seed
        Of the moments.
    json
        Also write the figures here.
    """
    with tempfile.TemporaryDirectory() as folder:
        if camera is None:
            clip = demo.make_clip(folder, videos=False, progress=unreported)
            keypoints, cameras = clip.keypoints[demo.CAMERA], clip.cameras
        else:
            beam = beam_folder(data)
            keypoints, cameras = beam / "keypoints" / f"{camera}.json", beam / "calibration.json"
        inputs = ("--keypoints", keypoints, "--cameras", cameras)
        undisturbed, killed = Path(folder) / "undisturbed.run", Path(folder) / "killed.run"
        pace = undisturbed_pace(command(inputs, undisturbed), undisturbed)
        whole = api.open_run(undisturbed)
        done = []
        for wanted, delay in moments(np.random.default_rng(seed), kills, len(whole), pace):
            done.append(kill_at(command(inputs, killed), killed, wanted, delay))
        finish(command(inputs, killed))
        again = api.open_run(killed)
        different = differences(whole, again)
        where = first_difference(whole, again) if different else ""
    show(done, len(whole), different, where)
    rows = [{**asdict(k), "lost": k.lost} for k in done]
    save(json, {"measure": "resume", "frames": len(whole), "kills": rows, "different": different, "where": where})


def undisturbed_pace(arguments: list[str], out: Path) -> Pace:
    """Run to the end, watching when its frames come; raises InputError with what it said where it fails."""
    marks: dict[int, float] = {}
    begin = time.monotonic()
    process = subprocess.Popen(
        arguments, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=_environment()
    )
    while process.poll() is None:
        marks.setdefault(frames_in(out), time.monotonic())
        time.sleep(0.004)
    end = time.monotonic()
    _, said = process.communicate()
    if process.returncode:
        raise InputError("track", f"ended with code {process.returncode}: {said.decode().strip()}")
    seen = sorted(n for n in marks if n > 0)
    first, last = marks[seen[0]], marks[seen[-1]]
    return Pace(first - begin, (last - first) / max(1, seen[-1] - seen[0]), end - last)


def show(kills: list[Kill], frames: int, different: list[str], where: str) -> None:
    made = report.table(
        f"kill -9, {frames} frames", "kill", "due after", "then [ms]", "began with", "before", "kept", "lost"
    )
    for i, k in enumerate(kills, 1):
        due = "start-up" if k.wanted < 0 else f"frame {k.wanted}"
        due += ", too late" if k.too_late else ""
        made.add_row(str(i), due, f"{1e3 * k.delay:.0f}", str(k.resumed_from), str(k.before), str(k.after), str(k.lost))
    out = report.console()
    out.print(made)
    out.print(f"frames lost: {sum(k.lost for k in kills)}")
    end = "equal to the last bit in every array" if not different else f"DIFFERENT {where}: {', '.join(different)}"
    out.print(f"resumed to the end, against an undisturbed run: {end}")


if __name__ == "__main__":
    start(main)
