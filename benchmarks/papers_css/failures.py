"""The failures of CSS section 6 on the stand-ins of its sequences: which tracker loses which of them when, all trackers
having as much processor time a frame as CSS and judged by the same criteria, as they tracked and smoothed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from benchmarks.papers_css.failure_runs import CSS, Attempt, Sizing, Tracking, own_size
from benchmarks.papers_css.failure_table import by_tracker, figures_of, in_markdown, order, show, summed
from benchmarks.papers_css.runs_plot import write_runs
from benchmarks.papers_css.sequences import Motion, Task, rendered
from benchmarks.support.common import CUES, Changes, Json, Several, Work, in_processes, nested, save, work_folder
from benchmarks.support.result_store import ResultStore, all_done
from estimator.trackers.spec import NO_CAPTURE, together
from estimator.tracking.registry import TRACKERS
from humanoid.support.errors import InputError
from kinemode.pictures import cue_choice
from kinemode.terminal import report

BY_ONE_CAMERA = tuple(
    name for name, spec in TRACKERS.items() if spec.group not in ("elmo", "loose_limbed", "dual_chain", "markers")
)
"""ELMO and its parts use depth, which these clips do not have, loose-limbed people by several cameras, dual chains by
two arms, markers by points in space."""


def main(
    *,
    motions: Annotated[tuple[Motion, ...], Several] = ("arm", "pivot", "turn_reach"),
    trackers: Annotated[tuple[str, ...], Several] = BY_ONE_CAMERA,
    clip_seeds: Annotated[tuple[int, ...], Several] = (1, 2, 3),
    seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2),
    seconds: float | None = None,
    source: Literal["pictures", "keypoints"] = "pictures",
    cues: str = ",".join(CUES),
    background: Literal["learned", "plate"] = "learned",
    modes: int = 7,
    changes: Changes = (),
    trial: int = 6,
    jobs: int = 1,
    work: Work = None,
    markdown: Annotated[bool, Parameter(negative="")] = False,
    figures: Path | None = None,
    json: Json = None,
) -> None:
    """Track the rendered arm, pivoting body and turning body with every tracker, in equal time.

    The pose prior is off, as only css has it.

    All of it is 270 runs, four to six hours of one core. An interrupted measure resumes if its --work is given again.

    Parameters
    ----------
    motions
        Which of them.
    trackers
        Which; css is always one, and gives the time that the others get.
    clip_seeds
        Seeds of the clips: room, clothes and noise.
    seeds
        Seeds of the trackers.
    seconds
        Only so much of each.
    source
        pictures: joints of the first frame, then pictures alone; keypoints: a detector's in every frame, no pictures.
    cues
        Some of edges, flow and silhouette, separated by commas.
    background
        Learned from the clip, or a picture of the empty scene is given.
    modes
        Hypotheses that css and css-paper keep; the others keep their own number.
    changes
        Changes to the settings, as cost.nu=8 css.scale=4.
    trial
        Frames of the short runs that decide the sizes, 3 or more.
    jobs
        Runs at a time, each in a process of its own.
    markdown
        Also print the table of the documents.
    figures
        Also write a picture of all runs, failures.png, into this folder.
    """
    rivals = _rivals(trackers, trial)
    chosen = () if (detected := source == "keypoints") else cue_choice(cues) or ()
    how = {
        "cues": ",".join(chosen) or "off",
        "modes": modes,
        "settings": together(NO_CAPTURE, nested(changes)),
    }
    plate = background == "plate" and "silhouette" in chosen
    with work_folder(work) as folder:
        clips = [Task(m, s, seconds, plate, folder / "clips", how, detected) for m in motions for s in clip_seeds]
        attempts, codes = raced(clips, rivals, seeds, ResultStore(folder), trial, jobs)
    rows = summed(attempts)
    show(rows)
    for line in (*order(attempts, rows), *([] if codes == 1 else [f"the runs are of {codes} states of the code"])):
        report.console().print(line, soft_wrap=True)
    if markdown:
        print(in_markdown(rows))
    if figures is not None:
        write_runs(figures / "failures.png", by_tracker(attempts))
    save(json, {"measure": "failures", "source": source, "background": background, "how": how, "codes": codes,
                "rows": [figures_of(row) for row in rows], "runs": [asdict(a) for a in attempts]})  # fmt: skip


def raced(
    clips: Sequence[Task], rivals: Sequence[str], seeds: Sequence[int], store: ResultStore, trial: int, jobs: int
) -> tuple[list[Attempt], int]:
    """CSS, then the rivals in the time that it took, on every clip with every seed; and of how many states of the code
    the runs are. A rival's size is decided once for each motion, on its first clip."""
    in_processes(rendered, clips, jobs)
    css = [Tracking(clip, CSS, seed) for seed in seeds for clip in clips]
    all_done(CSS, store, css, jobs)
    firsts = {clip.motion: clip for clip in reversed(clips)}
    sizings = {
        (name, motion): Sizing(Tracking(clip, name, seeds[0]), tuple(run for run in css if run.task is clip), trial)
        for motion, clip in firsts.items()
        for name in rivals
        if own_size(name, clip.how["settings"]) is not None
    }
    made = all_done("sizes for equal time", store, list(sizings.values()), jobs)
    sizes = {key: int(result["size"]) for key, result in zip(sizings, made, strict=True)}
    others = [
        Tracking(clip, name, seed, sizes.get((name, clip.motion)))
        for seed in seeds
        for clip in clips
        for name in rivals
    ]
    runs = [*css, *others]
    attempts = [Attempt.of(result) for result in all_done("all trackers", store, runs, jobs)]
    return attempts, len(store.codes(runs))


def _rivals(trackers: Sequence[str], trial: int) -> list[str]:
    if trial < 3:
        raise InputError("--trial", f"is {trial}", remedy="3 or more: kernels are loaded in the first two frames")
    for name in trackers:
        if name not in TRACKERS:
            raise InputError("--trackers", f"no tracker {name!r}", remedy="some of " + ", ".join(TRACKERS))
    return [name for name in trackers if name != CSS]
