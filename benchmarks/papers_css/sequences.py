"""Stand-ins for the sequences of CSS section 6: one camera, joints given in the first frame, then pictures alone."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

import kinemode as km
from benchmarks.papers_css.beginnings import Beginning, start_errors, verdict as verdict_on
from benchmarks.support.common import CUES, Changes, Json, Several, Work, in_processes, nested, save, tell, work_folder
from benchmarks.support.result_store import cached_clip
from benchmarks.support.scores import (
    TRACK_COLUMNS,
    TRACK_LEGEND,
    TRAJECTORIES,
    Outcome,
    TrackErrors,
    outcome,
    track_cells,
)
from benchmarks.support.tracking import Times, timed_track
from estimator.runs.run_reader import Run
from estimator.synthesis.motion_keys import motion_named
from estimator.synthesis.settings import SceneSettings
from humanoid.support.errors import InputError
from kinemode.pictures import cue_choice
from kinemode.shot import RenderedClip
from kinemode.terminal import report

FPS = {"arm": 25.0, "pivot": 25.0, "turn_reach": 50.0}
TARGET_MM = {"arm": 40.0, "pivot": 90.0, "turn_reach": 90.0}
Motion = Literal["arm", "pivot", "turn_reach"]


@dataclass(frozen=True)
class Task:
    """One clip to render and track: the motion, the clip's seed, and how.

    seconds: only so much of the motion. plate: whether the empty scene is given. folder: of all clips, which are kept
    there, a folder each. how: arguments of `timed_track`. detected: track from a detector's keypoints in every frame
    instead of the first frame's and the pictures. begins: with an index instead, before a stereo pair. fps: of the
    clip, None for that of `FPS`.
    """

    motion: str
    clip_seed: int
    seconds: float | None
    plate: bool
    folder: Path
    how: dict[str, Any]
    detected: bool = False
    begins: Beginning | None = None
    fps: float | None = None

    @property
    def rate(self) -> float:
        """Frames a second of its clip."""
        return self.fps or FPS[self.motion]

    @property
    def label(self) -> str:
        return f"{self.motion}, clip seed {self.clip_seed}"

    @property
    def clip_folder(self) -> Path:
        """Where its clip is."""
        rate = "" if self.fps is None else f"_{self.fps:g}fps"
        name = self.motion + (self.begins.name if self.begins else "") + rate
        return clip_folder(self.folder, name, self.clip_seed, self.seconds, not self.detected)


def clip_folder(folder: Path, name: str, seed: int, seconds: float | None, videos: bool = True) -> Path:
    """Where a clip of some motion and seed is among all."""
    shortened = "" if seconds is None else f"_{seconds:g}s"
    return folder / f"{name}_{seed}{shortened}{'' if videos else '_keypoints'}"


def rendered(task: Task) -> RenderedClip:
    """The task's clip, rendered unless it is there."""
    longest = motion_named(task.motion).seconds
    seconds = None if task.seconds is None else min(task.seconds, longest)

    def render(folder: Path) -> None:
        km.render(
            folder, task.motion, fps=task.rate, seconds=seconds, seed=task.clip_seed, videos=not task.detected,
            **(task.begins.rendered if task.begins else {}),
        )  # fmt: skip
        tell(f"{task.label}: rendered")

    return cached_clip(task.clip_folder, render)


def track_clip(task: Task, clip: RenderedClip, out: Path, **more: Any) -> tuple[Run, Times]:
    """Track a task's clip into a run file; the subject is the body in the pictures."""
    how: dict[str, Any] = {"subject": clip.subject, "fit": "off"} | task.how | more
    if task.detected:
        return timed_track(clip.keypoints, clip.cameras, out, **how)
    if task.begins:
        return timed_track(None, clip.cameras, out, clips=clip.videos, **how | task.begins.tracked)
    plates = clip.plates if task.plate else None
    return timed_track(clip.first_frame, clip.cameras, out, clips=clip.videos, background=plates, **how)


def tracked(task: Task) -> Outcome:
    """Render and track."""
    clip = rendered(task)
    run, times = track_clip(task, clip, task.clip_folder / "track.run")
    scored = outcome(run, times, clip.truth)
    tell(
        f"{task.label}: {len(run)} frames tracked at {scored.fps:.1f} a second, {scored.errors['smoothed'].mean:.1f} mm"
    )
    if task.begins is None:
        return scored
    said = verdict_on(start_errors(run, clip.truth, task.rate, task.begins.hidden))
    return replace(scored, notes=(*scored.notes, said))


def main(
    *,
    motions: Annotated[tuple[Motion, ...], Several] = ("arm", "pivot", "turn_reach"),
    seeds: Annotated[tuple[int, ...], Several] = (1,),
    seconds: float | None = None,
    cues: str = ",".join(CUES),
    background: Literal["learned", "plate"] = "learned",
    start: Literal["joints", "index"] = "joints",
    index: Path | None = None,
    hidden: tuple[str, ...] = (),
    fps: float | None = None,
    tracker: str = "css",
    seed: int = 0,
    modes: int = 7,
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track the rendered arm, pivoting body and turning body from the joints of their first frames and the pictures.

    With --start index the bodies (human34, by depth of a stereo pair too) are given no pose.

    Parameters
    ----------
    motions
        Which of them.
    seeds
        Seeds of the clips: room, clothes and noise.
    seconds
        Only so much of each.
    cues
        Some of edges, flow and silhouette, separated by commas.
    background
        Learned from the clip, or a picture of the empty scene is given.
    start
        What the first pose comes from.
    index
        Index of examples of human34, for --start index.
    hidden
        FROM:TO in seconds, with --start index: a screen hides the person.
    fps
        Frames a second of the clips; by default 25 of arm and pivot and 50 of the turn. CSS's own films had 50 fields.
    tracker
        As in `kinemode track`.
    seed
        Seed of the tracker.
    modes
        As in `kinemode track`.
    changes
        Changes to the settings, as cost.nu=8 css.scale=4.
    jobs
        Clips tracked at a time, each in a process of its own.
    """
    chosen = cue_choice(cues) or ()
    how = {
        "cues": ",".join(chosen) or "off",
        "tracker": tracker,
        "seed": seed,
        "modes": modes,
        "settings": nested(changes),
    }
    plate = background == "plate" and "silhouette" in chosen
    begins = None
    if start == "index":
        if index is None or "arm" in motions:
            remedy = "give --index, made by kinemode train-index human34, and --motions pivot turn_reach"
            raise InputError("--start", "takes an index of human34, which an arm is not", remedy=remedy)
        begins = Beginning(index, SceneSettings(hidden=hidden).spans)
        how["cues"] = ",".join(dict.fromkeys(("depth", *chosen)))
    with work_folder(work) as folder:
        tasks = [Task(m, s, seconds, plate, folder, how, begins=begins, fps=fps) for m in motions for s in seeds]
        outcomes = in_processes(tracked, tasks, jobs)
    by_motion: dict[str, dict[int, Outcome]] = {}
    for task, scored in zip(tasks, outcomes, strict=True):
        by_motion.setdefault(task.motion, {})[task.clip_seed] = scored
    show(by_motion, f"stand-ins, {tracker}, {how['cues']}, background {background}")
    save(json, {"measure": "sequences", "background": background, "fps": fps, "how": how, "target_mm": TARGET_MM,
                "clips": {m: {s: asdict(o) for s, o in of.items()} for m, of in by_motion.items()}})  # fmt: skip


def show(by_motion: dict[str, dict[int, Outcome]], title: str) -> None:
    made = report.table(title, "clip, seed: trajectory", *TRACK_COLUMNS, "fps")
    out = report.console()
    for motion, by_seed in by_motion.items():
        for number, scored in by_seed.items():
            for name in TRAJECTORIES:
                made.add_row(f"{motion}, {number}: {name}", *track_cells(scored.errors[name]), f"{scored.fps:.1f}")
        made.add_section()
    out.print(made)
    out.print(TRACK_LEGEND)
    for motion, by_seed in by_motion.items():
        for number, scored in by_seed.items():
            for note in scored.notes:
                out.print(f"{motion}, {number}: {note}")
        out.print(verdict(motion, [scored.errors["smoothed"] for scored in by_seed.values()]))


def verdict(motion: str, errors: list[TrackErrors]) -> str:
    """The smoothed trajectories of all seeds beside the targets."""
    means = [error.mean for error in errors]
    lost = sum(error.lost is not None for error in errors)
    return (
        f"{motion}, smoothed, {len(errors)} seed(s): mean {np.mean(means):.1f}, worst seed {max(means):.1f} mm,"
        f" target at most {TARGET_MM[motion]:.0f}; lost in {lost} of {len(errors)}, target none"
    )
