"""`track`, `fit` and `compare`: requests are checked before the libraries that do the work are loaded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinemode.checks import check_together
from kinemode.inputs.arrays import Spool
from kinemode.inputs.declared import wants_all
from kinemode.named import kept
from kinemode.notices import warn
from kinemode.option import shared, takes
from kinemode.public.detection import with_detected
from kinemode.request import CheckRequest, CompareRequest, FileOptions, FitRequest, RigRequest, TrackRequest
from kinemode.target import RunTarget, check_folder

if TYPE_CHECKING:
    from estimator.fitting.fit import Fit
    from estimator.runs.run_reader import Run
    from humanoid.subject.subject import Subject
    from kinemode.comparison import Comparison
    from kinemode.named import PathLike
    from kinemode.request import SubjectLike


@takes(TrackRequest)
def track(request: TrackRequest) -> Run | Any:
    """Track a subject through one clip, or several synchronised ones, into a run file.

    Returns the run; with person="all" a dict of the runs by "person1", "person2", ..., the largest first, each from
    when the person is first seen to the last. Who cannot be tracked is left out, with a warning.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: anything that is wrong with the input, a changed setting without effect included.
    """
    if request.out is not None and not wants_all(request.person):
        RunTarget(Path(request.out), request.resume, request.overwrite).check()
    with reading(request, request.out) as (files, folder):
        loaded = loaded_subject(request.subject)
        return _work(request)(loaded, files, replace(request, out=request.out or folder))


@takes(FitRequest)
def fit(request: FitRequest) -> Fit:
    """Fit a subject to the person in the first frames of a clip; `out` is written as a URDF that loads again.

    Proportions are fitted to the keypoints, and where edges or silhouettes are used the flesh to them; with points to
    these, and the markers' places with them, which the URDF then has.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: as `track` does, and where there is nothing to fit.
    """
    if request.out is not None:
        check_folder(Path(request.out))
    with reading(request, request.out) as (files, _):
        loaded = loaded_subject(request.subject)
        if request.points is not None:
            from kinemode.fits import fit_to_points

            return fit_to_points(loaded, request)
        from kinemode.fits import fit_subject

        return fit_subject(loaded, files, request)


@takes(CompareRequest)
def compare(request: CompareRequest) -> Comparison:
    """Track one clip with several trackers and compare them; the subject is fitted once, for all of them.

    The folder `out` is made if it is not there; it has the runs (NAME.run) and compare.csv, compare.json and
    compare.png. Keypoints that are detected go into OUT/compare.keypoints.

    Parameters
    ----------
    OPTIONS

    Raises
    ------
    InputError: as `track` does; an unknown tracker; existing runs, without `resume` or `overwrite`.
    """
    with reading(request, Path(request.out) / "compare") as (files, _):
        loaded = loaded_subject(request.subject)
        from kinemode.comparison import compare_trackers

        return compare_trackers(loaded, files, request)


@contextmanager
def reading(
    request: TrackRequest | FitRequest | CompareRequest | RigRequest | CheckRequest, out: PathLike | None, **more: Any
) -> Iterator[tuple[FileOptions, PathLike | None]]:
    """The input of tracking as checked files, with detected keypoints; and where a run then
    goes for which no file is named: beside pictures that were written here, which it keeps. more: options that are not
    of the request. Errors name the arguments."""
    spool = Spool(request.clips, request.keypoints, request.layout)
    written: dict[str, Any] = {"clips": kept(spool.clips), "keypoints": kept(spool.keypoints)}
    written["layout"] = spool.file_layout
    check_together(replace(request, **written))
    files = shared(request, FileOptions, **written, **more)
    with spool.telling(), with_detected(files, out, request.reporter) as detected:
        yield detected, spool.run_path(None)


def _work(request: TrackRequest) -> Callable[..., Run | dict[str, Run]]:
    """The job that tracks one person, all people, or points."""
    from kinemode import jobs

    if request.points is not None:
        return lambda loaded, _, wanted: jobs.track_points(loaded, wanted)
    return jobs.track_everybody if wants_all(request.person) else jobs.track_subject


def loaded_subject(subject: SubjectLike) -> Subject:
    """A subject unchanged, or loaded from its name or path; raises InputError where there is none."""
    from humanoid.subject.subject import Subject, load_subject

    return subject if isinstance(subject, Subject) else load_subject(subject)


def noted_subject(subject: SubjectLike) -> Subject:
    """As `loaded_subject`, with a warning for each of its notes, for what does not pass them on itself."""
    loaded = loaded_subject(subject)
    for note in loaded.notes:
        warn(note)
    return loaded
