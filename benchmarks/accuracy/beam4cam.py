"""Errors on the real clip beam4cam: each camera alone and all four, proportions fitted from the clip itself; and what
the pictures add to the keypoints of one camera. One track is luck: seeds of the tracker, and copies of the keypoints
that differ by their rounding, give the spread."""

from __future__ import annotations

import json as json_module
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from benchmarks.support.common import (
    Changes,
    Data,
    Json,
    Several,
    Work,
    beam_folder,
    in_processes,
    nested,
    save,
    tell,
    work_folder,
)
from benchmarks.support.scores import COLUMNS, FAR_MM, LEGEND, Scores, cells, mean_scores, score
from benchmarks.support.tracking import timed_track
from estimator.runs.reference_motion import Reference
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode.pictures import cue_choice
from kinemode.terminal import report

CAMERAS = ("cam01", "cam02", "cam03", "cam04")
LEARNED = {"cam01": (102.0, 77.0), "cam02": (232.0, 126.0), "cam03": (124.0, 84.0), "cam04": (118.0, 83.0)}
LEARNED_MEAN = (144.1, 92.4)
TOGETHER = "four"
TOGETHER_TARGET = 35.0
ALONE, ALL = "keypoints alone", "all together"
CUES = {ALONE: "off", "silhouette": "silhouette", "edges": "edges", "flow": "flow", ALL: "edges,flow,silhouette"}

SPREAD = {"mpjpe": "MPJPE", "pa": "PA", "filtered_mpjpe": "filtered", "filtered_pa": "PA ", "best_pa": "best of K, PA"}
NONE, SEEN_ALONE = "none", "silhouette"  # instead of keypoints, and the cue that is used then
ROUNDING_PX = 0.1  # of the copies
Result = tuple[Scores, float]
"""Errors, and frames per second."""


@dataclass(frozen=True)
class Task:
    """One run: of a view, with the pictures for some of `CUES`.

    copy: of the keypoints, 0 for what they are. pictures: cues that follow from the first frame's keypoints alone, ""
    where those of every frame are used. folder, keypoints: of the clip, and of its keypoints there. work: where
    the run goes. masks: folder of the person's, None where the background is learned. how: arguments of `timed_track`.
    """

    view: str
    cues: str
    seed: int
    copy: int
    folder: Path
    keypoints: str
    work: Path
    masks: Path | None
    how: dict[str, Any]
    pictures: str = ""


def cameras_of(view: str) -> tuple[str, ...]:
    """Of a view: a camera's name, several joined by "+", or `TOGETHER`."""
    return CAMERAS if view == TOGETHER else tuple(view.split("+"))


def masks_of(folder: Path, names: Iterable[str]) -> dict[str, Path]:
    """Masks of each camera there: a folder of pictures or a video of its name; raises InputError without one."""
    masks = {}
    for name in names:
        given = [path for path in sorted(folder.glob(f"{name}*")) if path.name == name or path.stem == name]
        if not given:
            raise InputError(folder, f"has no masks of {name}", remedy=f"{name}/00000.png, ... or {name}.mp4")
        masks[name] = given[0]
    return masks


def tracked(task: Task) -> Result:
    names = cameras_of(task.view)
    seen = task.pictures or (CUES[task.cues] if task.keypoints != NONE else SEEN_ALONE)
    files, how = None, dict(task.how)
    if task.keypoints != NONE:
        files = {name: copied(task.folder / task.keypoints / f"{name}.json", task.copy, task.work) for name in names}
        if task.pictures:
            files = {name: first_frame_of(path, task.work) for name, path in files.items()}
    else:
        how["fit"] = "off"
    if task.masks is not None and SEEN_ALONE in seen:
        how["masks"] = masks_of(task.masks, names)
    pictures = seen != "off"
    clips = {name: task.folder / "videos" / f"{name}.mp4" for name in names} if pictures else None
    shown = task.pictures.replace(",", "_") or task.cues.replace(" ", "_")
    out = task.work / f"{task.view}_{shown}_{task.keypoints}_{task.seed}_{task.copy}.run"
    run, times = timed_track(
        files, task.folder / "calibration.json", out, clips=clips, cues=seen, seed=task.seed, **how
    )
    # the reference is triangulated from the same detector's keypoints: what is compared is where it marks the body
    run.body.landmark_local = run.body.keypoint_local
    scores = score(run, Reference.load(task.folder / "reference3d.npz"))
    summary = f"{scores.mpjpe:.1f}, {scores.pa:.1f} mm, {times.rate:.1f} frames a second"
    tell(f"{task.view}, {task.cues}, seed {task.seed}, copy {task.copy}: {summary}")
    return scores, times.rate


def copied(path: Path, copy: int, work: Path) -> Path:
    """The keypoints of one camera with every coordinate moved at random by at most half of `ROUNDING_PX` and rounded to
    it, in a file of `work`; the file itself for copy 0. All views have the same copies."""
    if copy == 0:
        return path
    content = json_module.loads(path.read_text(encoding="utf-8"))
    rng = np.random.default_rng((copy, *path.stem.encode()))
    for frame in content["frames"]:
        if frame["keypoints"]:
            keypoints = np.array(frame["keypoints"])
            moved = keypoints[:, :2] + rng.uniform(-0.5, 0.5, (len(keypoints), 2)) * ROUNDING_PX
            keypoints[:, :2] = np.round(moved / ROUNDING_PX) * ROUNDING_PX
            frame["keypoints"] = keypoints.round(3).tolist()
    made = work / f"{path.parent.name}_{path.stem}_{copy}.json"
    with replacing(made) as temporary:
        temporary.write_text(json_module.dumps(content), encoding="utf-8")
    return made


def first_frame_of(path: Path, work: Path) -> Path:
    """The keypoints of the first frame of a file, and none in the others, in a file of `work`."""
    content = json_module.loads(path.read_text(encoding="utf-8"))
    content["frames"] = [{**frame, "keypoints": None} if i else frame for i, frame in enumerate(content["frames"])]
    made = work / f"first_{path.parent.name}_{path.stem}.json"
    with replacing(made) as temporary:
        temporary.write_text(json_module.dumps(content), encoding="utf-8")
    return made


def main(
    *,
    data: Data = None,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    copies: Annotated[tuple[int, ...], Several] = (0,),
    views: Annotated[tuple[str, ...], Several] = (*CAMERAS, TOGETHER),
    cues: Annotated[bool, Parameter(negative="")] = False,
    pictures: str = "",
    tracker: str = "css",
    modes: int | None = None,
    keypoints: str = "keypoints",
    subject: str = "human34",
    masks: Path | None = None,
    floor: float | None = None,
    changes: Changes = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track beam4cam from each camera alone and from all four, against its reference.

    Parameters
    ----------
    seeds
        Seeds of the tracker.
    copies
        Copies of the keypoints: 0 unchanged, others moved at random by at most 0.05 px and rounded to 0.1 px.
    views
        Cameras to track from alone, several joined by "+" (cam01+cam03), and "four" for all together.
    cues
        Track from each camera alone with keypoints, with one cue of the pictures besides, and with all of them.
    pictures
        Cues, separated by commas: track from the keypoints of the first frame and by these alone after it.
    tracker, modes
        As in `kinemode track`.
    keypoints
        keypoints, or keypoints_multicrop for the cleaner ones; none for the pictures alone, the subject as it is, with
        a tracker that can.
    subject
        A built-in name, fitted to the keypoints where there are any, or a URDF file that `kinemode fit` wrote.
    masks
        A folder of the person's masks, cam01/00000.png and so on or cam01.mp4, where the silhouette is used;
        without it a background is learned from the clip.
    floor
        Its height in the cameras' world [m], where it is given.
    changes
        Changes to the settings, as cost.nu=8 css.scale=4.
    jobs
        Runs at a time, each in a process of its own.
    """
    folder, settings = beam_folder(data), nested(changes)
    how: dict[str, Any] = {"tracker": tracker, "modes": modes, "settings": settings, "subject": subject}
    alone = ",".join(cue_choice(pictures) or ()) if pictures else ""
    how |= {} if floor is None else {"floor": floor}
    runs = [(seed, copy) for seed in seeds for copy in copies]
    shown = checked(views, CAMERAS if cues else (*CAMERAS, TOGETHER))
    with work_folder(work) as kept:
        tasks = [
            Task(view, cue, seed, copy, folder, keypoints, kept, masks, how, alone)
            for cue in (CUES if cues else (ALONE,))
            for view in shown
            for seed, copy in runs
        ]
        results = in_processes(tracked, tasks, jobs)
    by_cues: dict[str, dict[str, list[Result]]] = {}
    for task, result in zip(tasks, results, strict=True):
        by_cues.setdefault(task.cues, {}).setdefault(task.view, []).append(result)
    if cues:
        print_cues(by_cues, len(runs))
        save(json, {"measure": "beam4cam cues", "cues": {c: figures(f, runs, how) for c, f in by_cues.items()}})
    else:
        print_table(by_cues[ALONE], len(runs))
        save(json, {"measure": "beam4cam", "pictures": alone, **figures(by_cues[ALONE], runs, how)})


def checked(views: tuple[str, ...], valid: tuple[str, ...]) -> tuple[str, ...]:
    """Those of the views that are valid here; raises InputError for an unknown one, or if none is left."""
    unknown = [view for view in views if not set(cameras_of(view)) <= set(CAMERAS)]
    chosen = tuple(view for view in views if view in valid or (TOGETHER in valid and len(cameras_of(view)) > 1))
    if unknown or not chosen:
        raise InputError(
            "--views", f"there is no {', '.join(unknown) or TOGETHER}", remedy=f"some of {', '.join(valid)}"
        )
    return chosen


def print_table(by_view: dict[str, list[Result]], runs: int) -> None:
    made = report.table(f"beam4cam, means over {runs} run(s) of a view", "view", *COLUMNS, "learned", "PA   ")
    for view, results in by_view.items():
        learned = [f"{x:.0f}" for x in LEARNED.get(view, ())] or ["", ""]
        made.add_row(
            view, *cells(mean_scores(s for s, _ in results), float(np.median([r for _, r in results]))), *learned
        )
    alone = [result for view, results in by_view.items() if view in CAMERAS for result in results]
    if alone:
        rate = float(np.median([r for _, r in alone]))
        made.add_section()
        made.add_row("mean alone", *cells(mean_scores(s for s, _ in alone), rate), *(f"{x:.1f}" for x in LEARNED_MEAN))
    out = report.console()
    out.width = max(out.width, 180)
    out.print(made)
    out.print(LEGEND)
    for view, results in by_view.items():
        worst, far = max(s.worst for s, _ in results), max(s.far for s, _ in results)
        out.print(f"{view}: {worst:.1f} mm in the worst frame, {far} over {FAR_MM:.0f} mm")
    if runs > 1:
        print_spread(by_view)
    if TOGETHER in by_view:
        worst = max(s.mpjpe for s, _ in by_view[TOGETHER])
        out.print(f"four cameras: {worst:.1f} mm in the worst run, target at most {TOGETHER_TARGET:.0f} mm")


def print_spread(by_view: dict[str, list[Result]]) -> None:
    """Mean and standard deviation over the runs of a view, and of the mean of the cameras."""
    made = report.table("mean and standard deviation over runs [mm]", "view", *SPREAD.values())
    errors = {v: np.array([[getattr(s, name) for name in SPREAD] for s, _ in of]) for v, of in by_view.items()}
    alone = [of for view, of in errors.items() if view in CAMERAS]
    if len(alone) > 1:
        errors["mean alone"] = np.mean(alone, axis=0)
    for view, of in errors.items():
        rows = zip(of.mean(axis=0), of.std(axis=0, ddof=1), strict=True)
        made.add_row(view, *(f"{mean:.1f} +- {deviation:.1f}" for mean, deviation in rows))
    report.console().print(made)


def print_cues(by_cues: dict[str, dict[str, list[Result]]], runs: int) -> None:
    """MPJPE and PA-MPJPE of every camera, with each cue beside the keypoints."""
    means = {
        cue: {view: mean_scores(s for s, _ in results) for view, results in of.items()} for cue, of in by_cues.items()
    }
    views = list(means[ALONE])
    title = f"beam4cam, {runs} run(s), one camera: MPJPE, PA-MPJPE [mm], frames per second"
    made = report.table(title, "keypoints and", *views, "mean", "fps")
    for cue, of in means.items():
        mean = mean_scores(of.values())
        rate = float(np.median([r for results in by_cues[cue].values() for _, r in results]))
        made.add_row(cue, *(f"{s.mpjpe:.1f}, {s.pa:.1f}" for s in (*of.values(), mean)), f"{rate:.1f}")
    out = report.console()
    out.print(made)
    out.print("over the 12 limb joints; MPJPE: hips aligned; PA: after the best similarity")
    for field, name in (("mpjpe", "MPJPE"), ("pa", "PA-MPJPE")):
        better = sum(getattr(means[ALL][v], field) < getattr(means[ALONE][v], field) for v in views)
        out.print(f"{ALL} is better than {ALONE} in {better} of {len(views)} cameras by {name}")


def figures(by_view: dict[str, list[Result]], runs: list[tuple[int, int]], how: dict[str, Any]) -> dict[str, Any]:
    alone = [s for view, results in by_view.items() if view in CAMERAS for s, _ in results]
    return {
        "tracker": how["tracker"],
        "settings": how["settings"],
        "subject": how["subject"],
        "views": {
            view: [
                {"seed": seed, "copy": copy, "fps": rate, **asdict(s)}
                for (seed, copy), (s, rate) in zip(runs, results, strict=True)
            ]
            for view, results in by_view.items()
        },
        "mean_alone": asdict(mean_scores(alone)) if alone else None,
        "learned": {**LEARNED, "mean": LEARNED_MEAN},
    }
