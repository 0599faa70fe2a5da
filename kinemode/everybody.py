"""The work behind `kinemode.track` with person="all": everybody in the keypoint files, a run for each."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from estimator.runs.run_file import Run
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.inputs.load import Inputs, load_everybody
from kinemode.jobs import TrackingJob, frames_at_first, job_of, run_path, track_inputs
from kinemode.notices import FindingWarning, InputWarning
from kinemode.pictures import cue_choice
from kinemode.request import ALL, FileOptions, TrackRequest
from kinemode.target import RunTarget
from kinemode.terminal.interruption import kept_if_interrupted


def track_everybody(loaded: Subject, files: FileOptions, request: TrackRequest) -> dict[str, Run]:
    """A run for each person, by name: "person1", ..., those who are large in the pictures for long first.

    Who cannot be tracked is left out and told of in a warning. Raises InputError where that is everybody.
    """
    out, _kept = run_path(request)  # gone with this function unless a run keeps it
    choice = cue_choice(request.cues)
    RunTarget(out, resume=True).check()  # its folder is there
    first = job_of(loaded, request, out, ALL)
    with threadpool_limits(limits=1):
        everybody, notes = load_everybody(Body(loaded), files)
        jobs = _jobs(first, everybody)
        who = "one person is tracked" if len(jobs) == 1 else f"{len(jobs)} people are tracked, one after the other"
        for note in (f"--person all: {who}", *notes):
            warnings.warn(note, InputWarning, stacklevel=4)
        failures: dict[str, InputError] = {}
        with kept_if_interrupted(lambda: sum(frames_at_first(job.target) or 0 for job in jobs.values())):
            for (name, job), inputs in zip(jobs.items(), everybody, strict=True):
                try:
                    against = track_inputs(job, loaded, inputs, choice)
                except InputError as error:
                    failures[name] = error
                    warnings.warn(f"{name} is not tracked, the others are: {error}", InputWarning, stacklevel=4)
                    continue
                for sentence in against:
                    warnings.warn(job.of_person(sentence), FindingWarning, stacklevel=4)
    if len(failures) == len(jobs):
        raise next(iter(failures.values()))
    return {name: Run.open(job.target.path) for name, job in jobs.items() if name not in failures}


def _jobs(first: TrackingJob, everybody: Sequence[Inputs]) -> dict[str, TrackingJob]:
    """The job of each person, whose run none is in the way of: that is said before the first is tracked."""
    out, jobs = first.target.path, {}
    for number in range(1, len(everybody) + 1):
        name = f"person{number}"
        target = replace(first.target, path=out.with_name(f"{out.stem}.{name}{out.suffix}"))
        target.check()
        jobs[name] = replace(first, target=target, person=f"all: {name}", name=name)
    return jobs
