"""The work behind `kinemode.track` and `kinemode.fit`: subject, clips, keypoints in, run or fitted subject out."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from estimator.data.observation import PoseEstimate
from estimator.data.sequence import Cues
from estimator.energy.balance import Balance
from estimator.runs.diagnosis import contradicted
from estimator.runs.out_of_balance import out_of_balance
from estimator.runs.run_file import Run, RunHeader, RunWriter
from estimator.runs.run_store import TemporaryFolder
from estimator.runs.unobserved import unseen_by, unseen_joints_note
from estimator.trackers.capabilities import capabilities_of
from estimator.tracking.fitting import person
from estimator.tracking.fitting.fit import Fit, bound_note, stature
from estimator.tracking.fitting.keypoint_noise import given_noise
from estimator.tracking.fitting.markers import fit_markers
from estimator.tracking.leaps import leap_note, leaps, limb_leaps, limb_note
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run_into, stored_state
from estimator.tracking.settings import Settings
from estimator.tracking.smoothing import smooth_track
from humanoid.kinematics.body import Body
from humanoid.subject.keypoint_places import with_layout_places
from humanoid.subject.subject import BUILT_IN, Subject, is_built_in
from humanoid.support.errors import InputError
from humanoid.support.spilled import Spill
from kinemode import __version__
from kinemode.compilation import compile_with
from kinemode.explain import run_settings
from kinemode.findings import balance_note, diagnosed, far_note, floor_note, reading_note, upright_note
from kinemode.indexing import beginning, with_index
from kinemode.initialisation import (
    check_beginning,
    check_cue,
    check_keypoints,
    check_smoothing,
    check_start,
    note_on_beginning,
    notes_on_fit,
)
from kinemode.inputs.load import Inputs, load_inputs
from kinemode.inputs.persons import plain
from kinemode.likely_layout import likely_layout
from kinemode.named import PathLike
from kinemode.notices import FindingWarning, InputWarning
from kinemode.option import words_given
from kinemode.pictures import CueChoice, chosen_cues, cue_choice, doubts, names_of, notes_on, opened_cues
from kinemode.request import BY_INDEX, OFF, FileOptions, FitRequest, TrackRequest
from kinemode.settings import DEFAULT, Chosen, choose
from kinemode.target import RunTarget
from kinemode.terminal.interruption import kept_if_interrupted

_IN_MEMORY = 300  # frames as tracked, while smoothing


class Known(NamedTuple):
    """What is known before a subject is tracked that is not fitted anew. estimates: of poses, by index of the frame.
    noise: what the fit has measured of each camera's keypoints (`Fit.noise`)."""

    estimates: Mapping[int, PoseEstimate] = MappingProxyType({})
    noise: tuple[float, ...] = ()


UNKNOWN = Known()


def run_path(request: TrackRequest) -> tuple[Path, TemporaryFolder | None]:
    """Where a run is written, and the temporary folder that it is in, which goes with its last `Run`, where no file is
    named."""
    if request.out is not None:
        return Path(request.out), None
    temporary = TemporaryFolder()
    return temporary.path / "track.run", temporary


def track_subject(loaded: Subject, files: FileOptions, request: TrackRequest, known: Known = UNKNOWN) -> Run:
    """What `kinemode.track` does for one person once its arguments are checked; files: what is read, in place of what
    the request has."""
    path, _kept = run_path(request)  # gone with this function unless the run keeps it
    choice = cue_choice(request.cues)
    job = job_of(loaded, request, path, plain(files.person), known)
    job.target.check()
    # the matrices are small: more threads only wait for each other
    with kept_if_interrupted(lambda: frames_at_first(job.target)), threadpool_limits(limits=1):
        body = Body(loaded)
        inputs = load_inputs(body, files, lambda: make_tracker(job.tracker, body, job.settings).needs_keypoints)
        against_input = track_inputs(job, loaded, inputs, choice)
    for sentence in against_input:
        warnings.warn(sentence, FindingWarning, stacklevel=4)
    return Run.open(path)


def job_of(
    loaded: Subject, request: TrackRequest, path: Path, person: str | int | dict[str, str], known: Known = UNKNOWN
) -> TrackingJob:
    """The request checked against subject and tracker, with where the run goes and whom it is of."""
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
    """Track into the run file; returns what the run then says against subject or input."""
    chosen = chosen_cues(choice, inputs, job.settings.cues, job.chosen.source)
    subject = with_layout_places(subject, inputs.layout)
    body = Body(subject)
    tracker = make_tracker(job.tracker, body, job.settings)
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
            warnings.warn(job.of_person(note), InputWarning, stacklevel=5)
        expected, clip = job.settings.cost.keypoint_noise, inputs.observations
        noise = given_noise(inputs.noise, clip, expected)
        fitted = _fitted(job, subject, replace(inputs, observations=[replace(o, noise=noise) for o in clip]), cues)
        for note in fitted.notes:
            warnings.warn(job.of_person(note), InputWarning, stacklevel=5)
        notes += fitted.notes
        noise = given_noise(inputs.noise, clip, expected, fitted.noise)
        seen = [replace(o, estimate=fitted.first.get(o.index), noise=noise) for o in clip]
        inputs, own = replace(inputs, observations=seen), fitted.subject
        return _track_into(job, _header(job, own, inputs, names_of(chosen), notes), own, inputs, cues, subject)


class _Fitted(NamedTuple):
    """The subject with the person's proportions and flesh, where they are to be fitted. first: what is known of the
    pose that the track begins with, by frame. noise: factors on each camera's, none where it was not measured."""

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
    first = dict(sorted(fit.estimates.items())[:1])  # the first frame that it can begin with
    return _Fitted(fit.subject, first, fit.notes, fit.noise)


def fit_subject(loaded: Subject, files: FileOptions, request: FitRequest) -> Fit:
    """What `kinemode.fit` does once its arguments are checked; files: what is read, in place of what the request
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
                warnings.warn(note, InputWarning, stacklevel=4)
            noise = given_noise(inputs.noise, inputs.observations, Settings().cost.keypoint_noise)
            seen = [replace(o, noise=noise) for o in inputs.observations]
            result = person.fit_person(
                loaded, seen, reader, seed=request.seed, height=request.height, floor=inputs.floor
            )
    return kept_fit(result, request.out)


def kept_fit(fit: Fit, out: PathLike | None) -> Fit:
    """The same, written where it is to be; what it says against its input is told to who has called for it."""
    for note in fit.notes:
        warnings.warn(note, InputWarning, stacklevel=5)
    if said := bound_note(fit.subject):
        warnings.warn(said, FindingWarning, stacklevel=5)
    if out is not None:
        fit.subject.write(out)
    return fit


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
    """How many frames the run to go on with has; None where there is none."""
    with suppress(InputError):  # a damaged one is refused elsewhere
        return len(Run.open(target.path)) if target.resumed else None
    return None


@dataclass(frozen=True)
class TrackingJob:
    """A request with what was chosen by it. chosen: the tracker. settings: its own, with the cues that are used.
    person: whom the run is of. name: of one of several people, "" for the only one."""

    request: TrackRequest
    chosen: Chosen
    settings: Settings
    person: str | int | dict[str, str]
    target: RunTarget
    known: Known = UNKNOWN
    name: str = ""

    def of_person(self, note: str) -> str:
        """A note, with whom it is of where several people are tracked."""
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
        with job.request.reporter("tracking") as report:
            run_into(
                writer, tracker, observations, job.request.seed,
                state=state, first=first, cues=cues, last=last, progress=report,
            )  # fmt: skip
        # as stored, so that a resumed run is told the same
        results = Spill(_IN_MEMORY).list(Run.open(target.path).paths())
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


def run_findings(
    run: Run, cause: Callable[[], str] = lambda: "", **of_world: Any
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """What a run whose frames are all there says against its subject or its input, and the rows of the frames that it
    speaks against. cause: asked for the likely one where keypoints and landmarks do not belong together. of_world: see
    `upright_note`."""
    leapt, limbs = leap_note(leaps(run.body, run.streamed())), limb_leaps(run.body, run.landmarks, run.time)
    own = [leapt, limb_note(limbs), bound_note(run.subject), upright_note(run, **of_world)]
    diagnosis, cost = diagnosed(run), run_settings(run).cost
    falling, far = out_of_balance(run, cost.terms[Balance.name]), contradicted(run, cost)
    own += [balance_note(run, falling) if falling else "", reading_note(run)]
    against: Sequence[int] = far
    if diagnosis.contradicts_input:
        because = cause()
        own.insert(0, because)
        against = range(len(run)) if because else far
    else:
        own.append(far_note(far))
    notes = [note for note in (*own, *diagnosis.sentences, floor_note(run)) if note]
    against = sorted({*against, *falling, *limbs})
    return (*note_on_beginning(run.header.tracker, run.paths()), *notes), tuple(against)


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
        request=asked_words(job),
    )


def asked_words(job: TrackingJob) -> dict[str, tuple[str, ...]]:
    """What was asked for, as words of the command line by flag, with the name of the file that was to be written."""
    request = job.request
    return words_given(request) | ({} if request.out is None else {"out": (Path(request.out).name,)})


def _absolute(names: list[str], paths: tuple[Path | None, ...]) -> dict[str, str]:
    """Where the files of some cameras lie."""
    return {name: os.path.abspath(path) for name, path in zip(names, paths, strict=True) if path is not None}


def _check_fit_choice(fit: str, subject: Subject) -> None:
    if fit == "proportions" and subject.source not in BUILT_IN:
        problem, remedy = f"{subject.source} is used as measured", "leave it out; kinemode fit fits a file"
        raise InputError("fit", problem, remedy=remedy)
