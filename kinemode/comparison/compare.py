"""Several trackers on one clip: their runs, a table and a plot."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from estimator.runs.reference_motion import Reference
from estimator.runs.run_reader import Run
from estimator.tracking.registry import common_settings, make_tracker
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject, is_built_in
from humanoid.support.errors import InputError
from kinemode import jobs
from kinemode.comparison.files import write_comparison
from kinemode.comparison.scores import Course, TrackerScore, courses, scored
from kinemode.comparison.times import TimeFile
from kinemode.indexing import beginning, index_unused, uses_index
from kinemode.notices import InputWarning
from kinemode.option import shared
from kinemode.request import BY_INDEX, CompareRequest, FileOptions, TrackRequest
from kinemode.settings import choose, choose_for_all, loaded_changes
from kinemode.target import check_absent, made_folder
from kinemode.terminal.interruption import kept_if_interrupted


@dataclass(frozen=True)
class Comparison:
    """Several trackers on one clip, in the order they were asked for.

    scores, courses, runs: of each tracker. table, figures, plot: the files written, CSV, JSON and PNG.
    """

    scores: tuple[TrackerScore, ...]
    courses: Mapping[str, Course]
    runs: Mapping[str, Run]
    table: Path
    figures: Path
    plot: Path


def compare_trackers(loaded: Subject, files: FileOptions, request: CompareRequest) -> Comparison:
    """What `kinemode.compare` does once its arguments are checked; files: what is read, in place of what the request
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
    """The trackers that are asked for, each once, in their order; raises InputError where there are none."""
    listed = given.split(",") if isinstance(given, str) else [part for text in given for part in text.split(",")]
    names = tuple(dict.fromkeys(name.strip() for name in listed if name.strip()))
    if not names:
        raise InputError("trackers", "none is named", remedy="their names with commas between them")
    return names
