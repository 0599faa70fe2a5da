"""ELMO with one camera and no depth: modes of edges and silhouette."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from benchmarks.papers_elmo.elmo import RIVALS
from benchmarks.papers_elmo.elmo_clips import JOINTS, SEQUENCES, Filmed, filmed
from benchmarks.support.common import (
    Changes,
    Data,
    Json,
    Several,
    Work,
    captured_folder,
    check_known,
    nested,
    save,
    tell,
    work_folder,
)
from benchmarks.support.result_store import removed
from benchmarks.support.tracking import timed_track
from estimator.runs.run_reader import Run
from kinemode.shot import RenderedClip
from kinemode.terminal import report

HIPS = ("left_hip", "right_hip")


@dataclass(frozen=True)
class Row:
    """Errors (T) [mm] of every frame, means over `JOINTS`, NaN without a hypothesis: of the likeliest mode in the
    world, with the hips aligned, and of the best of all modes with them aligned. seconds: of processor time a frame."""

    sequence: str
    tracker: str
    plate: bool
    world: list[float]
    aligned: list[float]
    best: list[float]
    seconds: float


def main(
    *,
    index: Path,
    data: Data = None,
    sequences: Annotated[tuple[str, ...], Several] = ("wave", "walk_turn"),
    trackers: Annotated[tuple[str, ...], Several] = ("elmo", "psh", "icp"),
    cues: str = "silhouette,edges",
    plate: bool = False,
    frames: int = 100,
    changes: Changes = (),
    work: Work = None,
    json: Json = None,
) -> None:
    """Track the left clip of rendered stereo sequences alone, by pictures without depth.

    Parameters
    ----------
    index
        Index of examples (`kinemode train-index`).
    sequences
        Which.
    trackers
        Which; icp is given the first pose.
    cues
        The cues to use.
    plate
        Give a picture of the empty scene; otherwise the background is learned from the clip.
    frames
        Of each sequence.
    changes
        Changes to the settings, as elmo.rounds=2.
    """
    folder = captured_folder(data)
    if folder is None:
        return
    check_known("--sequences", sequences, SEQUENCES)
    check_known("--trackers", trackers, RIVALS)
    rows = []
    with work_folder(work) as kept:
        for name in sequences:
            film = Filmed(name, frames, folder, kept)
            clip = filmed(film)
            for tracker in trackers:
                out = film.clip_folder / f"{tracker}_alone.run"
                rows.append(tracked(clip, out, name, tracker, index, cues, plate, nested(changes)))
    show(rows)
    save(json, {"measure": "elmo, silhouette", "cues": cues, "frames": frames, "rows": [asdict(row) for row in rows]})


def tracked(
    clip: RenderedClip, out: Path, name: str, tracker: str, index: Path, cues: str, plate: bool, own: dict[str, Any]
) -> Row:
    """By the first of the clip's cameras."""
    camera = next(iter(clip.videos))
    given = {camera: clip.first_frame[camera]} if tracker == "icp" else None
    run, times = timed_track(
        given, clip.cameras, out, clips={camera: clip.videos[camera]}, cues=cues, subject=clip.subject, fit="off",
        background={camera: clip.plates[camera]} if plate else None, tracker=tracker, settings=own,
        index=None if tracker == "icp" else index,
    )  # fmt: skip
    errors = measured(run, clip)
    removed(out)
    tell(f"{name}, {tracker}: {', '.join(f'{np.nanmean(e):.0f}' for e in errors)} mm")
    world, aligned, best = (e.tolist() for e in errors)
    return Row(name, tracker, plate, world, aligned, best, times.cpu_tracking)


def measured(run: Run, clip: RenderedClip) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """See `Row`."""
    with np.load(clip.truth) as truth:
        names, true = truth["landmark_names"].tolist(), truth["landmarks"]
    ours = run.mode_landmarks
    true = true[: len(ours)][:, [names.index(name) for name in run.body.landmark_names]]
    joints, hips = ([run.body.landmark_names.index(name) for name in some] for some in (JOINTS, HIPS))
    off = ours - true[:, None]
    beside = off - off[:, :, hips].mean(axis=2, keepdims=True)
    world, aligned = (1e3 * np.linalg.norm(d[:, :, joints], axis=3).mean(axis=2) for d in (off, beside))
    return world[:, 0], aligned[:, 0], np.fmin.reduce(aligned, axis=1)


def show(rows: list[Row]) -> None:
    table = report.table(
        "errors [mm] over shoulders, elbows, wrists, neck and head, one camera without depth",
        "tracker: sequence", "world", "deviation", "hips aligned", "best of modes, aligned", "frames", "s a frame",
    )  # fmt: skip
    for r in rows:
        means = [f"{np.nanmean(e):.0f}" for e in (r.world, r.aligned, r.best)]
        table.add_row(
            f"{r.tracker}: {r.sequence}", means[0], f"{np.nanstd(r.world):.0f}", *means[1:],
            f"{np.mean(np.isfinite(r.world)):.0%}", f"{r.seconds:.2f}",
        )  # fmt: skip
    report.console().print(table)
