"""The failures of CSS section 6 on the stand-ins of its sequences: which tracker loses which of them when, all trackers
having as much processor time a frame as CSS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from benchmarks.common import CUES, Changes, Several, in_processes, nested, save, start, work_folder
from benchmarks.failure_runs import CSS, Attempt, Race, css_run, race
from benchmarks.scores import FAR_MM, FAR_PX
from benchmarks.sequences import FPS, Motion, Task
from estimator.tracking.registry import TRACKERS
from humanoid.support.errors import InputError
from kinemode.pictures import cue_choice
from kinemode.terminal import report

PAPER = {
    ("arm", CSS): "never",
    ("arm", "css-paper"): "never",
    ("arm", "gaussian-single-mode"): "0.5 and 2.2 s",
    ("arm", "robust-single-mode"): "2.6 s",
    ("pivot", CSS): "never",
    ("pivot", "css-paper"): "never",
    ("pivot", "gaussian-single-mode"): "0.3 s",
    ("pivot", "robust-single-mode"): "in the turn",
    ("pivot", "gaussian-multiple-hypothesis"): "0.5 s",
    ("pivot", "multiple-hypothesis"): "0.7 s",
    ("turn_reach", CSS): "never",
    ("turn_reach", "css-paper"): "never",
    ("turn_reach", "gaussian-single-mode"): "0.5 s",
    ("turn_reach", "robust-single-mode"): "about 1 s",
}
"""When the trackers lost the paper's own sequences, where section 6 says so."""

COLUMNS = (
    "size", "ms a frame", "of css's", "final [mm]", "filtered [mm]", "best of K [mm]", "image, worst [px]",
    "lost", "in the paper",
)  # fmt: skip
LEGEND = (
    "size: samples, starts or particles (of each layer) a frame, chosen so that a frame takes as long as CSS's; single"
    " modes have none. ms a frame: of processor time, smoothing included.\n"
    "final: the trajectory the run ends with, smoothed by css alone; filtered: best hypothesis of each frame as"
    " tracked; best of K: the nearest. Mean over the limb joints, in the world: nothing is aligned.\n"
    f"lost: first frame of the final trajectory with a joint error over {FAR_MM:.0f} mm or a distance over"
    f" {FAR_PX:.0f} px in the image. in the paper: CSS section 6, on its own sequences."
)


def main(
    *,
    motions: Annotated[tuple[Motion, ...], Several] = ("arm", "pivot", "turn_reach"),
    trackers: Annotated[tuple[str, ...], Several] = tuple(TRACKERS),
    seeds: Annotated[tuple[int, ...], Several] = (1,),
    seconds: float | None = None,
    source: Literal["pictures", "keypoints"] = "pictures",
    cues: str = ",".join(CUES),
    background: Literal["learned", "plate"] = "learned",
    seed: int = 0,
    modes: int = 7,
    changes: Changes = (),
    trial: int = 6,
    jobs: int = 1,
    work: Path | None = None,
    json: Annotated[Path | None, Parameter(name="--json")] = None,
) -> None:
    """Track the rendered arm, pivoting body and turning body with every tracker, in equal time.

    Parameters
    ----------
    motions
        Which of them.
    trackers
        Which; css is always one, and gives the time that the others get.
    seeds
        Seeds of the clips: room, clothes and noise.
    seconds
        Only so much of each.
    source
        pictures: joints of the first frame, then pictures alone; keypoints: a detector's in every frame, no pictures.
    cues
        Some of edges, flow and silhouette, separated by commas.
    background
        Learned from the clip, or a picture of the empty scene is given.
    seed
        Seed of the trackers.
    modes
        Hypotheses that css and css-paper keep; the others keep their own number.
    changes
        Changes to the settings, as cost.nu=8 css.scale=4.
    trial
        Frames of the short runs that decide the sizes, 3 or more.
    jobs
        Clips tracked at a time, each in a process of its own.
    work
        Folder that keeps clips and runs.
    json
        Also write the figures here.
    """
    rivals = _rivals(trackers, trial)
    chosen = () if (detected := source == "keypoints") else cue_choice(cues) or ()
    how = {"cues": ",".join(chosen) or "off", "seed": seed, "modes": modes, "settings": nested(changes)}
    plate = background == "plate" and "silhouette" in chosen
    with work_folder(work) as folder:
        tasks = [Task(m, s, seconds, plate, folder / f"{m}_{s}", how, detected) for m in motions for s in seeds]
        attempts = _raced(tasks, rivals, trial, jobs)
    _show_all(tasks, attempts)
    clips = {label: [asdict(a) for a in of_clip] for label, of_clip in attempts.items()}
    save(json, {"measure": "failures", "source": source, "background": background, "how": how, "clips": clips})


def _raced(tasks: Sequence[Task], rivals: Sequence[str], trial: int, jobs: int) -> dict[str, list[Attempt]]:
    """By clip css, and then the rivals in the time that it took."""
    first = in_processes(css_run, tasks, jobs)
    races = [
        Race(task, clip, name, css.cpu, trial)
        for task, (clip, css) in zip(tasks, first, strict=True)
        for name in rivals
    ]
    others = in_processes(race, races, jobs)
    return {
        task.label: [css, *(a for r, a in zip(races, others, strict=True) if r.task is task)]
        for task, (_, css) in zip(tasks, first, strict=True)
    }


def _rivals(trackers: Sequence[str], trial: int) -> list[str]:
    if trial < 3:
        raise InputError("--trial", f"is {trial}", remedy="3 or more: kernels are loaded in the first two frames")
    for name in trackers:
        if name not in TRACKERS:
            raise InputError("--trackers", f"no tracker {name!r}", remedy="some of " + ", ".join(TRACKERS))
    return [name for name in trackers if name != CSS]


def _show_all(tasks: Sequence[Task], attempts: Mapping[str, Sequence[Attempt]]) -> None:
    for task in tasks:
        show(task.motion, task.label, attempts[task.label])
    report.console().print(LEGEND, soft_wrap=True)


def show(motion: str, title: str, attempts: Sequence[Attempt]) -> None:
    """One clip's table, and who had the lowest error."""
    made = report.table(f"{title}: {attempts[0].frames} frames", "tracker", *COLUMNS)
    for a in attempts:
        made.add_row(a.tracker, *_cells(a, FPS[motion]), PAPER.get((motion, a.tracker), ""))
    report.console().print(made)
    report.console().print(verdict(attempts))


def _cells(a: Attempt, fps: float) -> list[str]:
    final, filtered, best = (a.outcome.errors[name] for name in ("smoothed", "filtered", "best of K"))
    lost = "never" if final.lost is None else f"{final.lost / fps:.2f} s, frame {final.lost}"
    size = "" if a.size is None else str(a.size)
    means = [f"{e.mean:.1f}" for e in (final, filtered, best)]
    return [size, f"{1e3 * a.cpu:.0f}", f"{a.times:.2f}", *means, f"{final.pixels:.1f}", lost]


def verdict(attempts: Sequence[Attempt]) -> str:
    """Whether CSS, the first, is nearer to the truth than every baseline, and who kept the person to the end."""
    css, *rivals = attempts
    baselines = [a for a in rivals if TRACKERS[a.tracker].group != TRACKERS[CSS].group]
    said = []
    for name, trajectory in (("final", "smoothed"), ("filtered", "filtered")):
        limit = css.outcome.errors[trajectory].mean
        nearer = [a.tracker for a in baselines if not a.outcome.errors[trajectory].mean > limit]
        said.append(f"{name}: {', '.join(nearer) or 'none'}")
    kept = [a.tracker for a in attempts if a.outcome.errors["smoothed"].lost is None]
    return f"baselines no further from the truth than css, {'; '.join(said)}\nto the end: {', '.join(kept) or 'none'}"


if __name__ == "__main__":
    start(main)
