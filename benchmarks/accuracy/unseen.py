"""Captured people left out of learning, seen by one camera: the value of the prior for unseen people.

Clips and keypoints are those of `python -m benchmarks pose_prior --track`; a second kind of keypoints has the twelve
limb joints alone. The prior is learned from all people but the tracked one.
"""

from __future__ import annotations

import json as json_module
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from benchmarks.accuracy.unseen_clips import (
    ANGLES,
    KINDS,
    TURNS,
    FrameErrors,
    UnseenRun,
    action_of,
    turn_bins,
)
from benchmarks.support.common import (
    Data,
    Json,
    Several,
    Work,
    check_known,
    in_processes,
    save,
    work_folder,
)
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, spread_of, subject_of, windows_of
from benchmarks.support.result_store import Figures, ResultStore, all_done
from benchmarks.training.pose_prior import prior_settings
from estimator.data.formats.settings_file import load_settings
from estimator.synthesis.mocap import load_mocap
from humanoid.support.errors import InputError
from kinemode.settings import choose
from kinemode.terminal import report

SHIPPED = "shipped"
TARGETS = {"aligned": 95.0, "pa": 66.0, "far": 0.01, "angles": 9.0, "spikes": 0.0}
COLUMNS = {
    "aligned": "hips aligned [mm]", "pa": "PA [mm]", "far": "over 250 mm", "angles": "angles [deg]", "hips": "hips",
    "knees": "knees", "elbows": "elbows",
    "spikes": "spikes",
}  # fmt: skip
LEGEND = (
    "smoothed trajectories. hips aligned, PA: mean error of the limb joints; over 250 mm: share of frames with the hips"
    " aligned, those without a pose among them.",
    f"angles: mean absolute error of {', '.join(ANGLES)}; the captured skeleton has no other joints' angles.",
    "spikes: joints that leave for a frame, over 12 cm off the mean of the frames beside it, the truth under 4 cm.",
    "turning: of the true pelvis' heading, deg/s. Clips and actions are means of clips, turning is of frames.",
)
Means = dict[str, float]


def main(
    *,
    data: Data = None,
    kinds: Annotated[tuple[str, ...], Several] = KINDS,
    clips: int = 1,
    windows: int = 1,
    seconds: float = 2.0,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    settings: Annotated[tuple[Path, ...], Parameter(consume_multiple=True, negative="")] = (),
    jobs: int = 1,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track captured clips of every person with the prior learned from the others, from one camera's keypoints.

    Parameters
    ----------
    kinds
        Of keypoints: detector (COCO's 17, 5 px, 5 % outliers, 10 % missing), joints (12 limb joints, 3 px).
    clips
        So many of each person.
    windows
        At most so many parts of each clip, `seconds` long, spread over it without overlapping.
    seconds
        At most so much of each.
    seeds
        Of the clips' noise and of the tracker.
    settings
        TOML files of settings, each tracked on the same clips as the shipped ones, and the differences.
    jobs
        Clips tracked at a time, each in a process of its own.
    """
    kinds = tuple(kind for word in kinds for kind in word.split(","))
    check_known("--kinds", kinds, KINDS)
    for option, count in (("--clips", clips), ("--windows", windows)):
        if count < 1:
            raise InputError(option, f"must be 1 or more, got {count}")
    for option, given in (("--kinds", kinds), ("--seeds", seeds)):
        if not given:
            raise InputError(option, "names none", remedy="one or more")
    variants = {SHIPPED: {}, **{str(path): variant(path) for path in settings}}
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    chosen = spread_of(files, clips)
    starts = [windows_of(load_mocap(f).seconds, seconds, windows) for f in chosen]
    with work_folder(work) as folder:
        own = prior_settings("unseen", [f.stem for f in chosen], data, {}, folder / "priors")
        runs = {
            (name, kind): [
                UnseenRun(
                    f, seconds, seed, kind, json_module.dumps(changes, sort_keys=True),
                    Path(prior["cost"]["pose_prior_file"]), folder / "clips", start,
                )
                for f, prior, begins in zip(chosen, own, starts, strict=True)
                for start in begins
                for seed in seeds
            ]
            for name, changes in variants.items()
            for kind in kinds
        }  # fmt: skip
        pieces, store = [run for of in runs.values() for run in of], ResultStore(folder)
        in_processes(UnseenRun.prepare, list({(run.clip, run.seed): run for run in pieces}.values()), jobs)
        results = dict(zip(pieces, all_done("unseen people", store, pieces, jobs), strict=True))
        codes = len(store.codes(pieces))
    tables = {key: means_of([(run, results[run]) for run in of]) for key, of in runs.items()}
    show(tables)
    report.print_lines(
        [f"{key[1]}, settings {key[0]}: {spikes_in([results[r] for r in of])}" for key, of in runs.items()]
    )
    report.print_lines([*LEGEND, *([] if codes == 1 else [f"the runs are of {codes} states of the code"])])
    figures = [{"settings": name, "keypoints": kind, **tables[name, kind]} for name, kind in tables]
    how = {"clips": clips, "windows": windows, "seconds": seconds, "seeds": seeds, "settings": variants, "codes": codes}
    save(json, {"measure": "unseen", "how": how, "targets": TARGETS, "rows": figures})


def spikes_in(tracks: Sequence[Figures]) -> str:
    """How many there are in all, see `FrameErrors`."""
    count = sum(np.nansum(np.array(track["spikes"], dtype=float)) for track in tracks)
    return f"{count:.0f} spikes in {len(tracks)} tracks"


def variant(path: Path) -> dict[str, Any]:
    """The changes to css's settings in a file; raises InputError where there are none, or where they name a prior."""
    choose("css", path)
    changes = load_settings(path)
    if "pose_prior_file" in changes.get("cost", {}):
        problem = "the prior is that of all people but the tracked one"
        raise InputError(path, problem, place="cost.pose_prior_file", remedy="leave it out")
    return changes


def means_of(done: Sequence[tuple[UnseenRun, Figures]]) -> dict[str, dict[str, Means]]:
    """Mean errors `by clip`, of its seeds; `by person`, `by action` and of `all`, of their clips; `by turning`, of
    frames; and of the clips' other trajectories, `tracks`."""
    frames = [FrameErrors(*(np.array(result[name]) for name in FrameErrors._fields)) for _, result in done]
    names = [run.clip for run, _ in done]
    clips = {
        name: mean([errors.means() for own, errors in zip(names, frames, strict=True) if own == name])
        for name in dict.fromkeys(names)
    }

    def by(group: Callable[[str], str]) -> dict[str, Means]:
        groups = {name: group(_file(name)) for name in clips}
        return {of: mean([clips[n] for n in clips if groups[n] == of]) for of in dict.fromkeys(groups.values())}

    joined = FrameErrors.joined(frames)
    bins = turn_bins(joined.rate)
    tracks = {
        name: mean([{key: result["tracks"][name][key] for key in ("aligned", "pa")} for _, result in done])
        for name in done[0][1]["tracks"]
    }
    return {
        "by clip": clips, "by person": by(subject_of), "by action": by(action_of),
        "by turning": {
            name: {**joined.at(bins == k).means(), "frames": float(np.sum(bins == k))}
            for k, name in enumerate(TURNS)
            if np.any(bins == k)
        },
        "tracks": tracks, "all": {"clips": mean(list(clips.values()))},
    }  # fmt: skip


def _file(clip: str) -> str:
    """The name of the file that a clip is of, see `UnseenRun.clip`."""
    return clip.partition(" ")[0]


def mean(several: Sequence[Means]) -> Means:
    """Of each of their values."""
    return {name: float(np.mean([means[name] for means in several])) for name in several[0]}


def show(tables: Mapping[tuple[str, str], dict[str, dict[str, Means]]]) -> None:
    """A table of every kind and settings, and the differences from those shipped on the same clips."""
    out = report.console()
    for (name, kind), of in tables.items():
        made = report.table(f"{kind}, settings {name}", "", *COLUMNS.values())
        clips = {f"{subject_of(_file(n))}: {n}, {action_of(_file(n))}": means for n, means in of["by clip"].items()}
        persons = {f"person {n}": means for n, means in of["by person"].items()}
        actions = {f"action: {n}": means for n, means in of["by action"].items()}
        turns = {f"turning {n} deg/s, {m['frames']:.0f} frames": m for n, m in of["by turning"].items()}
        for section in (clips, persons if len(persons) < len(clips) else {}, actions, turns):
            for label, means in section.items():
                made.add_row(label, *(cell(key, means[key]) for key in COLUMNS))
            made.add_section()
        for label, means in of["tracks"].items():
            if label != "smoothed":
                made.add_row(f"mean, {label}", cell("aligned", means["aligned"]), cell("pa", means["pa"]))
        whole = of["all"]["clips"]
        made.add_row("mean of clips", *(cell(key, whole[key]) for key in COLUMNS))
        made.add_row("target, at most", *(cell(key, TARGETS[key]) if key in TARGETS else "" for key in COLUMNS))
        out.print(made)
    for (name, kind), of in tables.items():
        if name != SHIPPED:
            made = report.table(
                f"{kind}, {name} less shipped, mean of clips and its standard error", "", *COLUMNS.values()
            )
            before = tables[SHIPPED, kind]["by clip"]
            cells = [paired_cell(key, before, of["by clip"]) for key in COLUMNS]
            made.add_row("difference", *cells)
            out.print(made)


def cell(key: str, value: float) -> str:
    """A mean error as a table has it."""
    return f"{value:.1%}" if key == "far" else f"{value:.1f}"


def paired_cell(key: str, before: Mapping[str, Means], after: Mapping[str, Means]) -> str:
    """Mean difference of the same clips and its standard error."""
    less = np.array([after[name][key] - before[name][key] for name in before])
    error = less.std(ddof=1) / np.sqrt(len(less)) if len(less) > 1 else float("nan")
    return f"{cell(key, float(less.mean()))} ± {cell(key, float(error))}"
