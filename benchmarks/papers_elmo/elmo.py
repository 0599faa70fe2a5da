"""ELMO section 4.1: errors of ELMO and its rivals on stereo sequences (Figures 4 and 5), and times (Table 1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import kinemode as km
from benchmarks.papers_elmo.elmo_clips import JOINTS, LEGS, SEQUENCES, Filmed, filmed
from benchmarks.support.common import (
    Changes,
    Data,
    Json,
    Several,
    Work,
    captured_folder,
    check_known,
    in_processes,
    nested,
    save,
    tell,
    work_folder,
)
from benchmarks.support.result_store import removed
from benchmarks.support.tracking import timed_track
from estimator.runs.run_reader import Run
from estimator.search.settings import BY_KEYPOINTS
from estimator.trackers.spec import together
from estimator.tracking.registry import TRACKERS
from humanoid.kinematics.body import points_of_each
from humanoid.subject.subject import Subject
from humanoid.support.files import replacing
from kinemode.shot import RenderedClip
from kinemode.terminal import report

RIVALS = ("elmo", "condensation", "psh", "icp")
FAR = 100.0  # mm
LOST = 250.0  # mm
AT_RANDOM = "elmo-random"  # ELMO with as many random examples in place of those that look like the picture
BEGUN = "elmo-given"  # ELMO with the first pose given, as its rivals have it
GIVEN = ("icp", "condensation", "css", BEGUN)
"""These are given the first pose."""
CRITERION: Mapping[str, Any] = {name: TRACKERS["elmo"].defaults[name] for name in ("cost", "cues")}
"""The same for all: the shipped pose prior was learned from these very motions, and ELMO has none."""
PAPER: dict[str, dict[str, Any]] = {
    "condensation": together(CRITERION, {"condensation": {"particles": 1000}}),
    "css": together(CRITERION, {"smooth": {"enabled": False}}),
    BEGUN: {"search": {"start": BY_KEYPOINTS}},
}


@dataclass(frozen=True)
class Task:
    """A tracker on a sequence. body: whether it tracks the true body, or the built-in one fitted to the first frame.
    index: for those that look poses up. until [s]: where it ends, if before the sequence does. cues: image cues that
    are used."""

    film: Filmed
    tracker: str
    body: str
    index: Path
    settings: Mapping[str, Any]
    seed: int = 0
    until: float | None = None
    cues: str = "depth"


@dataclass(frozen=True)
class Result:
    """seed: of clip and tracker. error, legs (T): means over `JOINTS` and `LEGS` of the likeliest hypothesis of each
    frame in the world [mm], NaN without one. path (T): over `JOINTS` of the trajectory that the run ends with, which
    later frames decide too. seconds: of processor time a frame."""

    sequence: str
    tracker: str
    seed: int
    error: list[float]
    legs: list[float]
    path: list[float]
    seconds: float


def tracked(task: Task) -> Result:
    """Render and track."""
    clip = filmed(task.film)
    out = task.film.clip_folder / f"{task.tracker}.run"
    tracker = run_as(task.tracker)
    looks_up = tracker in ("elmo", "psh")
    index = shuffled(task.index, task.film.folder / "shuffled.npz") if task.tracker == AT_RANDOM else task.index
    given = clip.first_frame if task.tracker in GIVEN else None
    seen: dict[str, Any] = {"clips": clip.videos, "stereo": {"cam01": "cam01_right"}}
    if task.film.depths:
        seen = {"clips": {"cam01": clip.videos["cam01"]}, "depth": {"cam01": clip.depths["cam01"]}}
    subject = fitted(clip) if task.body == "fitted" else clip.subject
    run, times = timed_track(
        given, clip.cameras, out, **seen, cues=task.cues, subject=subject, fit="off",
        tracker=tracker, seed=task.seed, settings=task.settings,
        index=index if looks_up else None, end=task.until,
    )  # fmt: skip
    error, legs = (errors(run.mode_landmarks[:, 0], run, clip, joints) for joints in (JOINTS, LEGS))
    path = errors(points_of_each(run.body.placed(run.q), run.body.landmark_joint, run.body.landmark_local), run, clip)
    removed(out)
    shown = f"{np.nanmean(error):.0f} mm, {times.cpu_tracking:.2f} s a frame"
    tell(f"{task.film.name}, {task.tracker}, seed {task.seed}: {shown}")
    return Result(
        task.film.name, task.tracker, task.seed, error.tolist(), legs.tolist(), path.tolist(), times.cpu_tracking
    )


def fitted(clip: RenderedClip) -> Subject:
    """The built-in body with the lengths from the first frame's keypoints, which the track is then not given."""
    return km.fit("human34", clip.videos, cameras=clip.cameras, keypoints=clip.first_frame, cues="off").subject


def run_as(tracker: str) -> str:
    """The tracker that is run by that name."""
    return "elmo" if tracker in (AT_RANDOM, BEGUN) else tracker


def shuffled(index: Path, path: Path) -> Path:
    """The same examples under each other's bits, so that any of them are looked up."""
    with np.load(index) as kept:
        arrays = dict(kept)
    arrays["codes"] = np.random.default_rng(0).permutation(arrays["codes"])
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)
    return path


def errors(landmarks: np.ndarray, run: Run, clip: RenderedClip, joints: Sequence[str] = JOINTS) -> np.ndarray:
    """Mean errors (T,) over some joints of a run's landmarks (T, L, 3) in the world [mm], nothing aligned."""
    with np.load(clip.truth) as truth:
        names, true = truth["landmark_names"].tolist(), truth["landmarks"]
    ours = [run.body.landmark_names.index(name) for name in joints]
    theirs = [names.index(name) for name in joints]
    off = landmarks[:, ours] - true[: len(landmarks), theirs]
    return np.asarray(1e3 * np.linalg.norm(off, axis=2).mean(axis=1))


def main(
    *,
    index: Path,
    data: Data = None,
    sequences: Annotated[tuple[str, ...], Several] = tuple(SEQUENCES),
    trackers: Annotated[tuple[str, ...], Several] = RIVALS,
    body: Literal["true", "fitted"] = "true",
    frames: int = 1000,
    fps: float = 30.0,
    baseline: float = 0.12,
    depth: Literal["stereo", "exact"] = "stereo",
    until: float | None = None,
    cues: str = "depth",
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track rendered stereo sequences with ELMO, CONDENSATION (1000 particles), PSH and ICP.

    ICP and CONDENSATION are given the first pose, ELMO and PSH nothing.

    Parameters
    ----------
    index
        Index of examples (`kinemode train-index`).
    sequences
        Which.
    trackers
        Which; also css, elmo-random, which searches from as many random examples, and elmo-given, which is given the
        first pose too.
    body
        The tracked body: the one in the pictures, or the built-in one with lengths fitted to the first frame.
    frames
        Of each sequence.
    fps
        Frames per second: 30, or 4 for section 4.2.
    baseline
        Metres between the cameras.
    depth
        Where it is from: stereo matching of the pair, or the renderer.
    until
        Seconds of each sequence that are tracked; all by default.
    cues
        Image cues to use, as depth,silhouette.
    seeds
        Of tracker and clip: each has a room, clothes and noise of its own.
    changes
        Changes to the settings, as elmo.rounds=2.
    jobs
        Runs at a time, each in a process of its own.
    """
    folder = captured_folder(data)
    if folder is None:
        return
    check_known("--sequences", sequences, SEQUENCES)
    check_known("--trackers", trackers, (*TRACKERS, AT_RANDOM, BEGUN))
    with work_folder(work) as kept:
        films = [
            Filmed(name, frames, folder, kept, fps, baseline, clip=s, depths=depth == "exact")
            for name in sequences
            for s in seeds
        ]
        in_processes(filmed, films, jobs)
        own = nested(changes)
        settings = {t: together(PAPER.get(t, {}), _of(t, own)) for t in trackers}
        tasks = [Task(film, t, body, index, settings[t], film.clip, until, cues) for film in films for t in trackers]
        results = in_processes(tracked, tasks, jobs)
    show(results, trackers)
    filming = {"frames": frames, "fps": fps, "baseline": baseline, "depth": depth, "cues": cues}
    save(json, {"measure": "elmo", "body": body, **filming, "runs": [asdict(result) for result in results]})


def _of(tracker: str, changes: dict[str, Any]) -> dict[str, Any]:
    """The changes that are about a tracker."""
    groups = {"cost", "search", "cues", "smooth", TRACKERS[run_as(tracker)].group}
    return {name: value for name, value in changes.items() if name in groups}


def show(results: list[Result], trackers: tuple[str, ...]) -> None:
    out, seeds = report.console(), sorted({result.seed for result in results})
    table = report.table(
        "errors [mm] over shoulders, elbows, wrists, neck and head, in the world",
        "tracker: sequence", "mean", "deviation", "first frame", "over 100 mm", "lost at", "back", "path", "legs",
        "s a frame",
    )  # fmt: skip
    for name in trackers:
        own = [result for result in results if result.tracker == name]
        for result in own:
            row = f"{name}: {result.sequence}" + (f", seed {result.seed}" if len(seeds) > 1 else "")
            table.add_row(row, *cells(np.array(result.error)), *_means([result]))
        for seed in seeds if len(seeds) > 1 else ():
            of_seed = np.concatenate([result.error for result in own if result.seed == seed])
            table.add_row(f"{name}: all, seed {seed}", *cells(of_seed)[:2], "", cells(of_seed)[3], *5 * [""])
        every = np.concatenate([result.error for result in own])
        table.add_row(f"{name}: all", *cells(every)[:2], "", cells(every)[3], "", "", *_means(own))
        table.add_section()
    out.print(table)
    out.print(
        f"lost at: the first frame over {LOST:.0f} mm; back: whether a later one is under {FAR:.0f} mm; path: the mean"
        " of the trajectory that the run ends with, which later frames decide too; legs: over knees and ankles [mm]."
    )


def _means(results: Sequence[Result]) -> tuple[str, str, str]:
    """Means along the path, of legs and of time."""
    path, legs = (
        np.nanmean(np.concatenate([getattr(result, name) for result in results])) for name in ("path", "legs")
    )
    return f"{path:.1f}", f"{legs:.1f}", f"{np.mean([result.seconds for result in results]):.2f}"


def cells(error: np.ndarray) -> tuple[str, ...]:
    """Mean, deviation, first, share of frames over 100 mm or without a pose, when it was lost and whether it came
    back."""
    far = ~(error <= FAR)
    lost = np.flatnonzero(~(error <= LOST))
    back = "" if not len(lost) else ("yes" if (error[lost[0] :] <= FAR).any() else "no")
    return (
        f"{np.nanmean(error):.1f}", f"{np.nanstd(error):.1f}", f"{error[0]:.0f}", f"{far.mean():.1%}",
        str(lost[0]) if len(lost) else "none", back,
    )  # fmt: skip
