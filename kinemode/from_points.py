"""The work behind `kinemode.track` and `kinemode.fit` where points in space are given."""

from __future__ import annotations

import warnings
from dataclasses import replace

from threadpoolctl import threadpool_limits

from estimator.runs.run_file import Run
from estimator.trackers.initialisation import MIN_KEYPOINTS, enough_keypoints
from estimator.trackers.markers import NAME
from estimator.tracking.fitting.fit import Fit
from estimator.tracking.fitting.markers import fit_markers
from estimator.tracking.registry import settings_for
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.inputs.load import Inputs
from kinemode.inputs.points import load_point_inputs
from kinemode.jobs import frames_at_first, job_of, kept_fit, run_path, track_inputs
from kinemode.notices import FindingWarning, InputWarning
from kinemode.pictures import cue_choice
from kinemode.request import AUTO, FitRequest, TrackRequest
from kinemode.terminal.interruption import kept_if_interrupted


def track_points(loaded: Subject, request: TrackRequest) -> Run:
    """What `kinemode.track` does with points once its arguments are known to be of the right kinds."""
    path, _kept = run_path(request)  # gone with this function unless the run keeps it
    job = job_of(loaded, replace(request, tracker=request.tracker or NAME), path, AUTO)
    job.target.check()
    if request.static and not job.fits(loaded):
        problem = f"{loaded.source} is used as measured, so the static trial is not used"
        raise InputError("static", problem, remedy="leave it out, or fit a built-in subject")
    with kept_if_interrupted(lambda: frames_at_first(job.target)), threadpool_limits(limits=1):
        marked, inputs = load_point_inputs(loaded, request)
        _check_markers(inputs)
        against_input = track_inputs(job, marked, inputs, cue_choice("off"))
    for sentence in against_input:
        warnings.warn(sentence, FindingWarning, stacklevel=4)
    return Run.open(path)


def fit_to_points(loaded: Subject, request: FitRequest) -> Fit:
    """What `kinemode.fit` does with points once its arguments are known to be of the right kinds."""
    with threadpool_limits(limits=1):
        marked, inputs = load_point_inputs(loaded, request)
        _check_markers(inputs)
        for note in (*marked.notes, *inputs.notes):
            warnings.warn(note, InputWarning, stacklevel=4)
        moving, static = inputs.observations, inputs.static
        result = fit_markers(marked, moving, static, seed=request.seed, track_settings=settings_for(NAME))
    return kept_fit(result, request.out)


def _check_markers(inputs: Inputs) -> None:
    """Raise InputError where no frame has enough markers for a pose."""
    if not any(enough_keypoints(o) for o in inputs.observations):
        names = ", ".join(str(path) for path in inputs.points)
        raise InputError(names, f"no frame has {MIN_KEYPOINTS} of the subject's markers", remedy="check --markers")
