"""Several trackers on one clip: their runs, times and scores, as files and as the report that is printed."""

from __future__ import annotations

import csv
import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from estimator.runs.evaluation import FAR, FAR_PX, FAR_PX_SIZE
from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.tracking.registry import common_settings, make_tracker
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject, is_built_in
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode import jobs
from kinemode.findings import status_meanings
from kinemode.indexing import beginning, index_unused, uses_index
from kinemode.notices import InputWarning
from kinemode.option import shared
from kinemode.request import BY_INDEX, CompareRequest, FileOptions, TrackRequest
from kinemode.scores import Course, TimeFile, TrackerScore, courses, scored
from kinemode.settings import choose, choose_for_all, loaded_changes
from kinemode.target import check_absent, made_folder
from kinemode.terminal.interruption import kept_if_interrupted
from kinemode.terminal.report import console, millimetres, table
from viz.pictures.plot import Curve, MeasurePanel, Plot, write_plot

UNITS = {"fps": "1/s", "residual": "px"} | dict.fromkeys(("mpjpe", "pa_mpjpe", "best_of_k", "final_mpjpe"), "m")
ENOUGH = 0.5  # share of frames with keypoints from which the distance to them is worth a plot


def write_comparison(
    folder: Path, scores: Sequence[TrackerScore], courses: Mapping[str, Course]
) -> tuple[Path, Path, Path]:
    """Write compare.csv, one row a tracker, compare.json, which also has every frame, and compare.png: their paths."""
    table, figures, plot = (folder / f"compare.{suffix}" for suffix in ("csv", "json", "png"))
    with replacing(table) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow([f"{f.name} [{UNITS[f.name]}]" if f.name in UNITS else f.name for f in fields(TrackerScore)])
        rows.writerows([["" if _unknown(v) else v for v in asdict(score).values()] for score in scores])
    every = {s.tracker: asdict(s) | {"course": asdict(courses[s.tracker])} for s in scores}
    with replacing(figures) as temporary:
        temporary.write_text(json.dumps(_plain(every), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with replacing(plot) as temporary:
        write_plot(plotted(scores, courses), temporary)
    return table, figures, plot


def plotted(scores: Sequence[TrackerScore], courses: Mapping[str, Course]) -> Plot:
    """The errors over time by which poses are lost: in the world and in the image where reference and cameras share one
    world, else the aligned one. Without a reference the distance to the keypoints, and where few frames have them the
    energy."""
    courses = {score.tracker: courses[score.tracker] for score in scores}
    residuals = np.concatenate([course.residual for course in courses.values()])
    if any(course.placed for course in courses.values()):
        limit = min(course.pixel_limit for course in courses.values())
        panels = [
            _panel("mean error in the world [mm]", courses, lambda c: 1e3 * c.world_error, 1e3 * FAR),
            _panel("mean error in the image [px]", courses, lambda c: c.pixel_error, limit),
        ]
    elif any(np.isfinite(course.error).any() for course in courses.values()):
        aligned = next(iter(courses.values())).aligned
        panels = [_panel(f"mean error, {aligned} [mm]", courses, lambda c: 1e3 * c.error, 1e3 * FAR)]
    elif np.isfinite(residuals).mean() >= ENOUGH:
        panels = [_panel("mean distance from the keypoints [px]", courses, lambda c: c.residual)]
    else:
        panels = [_panel("energy of the pose", courses, lambda c: c.energy)]
    return Plot("best hypothesis of each frame, as it was tracked", panels)


def _panel(
    label: str, courses: Mapping[str, Course], value: Callable[[Course], np.ndarray], limit: float | None = None
) -> MeasurePanel:
    """One measure of all trackers. A frame is lost by this one where its value is beyond the limit, or where it is lost
    and has no value."""
    curves = []
    for name, course in courses.items():
        values = value(course)
        lost = np.zeros(len(values), dtype=bool) if limit is None else course.lost & ~(values <= limit)
        starts = lost & ~np.concatenate([[False], lost[:-1]])
        curves.append(Curve(name, course.time, values, tuple(course.time[starts].tolist())))
    return MeasurePanel(label, curves, limit)


def _unknown(value: object) -> bool:
    return value is None or (isinstance(value, float) and not np.isfinite(value))


def _plain(value: Any) -> Any:
    """JSON values; non-finite numbers become null."""
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    if isinstance(value, np.ndarray):
        return [_plain(v) for v in value.tolist()]
    return None if _unknown(value) else value


@dataclass(frozen=True)
class Comparison:
    """Several trackers on one clip, in the requested order.

    scores, courses, runs: of each tracker. table, figures, plot: the files written, CSV, JSON and PNG.
    """

    scores: tuple[TrackerScore, ...]
    courses: Mapping[str, Course]
    runs: Mapping[str, Run]
    table: Path
    figures: Path
    plot: Path


def compare_trackers(loaded: Subject, files: FileOptions, request: CompareRequest) -> Comparison:
    """The work of `kinemode.compare` after its arguments are checked; files: read in place of those that the request
    has."""
    names, out = tracker_names(request.trackers), Path(request.out)
    wanted, known = shared(request, TrackRequest), jobs.Known()
    runs_at = {name: out / f"{name}.run" for name in names}
    order = sorted(names, key=lambda n: not runs_at[n].exists())  # existing runs have the person's subject
    # the settings are checked before the first is tracked
    fits = wanted.fit != "off" and is_built_in(loaded)
    chosen = choose_for_all(order, wanted.settings, wanted.modes, fits)
    start = BY_INDEX if request.begins_by_index else None
    each = {name: beginning(choose(name, *chosen[name]), start) for name in names}
    body = Body(loaded)
    for name, how_chosen in each.items():
        make_tracker(name, body, how_chosen.settings)
    looking = {name for name in names if uses_index(each[name])}
    if wanted.index is not None and not looking:
        raise index_unused(each[names[0]])
    compared_by = common_settings(*loaded_changes(wanted.settings))
    reference = request.reference
    truth = Reference.load(reference) if isinstance(reference, (str, Path)) else reference
    made_folder(out)
    remedy = "--resume continues the runs that are there, --overwrite replaces them"
    check_absent(list(runs_at.values()), wanted.resume, wanted.overwrite, remedy)
    times = TimeFile(out / "times.json")
    runs: dict[str, Run] = {}

    def frames_so_far() -> int | None:
        return sum(map(len, runs.values())) if runs else None

    for name in order:
        if wanted.overwrite or not runs_at[name].exists():
            times.clear(name)
        with kept_if_interrupted(frames_so_far), warnings.catch_warnings():
            if runs:  # the input is the same: its warnings were given
                warnings.simplefilter("ignore", InputWarning)
            own, count = chosen[name]
            progress = times.clocked(name, request.reporter)
            how = replace(
                wanted, tracker=name, modes=count, settings=own, out=runs_at[name],
                progress=progress, index=wanted.index if name in looking else None,
            )  # fmt: skip
            runs[name] = jobs.track_subject(loaded, files, how, known)
        loaded = runs[name].subject  # fitted now, and not again
        wanted = replace(wanted, height=None)
        known = jobs.Known(runs[name].estimates or {}, runs[name].observation(0).noise)
    runs = {name: runs[name] for name in names}
    if truth is not None:
        truth = truth.in_world_of(runs[names[0]].header.R_upright_given)
    with kept_if_interrupted(frames_so_far), threadpool_limits(limits=1), request.reporter("comparing") as looked:
        by_name = courses(runs, compared_by, truth, files.world_given, looked)
    scores = tuple(scored(name, runs[name], by_name[name], times.of(name), truth) for name in names)
    return Comparison(scores, by_name, runs, *write_comparison(out, scores, by_name))


def tracker_names(given: str | Iterable[str]) -> tuple[str, ...]:
    """The requested trackers, each once, in their order; raises InputError where there are none."""
    listed = given.split(",") if isinstance(given, str) else [part for text in given for part in text.split(",")]
    names = tuple(dict.fromkeys(name.strip() for name in listed if name.strip()))
    if not names:
        raise InputError("trackers", "none is named", remedy="their names with commas between them")
    return names


COLUMNS = ("frames/s", "hard", "unobserved", "energy", "residual [px]")
ERRORS = ("MPJPE", "PA-MPJPE", "best of K", "final MPJPE", "lost", "first lost")
LEGEND = (
    "All but best of K and final MPJPE: the best hypothesis of each frame as it was tracked.\n"
    "energy: mean of its pose by the cost of css for every tracker, without the past. residual: mean distance"
    " from the keypoints."
)
LEGEND_OF_ERRORS = (
    "final: the trajectory the run ends with, which css smooths. lost: frames with the joints on average over"
    f" {1e3 * FAR:.0f} mm from the reference, or {FAR_PX:.0f} px in a picture of {FAR_PX_SIZE[0]} x {FAR_PX_SIZE[1]},"
    " as much of the diagonal of others; with a guessed camera over the former, hips aligned. best of K: the nearest of"
    " each frame's K hypotheses."
)


def print_comparison(compared: Comparison) -> None:
    """One row per tracker: speed, certainty, distance from keypoints and reference; and its files."""
    known = any(np.isfinite(s.mpjpe) for s in compared.scores)
    title = f"{compared.scores[0].frames} frames" + (", errors [mm]" if known else "")
    made = table(title, "tracker", *COLUMNS, *(ERRORS if known else ()))
    for score in compared.scores:
        made.add_row(score.tracker, *_cells(score), *(_errors(score) if known else ()))
    out = console()
    out.print(made)
    out.print(LEGEND, soft_wrap=True)
    for line in status_meanings(COLUMNS):
        out.print(line, soft_wrap=True)
    if known:
        out.print(LEGEND_OF_ERRORS, soft_wrap=True)
    for path in (compared.table, compared.figures, compared.plot):
        out.print(str(path), soft_wrap=True)


def _cells(s: TrackerScore) -> list[str]:
    return [_number(s.fps), str(s.hard), str(s.unobserved), _number(s.energy), _number(s.residual)]


def _errors(s: TrackerScore) -> list[str]:
    lengths = [millimetres(e) for e in (s.mpjpe, s.pa_mpjpe, s.best_of_k, s.final_mpjpe)]
    return [*lengths, str(s.lost), "-" if s.first_lost is None else f"frame {s.first_lost}"]


def _number(value: float) -> str:
    return "-" if not np.isfinite(value) else f"{value:.1f}"
