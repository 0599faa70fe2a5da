"""Several trackers on one clip: their runs, a table and a plot."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from estimator.results.evaluation import Reference
from estimator.results.run_file import Run
from estimator.tracking.registry import common_settings
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode import api
from kinemode.arguments import check_arguments
from kinemode.comparison_files import write_comparison
from kinemode.comparison_scores import Course, TrackerScore, courses, scored
from kinemode.comparison_times import TimeFile
from kinemode.interruption import kept_if_interrupted
from kinemode.named import Named, PathLike
from kinemode.progress import Reporter, unreported
from kinemode.render_files import made_folder
from kinemode.settings import choose_for_all, former_names_in, loaded_changes


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


def compare(
    subject: api.SubjectLike,
    clips: Named,
    *,
    trackers: str | Iterable[str],
    out: PathLike,
    reference: PathLike | None = None,
    cameras: api.Cameras = None,
    modes: int | None = None,
    settings: Mapping[str, Any] | PathLike | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Reporter | None = None,
    **how: Any,
) -> Comparison:
    """Track one clip with several trackers and compare them; the subject is fitted once, for all of them.

    Parameters
    ----------
    subject, clips, cameras, modes, settings, progress, how: as `kinemode.track` takes them; `how` is whatever else it
        takes of keypoints, cues, masks, background, seed, fit, person, keypoint_size, fps, offset, start and end.
    trackers: names, or one text with commas between them.
    out: folder, made if it is not there, for the runs (NAME.run) and for compare.csv, compare.json and compare.png.
    reference: known 3D landmarks (see `kinemode.evaluate`); in the world of `cameras` where these are given.
    resume: go on with the runs that are there. overwrite: replace them.

    Raises
    ------
    InputError: as `track` does; an unknown tracker; runs that are there, unasked.
    """
    check_arguments(
        subject=subject, clips=clips, trackers=trackers, out=out, reference=reference, cameras=cameras, modes=modes,
        settings=settings, resume=resume, overwrite=overwrite, progress=progress, fit=how.get("fit", "auto"),
        workers=how.get("workers", 1),
    )  # fmt: skip
    names = tracker_names(trackers)
    tracked = subject if isinstance(subject, api.Subject) else load_subject(subject)
    fits = how.get("fit", "auto") != "off" and api.is_built_in(tracked)
    files = {name: Path(out) / f"{name}.run" for name in names}
    order = sorted(names, key=lambda n: not files[n].exists())  # runs that are there say who the person is
    # whatever is wrong with the settings is said before the first is tracked
    chosen = choose_for_all(order, settings, modes, how.pop("workers", 1), fits)
    for sentence in former_names_in(names, settings):
        warnings.warn(sentence, api.InputWarning, stacklevel=2)
    compared_by = common_settings(*loaded_changes(settings))
    truth = None if reference is None else Reference.load(reference)
    folder = made_folder(Path(out))
    _check_runs(files.values(), resume, overwrite)
    report = progress or unreported
    times = TimeFile(folder / "times.json")
    runs: dict[str, Run] = {}

    def tracked_frames() -> int | None:
        return sum(map(len, runs.values())) if runs else None

    for name in order:
        if overwrite or not files[name].exists():
            times.clear(name)
        with kept_if_interrupted(tracked_frames), warnings.catch_warnings():
            if runs:  # the input is the same: what is odd about it has been said
                warnings.simplefilter("ignore", api.InputWarning)
            own, count, workers = chosen[name]
            runs[name] = api.track(
                tracked, clips, tracker=name, cameras=cameras, modes=count, settings=own, out=files[name],
                resume=resume, overwrite=overwrite, workers=workers, progress=times.clocked(name, report), **how,
            )  # fmt: skip
        tracked = runs[name].subject  # fitted now, and not again
    runs = {name: runs[name] for name in names}
    with kept_if_interrupted(tracked_frames), threadpool_limits(limits=1), report("comparing") as looked:
        found = courses(runs, compared_by, truth, cameras is not None, looked)
    scores = tuple(scored(name, runs[name], found[name], times.of(name), truth) for name in names)
    return Comparison(scores, found, runs, *write_comparison(folder, scores, found))


def tracker_names(given: str | Iterable[str]) -> tuple[str, ...]:
    """The trackers that are asked for, each once, in their order; raises InputError where there are none."""
    listed = given.split(",") if isinstance(given, str) else [part for text in given for part in text.split(",")]
    names = tuple(dict.fromkeys(name.strip() for name in listed if name.strip()))
    if not names:
        raise InputError("trackers", "none is named", remedy="their names with commas between them")
    return names


def _check_runs(files: Iterable[Path], resume: bool, overwrite: bool) -> None:
    present = next((file for file in files if file.exists()), None)
    if present is None:
        return
    if resume and overwrite:
        raise InputError(present, "cannot be resumed and overwritten", remedy="choose one")
    if not (resume or overwrite):
        remedy = "--resume goes on with the runs that are there, --overwrite replaces them"
        raise InputError(present, "exists already", remedy=remedy)
