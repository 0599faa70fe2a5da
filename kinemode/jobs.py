"""The work behind `kinemode.track` and `kinemode.fit`: subject, clips, keypoints in, run or fitted subject out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from estimator.data.observation import MIN_POINTS, Observation, PoseEstimate
from estimator.data.sequence import Cues
from estimator.fitting import person
from estimator.fitting.fit import stature
from estimator.fitting.lengths import given_noise
from estimator.fitting.markers import fit_markers
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.runs.unobserved import unseen_by, unseen_joints_note
from estimator.search.cost_model import CostModel
from estimator.search.hypothesis import EXCHANGED
from estimator.trackers.base import capabilities_of
from estimator.trackers.markers import NAME
from estimator.tracking.learning import stored_learning
from estimator.tracking.registry import Settings, make_tracker
from estimator.tracking.runner import run, run_into, stored_state
from estimator.tracking.smoothing import smooth_track
from humanoid.kinematics.body import Body
from humanoid.subject.keypoint_places import with_layout_places
from humanoid.subject.landmarks import mirror_index
from humanoid.subject.subject import BUILT_IN, Subject, is_built_in
from humanoid.support.errors import InputError
from humanoid.support.spilled import Spill
from kinemode import __version__
from kinemode.compilation import compile_with
from kinemode.findings import run_findings
from kinemode.indexing import beginning, with_index
from kinemode.initialisation import (
    check_beginning,
    check_cue,
    check_smoothing,
    check_start,
    notes_on_fit,
)
from kinemode.inputs.declared import plain
from kinemode.inputs.load import Inputs, load_everybody, load_inputs
from kinemode.inputs.points import load_point_inputs
from kinemode.notices import FindingWarning, warn
from kinemode.option import words_kept
from kinemode.pictures import CueChoice, chosen_cues, cue_choice, doubts, names_of, notes_on, opened_cues
from kinemode.request import ALL, AUTO, BY_INDEX, OFF, FileOptions, TrackRequest
from kinemode.settings import DEFAULT, Chosen, choose
from kinemode.target import RunTarget, run_path
from kinemode.terminal.interruption import kept_if_interrupted

_IN_MEMORY = 300  # frames as tracked, while smoothing
_TRIED, _ENOUGH = 4, 8  # frames in which layouts are tried; keypoints that they have at least
_CAPPED, _MUCH_BETTER = 10.0, 0.5  # standard deviations that count at most; share of them that is left


class Known(NamedTuple):
    """Prior knowledge for tracking with a subject that is not fitted again. estimates: of poses, by index of the
    frame. noise: measured by the fit for each camera's keypoints (`Fit.noise`)."""

    estimates: Mapping[int, PoseEstimate] = MappingProxyType({})
    noise: tuple[float, ...] = ()


UNKNOWN = Known()


def track_subject(loaded: Subject, files: FileOptions, request: TrackRequest, known: Known = UNKNOWN) -> Run:
    """The work of `kinemode.track` for one person after its arguments are checked; files: read in place of what
    the request has."""
    path, _kept = run_path(request.out)  # gone with this function unless the run keeps it
    choice = cue_choice(request.cues)
    job = job_of(loaded, request, path, plain(files.person), known)
    job.target.check()
    # the matrices are small: more threads only wait for each other
    with kept_if_interrupted(lambda: frames_at_first(job.target)), threadpool_limits(limits=1):
        body = Body(loaded)
        inputs = load_inputs(body, files, lambda: make_tracker(job.tracker, body, job.settings).needs_keypoints)
        against_input = track_inputs(job, loaded, inputs, choice)
    for sentence in against_input:
        warn(sentence, FindingWarning)
    return Run.open(path)


def job_of(
    loaded: Subject, request: TrackRequest, path: Path, person: str | int | dict[str, str], known: Known = UNKNOWN
) -> TrackingJob:
    """The request checked against subject and tracker, with the run's place and person."""
    given = choose(request.tracker or DEFAULT, request.settings, request.modes)
    chosen = beginning(given, BY_INDEX if request.begins_by_index else None)
    tracker = make_tracker(chosen.tracker, Body(loaded), chosen.settings)
    check_start(tracker, chosen)
    check_smoothing(tracker, chosen)
    chosen = with_index(chosen, loaded, request.index, request.reporter)
    target = RunTarget(path, request.resume, request.overwrite)
    job = TrackingJob(request, chosen, chosen.settings, person, target, known)
    _check_fit_choice(request.fit, loaded)
    check_height(request.height, loaded)
    chosen.check(job.fits(loaded))
    return job


def track_inputs(job: TrackingJob, subject: Subject, inputs: Inputs, choice: CueChoice) -> tuple[str, ...]:
    """Track into the run file; returns what in the run contradicts subject or input."""
    subject = with_layout_places(subject, inputs.layout)
    body = Body(subject)
    tracker = make_tracker(job.tracker, body, job.settings)
    learning = capabilities_of(tracker).energy is not None
    chosen = chosen_cues(choice, inputs, job.settings.cues, job.chosen.source, learning=learning)
    check_cue(tracker, job.tracker, names_of(chosen))
    check_beginning(tracker, job.tracker, subject, inputs.observations, chosen is not None)
    if chosen is not None:
        job = replace(job, settings=replace(job.settings, cues=chosen))
    compile_with(job.request.reporter, body)
    with opened_cues(subject, inputs, chosen) as cues:
        notes = (*subject.notes, *inputs.notes, *notes_on(choice, inputs, chosen))
        cameras = len(inputs.observations[0].cameras)
        notes += tuple(job.chosen.notes(cues=chosen, cameras=cameras, fits=job.fits(subject)))
        notes += tuple(job.chosen.notes_on_body(body))
        notes += tuple(notes_on_fit(inputs.observations) if job.fits(subject) else ())
        if cues is not None and chosen is not None:
            notes += (*cues.notes, *doubts(cues, inputs, chosen))
        unseen = unseen_joints_note(unseen_by(body, inputs.observations)) if chosen is None else ""
        notes += (unseen,) if unseen else ()
        for note in notes:
            warn(job.of_person(note))
        expected, clip = job.settings.cost.keypoint_noise, inputs.observations
        noise = given_noise(inputs.noise, clip, expected)
        fitted = _fitted(job, subject, replace(inputs, observations=[replace(o, noise=noise) for o in clip]), cues)
        for note in fitted.notes:
            warn(job.of_person(note))
        notes += fitted.notes
        noise = given_noise(inputs.noise, clip, expected, fitted.noise)
        seen = [replace(o, estimate=fitted.first.get(o.index), noise=noise) for o in clip]
        inputs, own = replace(inputs, observations=seen), fitted.subject
        return _track_into(job, _header(job, own, inputs, names_of(chosen), notes), own, inputs, cues, subject)


class _Fitted(NamedTuple):
    """The subject with the person's proportions and flesh, where they are to be fitted. first: what is known of the
    pose with which the track starts, by frame. noise: factors on each camera's, none where it was not measured."""

    subject: Subject
    first: Mapping[int, PoseEstimate]
    notes: tuple[str, ...] = ()
    noise: tuple[float, ...] = ()


def _fitted(job: TrackingJob, subject: Subject, inputs: Inputs, cues: Cues | None) -> _Fitted:
    if not job.fits(subject):
        sized = subject if job.request.height is None else subject.resized(job.request.height / stature(subject))
        return _Fitted(sized, job.known.estimates, noise=job.known.noise)
    if job.target.resumed:
        stored = Run.open(job.target.path)
        if stored.header.subject_source == subject.source and (known := stored.estimates) is not None:
            return _Fitted(stored.subject, known, noise=stored.observation(0).noise)  # fitted when the run began
    if inputs.observations[0].markers is not None:
        moving, static = inputs.observations, inputs.static
        fit = fit_markers(subject, moving, static, seed=job.request.seed, track_settings=job.settings)
    else:
        shown = cues if job.request.fit == "auto" else None
        fit = person.fit_person(
            subject,
            inputs.observations,
            shown,
            seed=job.request.seed,
            track_settings=job.chosen.for_fit,
            height=job.request.height,
            floor=inputs.floor,
        )
    first = dict(sorted(fit.estimates.items())[:1])  # the first frame with which it can start
    return _Fitted(fit.subject, first, fit.notes, fit.noise)


def check_height(height: float | None, subject: Subject) -> None:
    """Raise InputError for the height of a person whose subject is used as measured."""
    if height is None:
        return
    if not is_built_in(subject):
        raise InputError("height", f"{subject.source} is used as measured", remedy="leave it out")
    stature(subject)


def _height_of(job: TrackingJob) -> dict[str, float]:
    return {} if job.request.height is None else {"height": job.request.height}


def frames_at_first(target: RunTarget) -> int | None:
    """The number of frames of the run to resume; None without one."""
    with suppress(InputError):  # a damaged one is refused elsewhere
        return len(Run.open(target.path)) if target.resumed else None
    return None


@dataclass(frozen=True)
class TrackingJob:
    """A request with the resulting choices. chosen: the tracker. settings: its own, with the cues that are used.
    person: whom the run is of. name: of one of several people, "" for the only one."""

    request: TrackRequest
    chosen: Chosen
    settings: Settings
    person: str | int | dict[str, str]
    target: RunTarget
    known: Known = UNKNOWN
    name: str = ""

    def of_person(self, note: str) -> str:
        """A note, with the person where several are tracked."""
        return f"{self.name}: {note}" if self.name else note

    @property
    def tracker(self) -> str:
        """Its name."""
        return self.chosen.tracker

    def fits(self, subject: Subject) -> bool:
        """Whether a subject is fitted before it is tracked."""
        return self.request.fit != OFF and is_built_in(subject)


def _track_into(
    job: TrackingJob, header: RunHeader, subject: Subject, inputs: Inputs, cues: Cues | None, asked: Subject
) -> tuple[str, ...]:
    """asked: the subject before it was fitted."""
    observations, target = inputs.observations, job.target
    stored: Mapping[str, np.ndarray] | None = None
    first = 0
    if target.resumed:
        writer, stored, first = RunWriter.resume(target.path, header)
    else:
        writer = RunWriter.create(target.path, header, overwrite=target.overwrite)
    with kept_if_interrupted(lambda: writer.frame_count), writer:
        writer.put_observations(observations)
        tracker = make_tracker(job.tracker, Body(subject), job.settings)
        state, last = stored_state(tracker, stored, target.path)
        learning = stored_learning(tracker, stored, target.path)
        with job.request.reporter("tracking") as report:
            run_into(
                writer, tracker, observations, job.request.seed,
                state=state, first=first, cues=cues, last=last, learning=learning, progress=report,
            )  # fmt: skip
        # as stored, so that a resumed run has the same
        results = Spill(_IN_MEMORY).list(Run.open(target.path).paths(covariances=cues is not None))
        energy = capabilities_of(tracker).energy
        if job.settings.smooth.enabled and energy is not None:
            with job.request.reporter("smoothing") as report:
                smoothed = smooth_track(
                    energy, observations, results, job.settings.smooth, cues=cues, floor=inputs.floor, progress=report
                )
            writer.put_smoothed(smoothed)
        against, contradicted = run_findings(
            Run.open(target.path),
            lambda: likely_layout(asked, inputs),
            R_upright_points=inputs.R_upright_points,
            has_world=inputs.has_world,
        )
        writer.put_findings(against, contradicted)
        writer.finish()
    return against


def _header(
    job: TrackingJob, subject: Subject, inputs: Inputs, cues: tuple[str, ...], notes: tuple[str, ...]
) -> RunHeader:
    cameras = inputs.observations[0].cameras
    names = [camera.name for camera in cameras]
    clips = _absolute(names, inputs.clips)
    return RunHeader(
        subject_urdf=subject.urdf,
        subject_source=subject.source,
        subject_base=subject.base,
        cameras=cameras,
        clips={name: clips.get(name) for name in names},
        image_sizes={c.name: c.image_size for c in cameras},
        times=inputs.times,
        tracker=job.tracker,
        settings={**job.settings.to_dict(), "fit": job.request.fit, "person": job.person, **_height_of(job)},
        seed=job.request.seed,
        version=__version__,
        notes=notes,
        cues=cues,
        masks=_absolute(names, inputs.masks) if cues else {},
        backgrounds=_absolute(names, inputs.backgrounds) if cues else {},
        stereo={n: names[r] for n, r in zip(names, inputs.rights, strict=True) if r is not None} if cues else {},
        depths=_absolute(names, inputs.depths) if cues else {},
        clip_frames={
            name: tuple(frames.tolist())
            for name, frames in zip(names, inputs.frames, strict=True)
            if frames is not None
        },
        R_upright_given=inputs.R_upright_given,
        floor=inputs.floor,
        points=tuple(os.path.abspath(path) for path in inputs.points),
        request=words_kept(job.request),
    )


def _absolute(names: list[str], paths: tuple[Path | None, ...]) -> dict[str, str]:
    """Where the files of some cameras lie."""
    return {name: os.path.abspath(path) for name, path in zip(names, paths, strict=True) if path is not None}


def _check_fit_choice(fit: str, subject: Subject) -> None:
    if fit == "proportions" and subject.source not in BUILT_IN:
        problem, remedy = f"{subject.source} is used as measured", "leave it out; kinemode fit fits a file"
        raise InputError("fit", problem, remedy=remedy)


def track_points(loaded: Subject, request: TrackRequest) -> Run:
    """The work of `kinemode.track` with points after its arguments are checked."""
    path, _kept = run_path(request.out)  # gone with this function unless the run keeps it
    job = job_of(loaded, replace(request, tracker=request.tracker or NAME), path, AUTO)
    job.target.check()
    if request.static and not job.fits(loaded):
        problem = f"{loaded.source} is used as measured, so the static trial is not used"
        raise InputError("static", problem, remedy="leave it out, or fit a built-in subject")
    with kept_if_interrupted(lambda: frames_at_first(job.target)), threadpool_limits(limits=1):
        marked, inputs = load_point_inputs(loaded, request)
        check_markers(inputs)
        against_input = track_inputs(job, marked, inputs, cue_choice("off"))
    for sentence in against_input:
        warn(sentence, FindingWarning)
    return Run.open(path)


def check_markers(inputs: Inputs) -> None:
    """Raise InputError where no frame has enough markers for a pose."""
    if not any(o.has_enough_points for o in inputs.observations):
        names = ", ".join(str(path) for path in inputs.points)
        raise InputError(names, f"no frame has {MIN_POINTS} of the subject's markers", remedy="check --markers")


def track_everybody(loaded: Subject, files: FileOptions, request: TrackRequest) -> dict[str, Run]:
    """A run for each person, by name: "person1", ..., those large in the pictures for long first.

    People who cannot be tracked are left out, with a warning. Raises InputError where no one can.
    """
    out, _kept = run_path(request.out)  # gone with this function unless a run keeps it
    choice = cue_choice(request.cues)
    RunTarget(out, resume=True).check()  # its folder is there
    first = job_of(loaded, request, out, ALL)
    with threadpool_limits(limits=1):
        everybody, notes = load_everybody(Body(loaded), files)
        jobs = _jobs(first, everybody)
        who = "one person is tracked" if len(jobs) == 1 else f"{len(jobs)} people are tracked, one after the other"
        for note in (f"--person all: {who}", *notes):
            warn(note)
        failures: dict[str, InputError] = {}
        with kept_if_interrupted(lambda: sum(frames_at_first(job.target) or 0 for job in jobs.values())):
            for (name, job), inputs in zip(jobs.items(), everybody, strict=True):
                try:
                    against = track_inputs(job, loaded, inputs, choice)
                except InputError as error:
                    failures[name] = error
                    warn(f"{name} is not tracked, the others are: {error}")
                    continue
                for sentence in against:
                    warn(job.of_person(sentence), FindingWarning)
    if len(failures) == len(jobs):
        raise next(iter(failures.values()))
    return {name: Run.open(job.target.path) for name, job in jobs.items() if name not in failures}


def _jobs(first: TrackingJob, everybody: Sequence[Inputs]) -> dict[str, TrackingJob]:
    """The job of each person, with no file in the way of its run: that is checked before the first is tracked."""
    out, jobs = first.target.path, {}
    for number in range(1, len(everybody) + 1):
        name = f"person{number}"
        target = replace(first.target, path=out.with_name(f"{out.stem}.{name}{out.suffix}"))
        target.check()
        jobs[name] = replace(first, target=target, person=f"all: {name}", name=name)
    return jobs


def likely_layout(subject: Subject, inputs: Inputs) -> str:
    """The layout by which the keypoints fit much better than as they were read, as a sentence; empty where none does.

    Poses of a few frames are searched again for each layout of as many points, without the frames between them.
    """
    if not inputs.other_layouts:
        return ""
    body, settings = Body(subject), Settings()
    own = _misfit(body, inputs.observations, settings)
    misfits = {name: _misfit(body, seen(), settings) for name, seen in inputs.other_layouts.items()}
    best = min(misfits, key=lambda name: misfits[name], default="")
    if not best or not misfits[best] < _MUCH_BETTER * own:
        return ""
    return (
        f"the keypoints fit much better as {best}: at {misfits[best]:.1f} standard deviations in the mean, as they were"
        f" read at {own:.1f}. Track with --layout {best}"
    )


def _misfit(body: Body, observations: Sequence[Observation], settings: Settings) -> float:
    """Mean distance of the keypoints from poses that are searched for them, in standard deviations, none above 10."""
    usable = [o for o in observations if o.count >= _ENOUGH]
    picked = [usable[i] for i in np.unique(np.linspace(0, len(usable) - 1, _TRIED).astype(int))] if usable else []
    tracker, model = make_tracker("css", body), CostModel(body, settings.cost)
    mirror = mirror_index(body.landmark_names)
    far = []
    for observation in picked:
        ((result, _),) = run(tracker, [replace(observation, index=0, cues=())], 0)
        if len(result.q):
            seen = observation.exchanged(mirror) if result.association[0] == EXCHANGED else observation
            distances = model.observation_term(seen).distances(body.at(result.q[0]))
            far.append(np.nanmean(np.minimum(distances, _CAPPED)))
    return float(np.mean(far)) if far else np.inf
