"""The work behind `kinemode.track` and `kinemode.fit` where points in space are given."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import cast

from threadpoolctl import threadpool_limits

from estimator.runs.run_file import Run
from estimator.runs.run_store import TemporaryFolder
from estimator.trackers.initialisation import MIN_KEYPOINTS, enough_keypoints
from estimator.trackers.markers import NAME
from estimator.tracking.fitting.fit import Fit
from estimator.tracking.fitting.markers import fit_markers
from estimator.tracking.registry import settings_for
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.inputs.load import Inputs
from kinemode.inputs.named import PathLike
from kinemode.inputs.points import PointFiles, load_point_inputs
from kinemode.jobs import TrackOptions, frames_at_first, job_of, kept_fit, track_inputs
from kinemode.notices import FindingWarning, InputWarning
from kinemode.pictures import cue_choice
from kinemode.terminal.interruption import kept_if_interrupted


def track_points(loaded: Subject, files: PointFiles, wanted: TrackOptions) -> Run:
    """What `kinemode.track` does with points once its arguments are known to be of the right kinds."""
    temporary = TemporaryFolder() if wanted.out is None else None
    path = temporary.path / "track.run" if temporary is not None else Path(cast(PathLike, wanted.out))
    job = job_of(loaded, wanted, path, "auto")
    job.target.check()
    if files.static and not job.fits(loaded):
        problem = f"{loaded.source} is taken as measured, so the static trial is not used"
        raise InputError("static", problem, remedy="leave it out, or fit a built-in subject")
    with kept_if_interrupted(lambda: frames_at_first(job.target)), threadpool_limits(limits=1):
        marked, inputs = load_point_inputs(loaded, files)
        _check_markers(files, inputs)
        against_input = track_inputs(job, marked, inputs, cue_choice("off"))
    for sentence in against_input:
        warnings.warn(sentence, FindingWarning, stacklevel=3)
    return Run.open(path)


def fit_to_points(loaded: Subject, files: PointFiles, seed: int, out: PathLike | None) -> Fit:
    """What `kinemode.fit` does with points once its arguments are known to be of the right kinds."""
    with threadpool_limits(limits=1):
        marked, inputs = load_point_inputs(loaded, files)
        _check_markers(files, inputs)
        for note in (*marked.notes, *inputs.notes):
            warnings.warn(note, InputWarning, stacklevel=3)
        result = fit_markers(marked, inputs.observations, inputs.static, seed=seed, track_settings=settings_for(NAME))
    return kept_fit(result, out)


def _check_markers(files: PointFiles, inputs: Inputs) -> None:
    """Raise InputError where no frame has enough markers for a pose."""
    if not any(enough_keypoints(o) for o in inputs.observations):
        names = ", ".join(str(path) for path in files.paths)
        raise InputError(names, f"no frame has {MIN_KEYPOINTS} of the subject's markers", remedy="check --markers")
