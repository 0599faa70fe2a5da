"""Captured motion, rendered: one camera, a body of other lengths and girth, from pictures, keypoints, and both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from rich.table import Table

from benchmarks.support.common import (
    CUES,
    NO_CAPTURE_HERE,
    Changes,
    Clips,
    Data,
    Every,
    Json,
    Several,
    Work,
    data_folder,
    in_processes,
    nested,
    save,
    tell,
    work_folder,
)
from benchmarks.support.pose_prior_clips import render_captured
from benchmarks.support.scores import (
    TRACK_COLUMNS,
    TRACK_LEGEND,
    TRAJECTORIES,
    Outcome,
    TrackErrors,
    outcome,
    track_cells,
)
from benchmarks.support.tracking import timed_track
from benchmarks.training.pose_prior import PriorChoice, prior_settings
from humanoid.support.errors import InputError
from kinemode.pictures import cue_choice
from kinemode.shot import RenderedClip
from kinemode.terminal import report

DEFAULT = ("walk_straight_07_01", "run_02_03", "jump_16_01", "walk_turn_26_01", "punch_02_05")
TARGET_MM = 70.0
Condition = Literal["cues alone", "keypoints alone", "keypoints and cues"]
PICTURES: Final = "cues alone"
KEYPOINTS: Final = "keypoints alone"
BOTH: Final = "keypoints and cues"
CONDITIONS: tuple[Condition, ...] = (PICTURES, KEYPOINTS, BOTH)


@dataclass(frozen=True)
class Task:
    """One captured motion to render and to track in every condition.

    seconds: only so much of it. plate: whether the empty scene is given. conditions: some of `CONDITIONS`. how:
    arguments of `timed_track`. cues: those that are used where pictures are.
    """

    motion: Path
    clip_seed: int
    seconds: float | None
    plate: bool
    folder: Path
    conditions: tuple[str, ...]
    how: dict[str, Any]
    cues: str = ",".join(CUES)


def tracked(task: Task) -> dict[str, Outcome]:
    """Render, and track human34 in every condition, its lengths fitted."""
    name = task.motion.stem
    clip = render_captured(task.motion, task.seconds, task.clip_seed, task.folder, videos=True)
    tell(f"{name}: rendered")
    outcomes = {}
    for condition in task.conditions:
        run, times = timed_track(
            clip.first_frame if condition == PICTURES else clip.keypoints,
            clip.cameras,
            task.folder / f"{condition.replace(' ', '_')}.run",
            clips=clip.videos,
            cues="off" if condition == KEYPOINTS else task.cues,
            background=clip.plates if task.plate and condition != KEYPOINTS else None,
            **task.how,
        )
        outcomes[condition] = outcome(run, times, clip.truth)
        error = outcomes[condition].errors["smoothed"].mean
        tell(f"{name}, {condition}: {len(run)} frames tracked at {times.rate:.1f} a second, {error:.1f} mm")
    return outcomes


def main(
    *,
    data: Data = None,
    clips: Clips = DEFAULT,
    every: Every = False,
    seconds: float | None = None,
    cues: str = ",".join(CUES),
    background: Literal["learned", "plate"] = "learned",
    conditions: Annotated[tuple[Condition, ...], Several] = CONDITIONS,
    prior: PriorChoice = "unseen",
    clip_seed: int = 2,
    seed: int = 0,
    modes: int = 7,
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track rendered captured motions from one camera: from cues alone, from poor keypoints, and from both.

    Parameters
    ----------
    seconds
        Only so much of each.
    cues
        Those of the pictures, separated by commas.
    background
        Learned from the clip, or a picture of the empty scene is given.
    conditions
        Cues alone, keypoints alone, keypoints and cues.
    prior
        Pose prior: learned from all people but the tracked one; the shipped one, which has seen these clips; or
        off.
    clip_seed
        Seed of the clips: room, clothes, noise and the errors of the keypoints.
    seed
        Seed of the tracker.
    modes
        As in `kinemode track`.
    changes
        Changes to the settings, as cost.nu=8 css.scale=4.
    jobs
        Clips tracked at a time, each in a process of its own.
    """
    files = motion_files(data, clips, every)
    if not files:
        print(NO_CAPTURE_HERE)
        return
    chosen = ",".join(cue_choice(cues) or ()) or "off"
    how = {"seed": seed, "modes": modes}
    with work_folder(work) as folder:
        settings = prior_settings(prior, [f.stem for f in files], data, nested(changes), folder / "priors")
        tasks = [
            Task(
                f, clip_seed, seconds, background == "plate", folder / f.stem, conditions, how | {"settings": s}, chosen
            )
            for f, s in zip(files, settings, strict=True)
        ]
        outcomes = in_processes(tracked, tasks, jobs)
    by_clip = {f.stem: by_condition for f, by_condition in zip(files, outcomes, strict=True)}
    show(by_clip, background)
    figures = {name: {condition: asdict(o) for condition, o in of.items()} for name, of in by_clip.items()}
    recipe = how | {"prior": prior, "settings": nested(changes), "cues": chosen}
    save(json, {"measure": "mocap", "background": background, "how": recipe, "target_mm": TARGET_MM, "clips": figures})


def motion_files(data: Path | None, names: Sequence[str], every: bool) -> list[Path]:
    """The BVH files; none where no folder was given and the data is absent."""
    folder = data_folder(data)
    present = {path.stem: path for path in sorted((folder / "mocap").glob("*.bvh"))} if folder else {}
    if not present and data is None:
        return []
    absent = [name for name in names if name not in present]
    if not present or (absent and not every):
        problem = f"there is no {', '.join(absent)}" if present else "has no mocap folder with BVH files"
        raise InputError(folder or "mocap", problem, remedy=f"it has {', '.join(present)}" if present else "")
    return list(present.values()) if every else [present[name] for name in names]


def rendered_motions(
    data: Path | None,
    names: Sequence[str],
    every: bool,
    seconds: float,
    clip_seed: int,
    work: Path | None,
    *,
    masks: bool = False,
) -> Iterator[tuple[str, RenderedClip]]:
    """The names of the motions, and clips of them, one after the other, in a folder that is there until the last one
    was used; none, with a message, where no folder was given and the data is absent."""
    files = motion_files(data, names, every)
    if not files:
        print(NO_CAPTURE_HERE)
        return
    with work_folder(work) as folder:
        for file in files:
            yield file.stem, render_captured(file, seconds, clip_seed, folder / file.stem, videos=True, masks=masks)


def show(by_clip: dict[str, dict[str, Outcome]], background: str) -> None:
    out = report.console()
    for condition in next(iter(by_clip.values())):
        outcomes = {name: of[condition] for name, of in by_clip.items()}
        out.print(tabulated(f"{condition}, background {background}", outcomes))
    out.print(TRACK_LEGEND)
    for name, of in by_clip.items():
        for condition, scored in of.items():
            for note in scored.notes:
                out.print(f"{name}, {condition}: {note}")
    if set(next(iter(by_clip.values()))) < set(CONDITIONS):
        return
    for line in verdicts({c: [of[c].errors["smoothed"] for of in by_clip.values()] for c in CONDITIONS}):
        out.print(line)


def tabulated(title: str, outcomes: dict[str, Outcome]) -> Table:
    """The outcomes by clip, and their means."""
    made = report.table(title, "clip: trajectory", *TRACK_COLUMNS, "hips aligned", "PA", "fps")
    for name, scored in outcomes.items():
        for trajectory in TRAJECTORIES:
            errors = scored.errors[trajectory]
            made.add_row(f"{name}: {trajectory}", *track_cells(errors), *aligned([errors]), f"{scored.fps:.1f}")
        made.add_section()
    for trajectory in TRAJECTORIES:
        every = [scored.errors[trajectory] for scored in outcomes.values()]
        mean = np.mean([e.mean for e in every])
        made.add_row(f"mean: {trajectory}", f"{mean:.1f}", "", "", "", *aligned(every), "")
    return made


def aligned(errors: Sequence[TrackErrors]) -> list[str]:
    """Mean errors with the hips aligned and after a similarity."""
    return [f"{np.mean([e.aligned for e in errors]):.1f}", f"{np.mean([e.pa for e in errors]):.1f}"]


def verdicts(smoothed: dict[str, list[TrackErrors]]) -> list[str]:
    """The smoothed trajectories of every condition, (clips), beside the targets."""
    pictures, keypoints, both = (smoothed[condition] for condition in CONDITIONS)
    followed = sum(scored.lost is None for scored in pictures)
    lower = sum(a.mean < b.mean for a, b in zip(both, keypoints, strict=True))
    mean, alone = (float(np.mean([scored.mean for scored in of])) for of in (both, keypoints))
    return [
        "one camera does not see absolute size: it weighs on the mean, little on hips aligned, not at all on PA",
        f"{PICTURES}: no frame lost in {followed} of {len(pictures)} clips, target all",
        f"{BOTH}: mean {mean:.1f} mm, target at most {TARGET_MM:.0f}; hips aligned and PA"
        f" {', '.join(aligned(both))} mm",
        f"{KEYPOINTS}: mean {alone:.1f} mm, target above the former; hips aligned and PA"
        f" {', '.join(aligned(keypoints))} mm; the cues lower it in {lower} of {len(both)} clips",
    ]
