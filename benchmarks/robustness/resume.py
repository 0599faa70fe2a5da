"""Runs ended at any moment of their life and resumed, against runs that nothing disturbed: every array equal to the
last bit, and nothing left behind."""

from __future__ import annotations

import signal
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kinemode as km
from benchmarks.robustness.resume_kills import (
    BEFORE_THE_FILE,
    SOON,
    Kill,
    Moment,
    check_ended_well,
    command,
    finish,
    frames_in,
    kill_at,
    started,
)
from benchmarks.support.common import Data, Json, beam_folder, save, tell
from estimator.runs.run_reader import Run
from kinemode import demo
from kinemode.progress import unreported
from kinemode.terminal import report

SIGNALS = (  # and whether to all
    (signal.SIGTERM, False), (signal.SIGINT, True), (signal.SIGKILL, False), (signal.SIGTERM, True),
    (signal.SIGINT, False), (signal.SIGKILL, False),
)  # fmt: skip


class Pace(NamedTuple):
    """Seconds of an undisturbed run: until there is a file, from that to the first frame, from frame to frame, and from
    the last to the end."""

    fit: float
    first: float
    period: float
    after: float


def moments(rng: np.random.Generator, count: int, frames: int, pace: Pace) -> list[Moment]:
    """When to end a run, in order: some during start-up and fit, one when the first frame is searched (and helpers
    start), most after random frames, one or two while all frames are there and the trajectory is being smoothed."""
    early, late = (max(1, count // 4), 1 + count // 8) if count > 2 else (0, 1)
    chosen = [(BEFORE_THE_FILE, float(rng.uniform(0.0, pace.fit))) for _ in range(early)]
    chosen += [(0, float(rng.uniform(0.0, pace.first)))] if count > early + late else []
    between = sorted(int(f) for f in rng.integers(1, max(2, frames - frames // 10), max(0, count - len(chosen) - late)))
    chosen += [(f, float(rng.uniform(0.0, 1.5 * pace.period))) for f in between]
    chosen += [(frames, float(rng.uniform(0.0, 0.5 * pace.after))) for _ in range(min(late, count))]
    how = rng.permutation(np.resize(np.arange(len(SIGNALS)), len(chosen)))
    return [Moment(*when, *SIGNALS[i]) for when, i in zip(chosen, how, strict=True)]


class Chain(NamedTuple):
    """One run that is ended again and again. inputs: of the command line. name: in the output."""

    name: str
    inputs: tuple[str | Path, ...]


def chains(folder: Path, frames: int, camera: str | None, data: Path | None) -> list[Chain]:
    """Keypoints alone, and with edges and flow."""
    if camera is None:
        clip = demo.make_clip(folder, frames=frames, progress=unreported)
        video, keypoints, cameras = clip.videos[demo.CAMERA], clip.keypoints[demo.CAMERA], clip.cameras
    else:
        beam = beam_folder(data)
        video, keypoints = beam / "videos" / f"{camera}.mp4", beam / "keypoints" / f"{camera}.json"
        cameras = beam / "calibration.json"
    inputs = (video, "--keypoints", keypoints, "--cameras", cameras, "--cues")
    looks = {"keypoints": "off", "edges, flow": "edges,flow"}
    return [Chain(name, (*inputs, cues)) for name, cues in looks.items()]


def ended_often(chain: Chain, out: Path, when: Sequence[Moment], whole: Run) -> tuple[list[Kill], list[str]]:
    """End a run at each of the moments, resume it to the end, and compare: the kills, and all faults."""
    done, faults = [], []
    for moment in when:
        kill = kill_at(command(chain.inputs, out), out, moment)
        tell(f"{chain.name}: {due(kill)}, {moment.number.name}, {kill.seconds:.2f} s")
        done.append(kill)
        if not kill.well:
            faults.append(f"{due(kill)}: {kill.fault}")
        if kill.after and (where := first_difference(km.open_run(out), whole)):
            faults.append(f"{due(kill)}: different {where}")
    finish(command(chain.inputs, out))
    again = km.open_run(out)
    different = differences(whole, again)
    if different:
        faults.append(f"the end is different {first_difference(whole, again)}: {', '.join(different)}")
    return done, faults


def differences(run: Run, other: Run) -> list[str]:
    """Arrays and facts in which two runs are not equal to the last bit."""
    names = [n for n in dir(Run) if isinstance(getattr(Run, n), cached_property) and not n.startswith("_")]
    names = [n for n in names if n not in ("subject", "body")] + ["pixels", "confidence"]
    different = [n for n in names if not _same(getattr(run, n), getattr(other, n))]
    facts: dict[str, Callable[[Run], object]] = {
        "frame_count": lambda r: r.frame_count,
        "complete": lambda r: r.complete,
        "subject_urdf": lambda r: r.header.subject_urdf,
    }
    return different + [name for name, fact in facts.items() if fact(run) != fact(other)]


def first_difference(run: Run, other: Run) -> str:
    """Where the modes of two runs part, and by how much; empty where they do not, over their common frames."""
    for t in range(min(len(run), len(other))):
        a, b = run.result(t).q, other.result(t).q
        if not _same(a, b):
            by = float(np.max(np.abs(a - b), initial=0.0)) if a.shape == b.shape else float("nan")
            return f"from frame {t} on, where q differs by {by:.1e}"
    return ""


def _same(a: Any, b: Any) -> bool:
    """Equal to the last bit: arrays and numbers, tuples and records of them, mappings of names to them, or nothing."""
    if a is None or b is None:
        return a is b
    if is_dataclass(a):
        return type(a) is type(b) and _same(vars(a), vars(b))
    if isinstance(a, Mapping) or isinstance(b, Mapping):
        return (
            isinstance(a, Mapping) and isinstance(b, Mapping) and set(a) == set(b) and all(_same(a[n], b[n]) for n in a)
        )
    if isinstance(a, tuple) or isinstance(b, tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(_same, a, b))
    a, b = np.asarray(a), np.asarray(b)
    return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())


def main(
    *,
    data: Data = None,
    camera: str | None = None,
    frames: int = 16,
    kills: int = 30,
    seed: int = 0,
    json: Json = None,
) -> None:
    """End tracking processes at random moments by SIGTERM, SIGINT and SIGKILL, resume them each time, and compare the
    ends with undisturbed runs; checks for processes, shared memory and open pipes that are left after 2 s.

    Four runs are ended in turn: by keypoints alone and with edges and flow, each by one process and by two. The clip is
    the built-in one, unless a camera of beam4cam is named.

    Parameters
    ----------
    camera
        A camera of beam4cam.
    frames
        Of the built-in clip.
    kills
        How many, in all.
    seed
        Of the moments.
    """
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder, rng = Path(name), np.random.default_rng(seed)
        undisturbed = folder / "undisturbed.run"
        for i, chain in enumerate(chains(folder, frames, camera, data)):
            pace = undisturbed_pace(command(chain.inputs, undisturbed), undisturbed)
            whole = km.open_run(undisturbed)
            ended = ended_often(chain, folder / f"{i}.run", moments(rng, (kills + i) // 2, len(whole), pace), whole)
            rows.append((chain, *ended))
            undisturbed.unlink()
    show(rows)
    save(json, {"measure": "resume", "chains": [figures(*row) for row in rows]})


def undisturbed_pace(arguments: list[str], out: Path) -> Pace:
    """Run to the end, recording when its frames appear; raises InputError with its output where it fails."""
    marks: dict[int, float] = {}
    begin = time.monotonic()
    process = started(arguments)
    while process.poll() is None:
        marks.setdefault(frames_in(out) if out.exists() else BEFORE_THE_FILE, time.monotonic())
        time.sleep(0.004)
    end = time.monotonic()
    _, said = process.communicate()
    check_ended_well(process.returncode, said)
    seen = sorted(n for n in marks if n > 0)
    first, last, file = marks[seen[0]], marks[seen[-1]], marks.get(0, marks[seen[0]])
    return Pace(file - begin, first - file, (last - first) / max(1, seen[-1] - seen[0]), end - last)


def due(kill: Kill) -> str:
    """When a process was to be ended, in words."""
    wanted = kill.moment.wanted
    stage = "start-up or fit" if wanted == BEFORE_THE_FILE else f"frame {wanted}" if wanted else "before frame 1"
    return f"{stage} + {kill.moment.delay:.2f} s" + (", too late" if kill.too_late else "")


def show(rows: Sequence[tuple[Chain, list[Kill], list[str]]]) -> None:
    """A row for each kill, and all faults."""
    columns = ("kill", "signal", "due", "frames before", "kept", "ended after [s]", "all gone after [s]")
    out = report.console()
    for chain, done, faults in rows:
        made = report.table(chain.name, *columns)
        for i, k in enumerate(done, 1):
            times = (f"{k.seconds:.2f}", f"{k.lingered:.2f}")
            number = k.moment.number.name + " to all" * k.moment.to_all
            made.add_row(str(i), number, due(k), str(k.before), str(k.after), *times)
        out.print(made)
        out.print("equal to the last bit in every array, nothing lost or left" if not faults else "\n".join(faults))
        out.print("")
    kills = [k for _, done, _ in rows for k in done]
    faulty = sum(bool(faults) for *_, faults in rows)
    slowest, longest = max(k.seconds for k in kills), max(k.lingered for k in kills)
    late = sum(k.too_late for k in kills)
    out.print(
        f"{len(kills)} kills, {late} of them too late; runs with a fault: {faulty} of {len(rows)};"
        f" slowest end {slowest:.2f} s, then all gone after {longest:.2f} s (limit {SOON:.0f} s)"
    )


def figures(chain: Chain, done: Sequence[Kill], faults: Sequence[str]) -> dict[str, object]:
    """The figures of one run, for JSON."""
    listed = [
        {"due": due(k), "signal": k.moment.number.name, "to all": k.moment.to_all, "lost": k.lost}
        | {name: getattr(k, name) for name in ("before", "after", "code", "seconds", "lingered", "left")}
        for k in done
    ]
    return {"name": chain.name, "kills": listed, "faults": list(faults)}
