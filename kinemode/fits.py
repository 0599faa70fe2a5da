"""The work behind `kinemode.fit`: a subject with a person's lengths, from keypoints and images or from points."""

from __future__ import annotations

from dataclasses import replace

from threadpoolctl import threadpool_limits

from estimator.fitting import person
from estimator.fitting.fit import Fit, bound_note
from estimator.fitting.lengths import given_noise
from estimator.fitting.markers import fit_markers
from estimator.trackers.markers import NAME
from estimator.tracking.registry import Settings, settings_for
from humanoid.kinematics.body import Body
from humanoid.subject.keypoint_places import with_layout_places
from humanoid.subject.subject import Subject
from humanoid.support.errors import InputError
from kinemode.initialisation import (
    check_keypoints,
)
from kinemode.inputs.load import load_inputs
from kinemode.inputs.points import load_point_inputs
from kinemode.jobs import check_markers
from kinemode.named import PathLike
from kinemode.notices import FindingWarning, warn
from kinemode.pictures import chosen_cues, cue_choice, doubts, notes_on, opened_cues
from kinemode.request import FileOptions, FitRequest


def fit_subject(loaded: Subject, files: FileOptions, request: FitRequest) -> Fit:
    """The work of `kinemode.fit` after its arguments are checked; files: read in place of those that the request
    has."""
    choice = cue_choice(request.cues)
    if not loaded.proportions:
        raise InputError(loaded.source, "has no <proportion> elements: there is nothing to fit")
    with threadpool_limits(limits=1):
        inputs = load_inputs(Body(loaded), files)
        loaded = with_layout_places(loaded, inputs.layout)
        check_keypoints(loaded, inputs.observations)
        chosen = chosen_cues(choice, inputs, Settings().cues)
        with opened_cues(loaded, inputs, chosen) as reader:
            notes = (*loaded.notes, *inputs.notes, *notes_on(choice, inputs, chosen))
            if reader is not None and chosen is not None:
                notes += (*reader.notes, *doubts(reader, inputs, chosen))
            for note in notes:
                warn(note)
            noise = given_noise(inputs.noise, inputs.observations, Settings().cost.keypoint_noise)
            seen = [replace(o, noise=noise) for o in inputs.observations]
            result = person.fit_person(
                loaded, seen, reader, seed=request.seed, height=request.height, floor=inputs.floor
            )
    return kept_fit(result, request.out)


def kept_fit(fit: Fit, out: PathLike | None) -> Fit:
    """The same, written where it is to be, with warnings about what contradicts its input."""
    for note in fit.notes:
        warn(note)
    if bound := bound_note(fit.subject):
        warn(bound, FindingWarning)
    if out is not None:
        fit.subject.write(out)
    return fit


def fit_to_points(loaded: Subject, request: FitRequest) -> Fit:
    """The work of `kinemode.fit` with points after its arguments are checked."""
    with threadpool_limits(limits=1):
        marked, inputs = load_point_inputs(loaded, request)
        check_markers(inputs)
        for note in (*marked.notes, *inputs.notes):
            warn(note)
        moving, static = inputs.observations, inputs.static
        result = fit_markers(marked, moving, static, seed=request.seed, track_settings=settings_for(NAME))
    return kept_fit(result, request.out)
