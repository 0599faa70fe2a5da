"""First frames, and first frames after full occlusions: whether the person is found (again), by ELMO and its rivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.papers_elmo.elmo import GIVEN, PAPER, errors
from benchmarks.papers_elmo.elmo_clips import FPS, SEQUENCES, Filmed, filmed
from benchmarks.support.common import (
    Data,
    Json,
    Several,
    Work,
    captured_folder,
    check_known,
    in_processes,
    save,
    tell,
    work_folder,
)
from benchmarks.support.result_store import removed
from benchmarks.support.tracking import timed_track
from kinemode.terminal import report

NEIGHBOURS = "css+index"
TRACKERS = ("elmo", "icp", "condensation", "css", NEIGHBOURS)
SHORTEST, LONGEST = 0.3, 3.0  # s
FOUND = 60.0  # mm
WITHIN = 3  # frames
_SETTINGS: dict[str, Any] = PAPER | {NEIGHBOURS: PAPER["css"]}


@dataclass(frozen=True)
class Task:
    """A tracker on a sequence in which the person is hidden now and then."""

    film: Filmed
    tracker: str
    index: Path
    seed: int
    cues: str


@dataclass(frozen=True)
class Result:
    """first: error of the first frame [mm]. before, after: of each occlusion, the error of the last frame before, and
    those of the first `WITHIN` frames after. seconds: how long each was. error (T): of all frames [mm], NaN without a
    hypothesis."""

    sequence: str
    tracker: str
    first: float
    before: list[float]
    after: list[list[float]]
    seconds: list[float]
    error: list[float]


def spans(count: int, sequences: int, between: float) -> list[tuple[tuple[float, float], ...]]:
    """For each of some sequences from when until when [s], in whole frames, the person is hidden: `count` occlusions in
    all, from the shortest to the longest in equal ratios, dealt out in turns, with so much [s] before and between."""
    lengths = np.geomspace(SHORTEST, LONGEST, count) if count > 1 else np.array([LONGEST])
    dealt = []
    for s in range(sequences):
        frame, own = 0, []
        for length in lengths[s::sequences]:
            begin = frame + round(between * FPS)
            frame = begin + round(float(length) * FPS)
            own.append((begin / FPS, frame / FPS))
        dealt.append(tuple(own))
    return dealt


def tracked(task: Task) -> Result:
    """Render and track."""
    clip = filmed(task.film)
    out = task.film.clip_folder / f"{task.tracker}.run"
    name, neighbours = task.tracker.removesuffix("+index"), task.tracker == NEIGHBOURS
    given = clip.first_frame if name in GIVEN else None
    run, _ = timed_track(
        given, clip.cameras, out, clips=clip.videos, cues=task.cues, subject=clip.subject, fit="off", tracker=name,
        seed=task.seed, settings=_SETTINGS.get(task.tracker, {}), stereo={"cam01": "cam01_right"},
        index=task.index if neighbours or name not in GIVEN else None,
    )  # fmt: skip
    error = errors(run.mode_landmarks[:, 0], run, clip)
    removed(out)
    ends = [(round(begin * FPS), round(end * FPS)) for begin, end in task.film.hidden]
    after = [error[end : end + WITHIN].tolist() for _, end in ends]
    result = Result(
        task.film.name, task.tracker, float(error[0]), [float(error[begin - 1]) for begin, _ in ends], after,
        [(end - begin) / FPS for begin, end in ends], error.tolist(),
    )  # fmt: skip
    summary = ", ".join(
        f"{seconds:.1f} s: {frames[0]:.0f}" for seconds, frames in zip(result.seconds, after, strict=True)
    )
    tell(f"{task.film.name}, {task.tracker}: begins with {error[0]:.0f} mm; after {summary}")
    return result


def main(
    *,
    index: Path,
    data: Data = None,
    sequences: Annotated[tuple[str, ...], Several] = tuple(SEQUENCES),
    trackers: Annotated[tuple[str, ...], Several] = TRACKERS,
    occlusions: int = 30,
    between: float = 1.5,
    baseline: float = 0.12,
    cues: str = "depth",
    seed: int = 0,
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track stereo sequences in which a screen hides the person now and then.

    ELMO is given nothing, the others the first pose.

    Parameters
    ----------
    index
        Index of examples (`kinemode train-index`).
    sequences
        Which.
    trackers
        Which; css+index is css with an index.
    occlusions
        How many in all, of 0.3 to 3 s.
    between
        Seconds in which the person is seen, before the first, between and after.
    baseline
        Metres between the cameras.
    cues
        Image cues to use, as depth,silhouette.
    seed
        Seed of the tracker.
    jobs
        Runs at a time, each in a process of its own.
    """
    folder = captured_folder(data)
    if folder is None:
        return
    check_known("--sequences", sequences, SEQUENCES)
    check_known("--trackers", trackers, TRACKERS)
    with work_folder(work) as kept:
        films = []
        for name, hidden in zip(sequences, spans(occlusions, len(sequences), between), strict=True):
            frames = round(((hidden[-1][1] if hidden else 0.0) + between) * FPS)
            films.append(Filmed(name, frames, folder, kept, baseline=baseline, hidden=hidden))
        in_processes(filmed, films, jobs)
        results = in_processes(tracked, [Task(film, t, index, seed, cues) for film in films for t in trackers], jobs)
    show(results, trackers)
    how = {"occlusions": occlusions, "between": between, "baseline": baseline, "cues": cues}
    save(json, {"measure": "elmo, recovery", **how, "runs": [asdict(result) for result in results]})


def show(results: Sequence[Result], trackers: Sequence[str]) -> None:
    out = report.console()
    table = report.table(
        "errors [mm] over shoulders, elbows, wrists, neck and head, in the world",
        "tracker", "first frame", "before, median", "first seen, median", f"under {FOUND:.0f}", f"within {WITHIN}",
        "of", "found before, then again",
    )  # fmt: skip
    for name in trackers:
        own = [result for result in results if result.tracker == name]
        first = ", ".join(f"{result.first:.0f}" for result in own)
        before = np.array([error for result in own for error in result.before])
        after = np.array([errors for result in own for errors in result.after])
        if not len(after):
            table.add_row(name, first)
            continue
        again = after[:, 0] <= FOUND
        known = before <= FOUND
        table.add_row(
            name, first if name not in GIVEN and name != NEIGHBOURS else "given", f"{np.nanmedian(before):.0f}",
            f"{np.nanmedian(after[:, 0]):.0f}", f"{again.mean():.0%}", f"{(after <= FOUND).any(axis=1).mean():.0%}",
            str(len(after)), f"{np.count_nonzero(again & known)} of {np.count_nonzero(known)}",
        )  # fmt: skip
    out.print(table)
    out.print(
        f"within {WITHIN}: the best of the first {WITHIN} frames seen after an occlusion is under {FOUND:.0f} mm."
    )
