"""The few functions a user of the package needs: subject, clips and keypoints in, a run out."""

from __future__ import annotations

import os
import shlex
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

from threadpoolctl import threadpool_limits

from estimator.fitting.lengths import Fit, fit_proportions
from estimator.fitting.stages import fit_subject
from estimator.results.run_checks import checked_state
from estimator.results.run_file import Run, RunHeader, RunWriter
from estimator.results.temporary_run import TemporaryFolder
from estimator.search.workers import checked_count, helped
from estimator.sequences.source import Cues
from estimator.smoothing import smooth_track
from estimator.trackers.base import MIN_KEYPOINTS, TrackState, startable
from estimator.tracking.leaps import leap_note, leaps
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import run_into
from estimator.tracking.settings import Settings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import BUILT_IN, Subject, load_subject
from humanoid.support.errors import InputError
from kinemode import __version__
from kinemode.arguments import check_arguments, whole
from kinemode.declared import Declared, Offsets, Rates, Sizes
from kinemode.findings import findings
from kinemode.inputs import Cameras, Inputs, load_inputs
from kinemode.interruption import kept_if_interrupted
from kinemode.named import Named, PathLike
from kinemode.persons import Persons, plain
from kinemode.pictures import CueChoice, chosen_cues, cue_choice, names_of, notes_on, notes_on_silhouettes, opened_cues
from kinemode.progress import Reporter, unreported
from kinemode.settings import Chosen, check_workers, choose

FIT_CHOICES = ("auto", "proportions", "off")
FitChoice = Literal["auto", "proportions", "off"]
SubjectLike = Subject | PathLike


class InputWarning(UserWarning):
    """Something about the input that the user should hear of; the work goes on."""


class FindingWarning(InputWarning):
    """What a finished run says against its subject or its input (see `estimator.results.diagnosis`)."""


def open_run(path: PathLike) -> Run:
    """Open a run file, finished or still being written; raises InputError where it is none."""
    check_arguments(path=path)
    return Run.open(path)


def track(
    subject: SubjectLike,
    clips: Named,
    *,
    cameras: Cameras = None,
    keypoints: Named = None,
    cues: str | Iterable[str] = "auto",
    masks: Named = None,
    background: Named = None,
    tracker: str = "css",
    modes: int | None = None,
    seed: int = 0,
    fit: str = "auto",
    out: PathLike | None = None,
    resume: bool = False,
    overwrite: bool = False,
    person: Persons = "auto",
    keypoint_size: Sizes = None,
    fps: Rates = None,
    offset: Offsets = None,
    start: float | None = None,
    end: float | None = None,
    settings: Mapping[str, Any] | PathLike | None = None,
    workers: int = 1,
    progress: Reporter | None = None,
) -> Run:
    """Track a subject through one clip, or several synchronised ones, into a run file.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF.
    clips: paths or `NAME=PATH` texts of videos or folders of images, or a mapping by name; none where the keypoints
        are enough. The name picks the camera, and is the file's stem by default.
    cameras: camera file, or cameras by name; the one camera of a single clip is guessed without it.
    keypoints: 2D keypoint files, given as the clips are; with cues those of one frame will do, tracking begins there.
    cues: what is taken from the pictures: "off", or some of "edges", "flow" and "silhouette", as names or separated by
        commas; "auto" takes them all where there are clips and less than half of the frames have keypoints.
    masks, background: for the silhouette, given as the clips are: a video or folder of masks, white on the person; a
        picture of the empty scene. Without them the background is learned from the clip.
    tracker, modes: name of the tracker and how many hypotheses it keeps; unless given as many as its settings say, for
        which each tracker has its own default. A single-mode tracker keeps one.
    settings: nested changes to the tracker's settings (see `estimator.tracking.registry`), or a TOML file of them as
        `kinemode settings` writes it. Those of cost, search and cues also reach the fit, which tracks with css.
    seed: equal seeds give equal runs.
    fit: "auto" fits an unchanged built-in subject to the person from the first frames: proportions from the keypoints,
        and where edges or silhouettes are looked at the flesh too (CSS section 5); any other subject is taken as
        measured. "proportions" leaves the flesh as it is, "off" every subject.
    out: the run file. Without it a temporary one, which is gone when no `Run` of it is left.
    resume: go on with `out` if it is there. overwrite: replace it.
    person: whom of several people in the keypoint files: "auto" or an id, for all cameras, or by camera as a mapping or
        as CAMERA=ID texts. Cameras left to "auto" take whoever fits the others.
    keypoint_size: width and height [px] of the pictures that the detector saw, where the files do not say it and it is
        not the clip's: (540, 960), or by name.
    fps: frames per second of folders of pictures, and beside videos of keypoint files that declare none; or by name.
    offset: seconds that a camera's first frame was taken after moment 0, by name: above 0 for one that started late.
    start, end: track from here to here [s], both included.
    workers: how many processes search a frame's hypotheses, this one among them, for trackers that search several; the
        run is the same with any number.
        Where it is more than 1, a script needs `if __name__ == "__main__":` around what it runs.
    progress: opens a progress report for each stage, such as `kinemode.progress.reported`; none by default.

    Raises
    ------
    InputError: whatever is wrong with what was given, a changed setting without effect included.
    """
    check_arguments(
        subject=subject, clips=clips, cameras=cameras, keypoints=keypoints, cues=cues, masks=masks,
        background=background, tracker=tracker, modes=modes, fit=fit, out=out, resume=resume, overwrite=overwrite,
        person=person, settings=settings, workers=workers, progress=progress,
    )  # fmt: skip
    choice = cue_choice(cues)
    chosen = choose(tracker, settings, modes)
    check_workers(chosen, checked_count(workers))
    temporary = TemporaryFolder() if out is None else None  # gone with this function unless the run keeps it
    path = temporary.path / "track.run" if temporary is not None else Path(cast(PathLike, out))
    job = _Job(
        chosen,
        chosen.settings,
        _seed(seed),
        _fit_choice(fit),
        plain(person),
        _Target(path, resume, overwrite),
        progress or unreported,
        workers,
    )
    job.target.check()
    loaded = subject if isinstance(subject, Subject) else load_subject(subject)
    _check_fit_choice(job.fit, loaded)
    chosen.check(job.fits(loaded))
    # the matrices are small: more threads only wait for each other
    with kept_if_interrupted(job.target.frames_at_first), threadpool_limits(limits=1):
        inputs = load_inputs(
            Body(loaded), clips, keypoints, cameras, person=person, masks=masks, backgrounds=background,
            declared=Declared(keypoint_size, fps, offset, start, end),
        )  # fmt: skip
        _check_inputs(loaded, inputs)
        found = _track(job, loaded, inputs, choice)
    for sentence in found:
        warnings.warn(sentence, FindingWarning, stacklevel=2)
    return open_run(path)


def _track(job: _Job, subject: Subject, inputs: Inputs, choice: CueChoice) -> tuple[str, ...]:
    """Track into the run file; returns what the run then says against subject or input."""
    chosen = chosen_cues(choice, inputs, job.settings.cues, job.chosen.source)
    if chosen is not None:
        job = replace(job, settings=replace(job.settings, cues=chosen))
    with opened_cues(inputs, chosen) as cues:
        notes = (*subject.notes, *inputs.notes, *notes_on(choice, inputs, chosen))
        cameras = len(inputs.observations[0].cameras)
        notes += tuple(job.chosen.notes(cues=chosen, cameras=cameras, fits=job.fits(subject)))
        if cues is not None:
            notes += (*cues.notes, *notes_on_silhouettes(cues, inputs))
        for note in notes:
            warnings.warn(note, InputWarning, stacklevel=4)
        fitted = _fitted(job, subject, inputs, cues)
        return _track_into(job, _header(job, fitted, inputs, names_of(chosen), notes), fitted, inputs, cues)


def _fitted(job: _Job, subject: Subject, inputs: Inputs, cues: Cues | None) -> Subject:
    """The subject with the person's proportions and flesh, where they are to be fitted."""
    if not job.fits(subject):
        return subject
    if job.target.resumed:
        stored = open_run(job.target.path)
        if stored.header.subject_source == subject.source:
            return stored.subject  # fitted when the run began
    return _fit(subject, inputs, job.seed, cues if job.fit == "auto" else None, job.chosen.for_fit).subject


def _fit(subject: Subject, inputs: Inputs, seed: int, cues: Cues | None, settings: Settings | None) -> Fit:
    """All that the input allows: without pictures the proportions alone."""
    if cues is None:
        return fit_proportions(subject, inputs.observations, seed, track_settings=settings)
    return fit_subject(subject, inputs.observations, cues, seed, track_settings=settings)


def fit(
    subject: SubjectLike,
    clips: Named,
    *,
    cameras: Cameras = None,
    keypoints: Named = None,
    cues: str | Iterable[str] = "auto",
    masks: Named = None,
    background: Named = None,
    seed: int = 0,
    person: Persons = "auto",
    keypoint_size: Sizes = None,
    fps: Rates = None,
    offset: Offsets = None,
    start: float | None = None,
    end: float | None = None,
    out: PathLike | None = None,
) -> Fit:
    """Fit a subject to the person in the first frames of a clip; `out` is written as a URDF that loads again.

    Proportions are fitted to the keypoints, and where edges or silhouettes are looked at the flesh to them. The
    arguments are those of `track`. Raises InputError as `track` does, and where there is nothing to fit.
    """
    check_arguments(
        subject=subject, clips=clips, cameras=cameras, keypoints=keypoints, cues=cues, masks=masks,
        background=background, person=person, out=out,
    )  # fmt: skip
    choice, seed = cue_choice(cues), _seed(seed)
    if out is not None:
        _check_folder(Path(out))
    loaded = subject if isinstance(subject, Subject) else load_subject(subject)
    if not loaded.proportions:
        raise InputError(loaded.source, "has no <proportion> elements: there is nothing to fit")
    with threadpool_limits(limits=1):
        inputs = load_inputs(
            Body(loaded), clips, keypoints, cameras, person=person, masks=masks, backgrounds=background,
            declared=Declared(keypoint_size, fps, offset, start, end),
        )  # fmt: skip
        _check_inputs(loaded, inputs)
        chosen = chosen_cues(choice, inputs, Settings().cues)
        with opened_cues(inputs, chosen) as reader:
            notes = (*loaded.notes, *inputs.notes, *notes_on(choice, inputs, chosen))
            if reader is not None:
                notes += (*reader.notes, *notes_on_silhouettes(reader, inputs))
            for note in notes:
                warnings.warn(note, InputWarning, stacklevel=2)
            fitted = _fit(loaded, inputs, seed, reader, None)
    if out is not None:
        fitted.subject.write(out)
    return fitted


def is_built_in(subject: Subject) -> bool:
    """Whether this is a built-in subject with the proportions and the flesh it was shipped with, nobody's yet."""
    if subject.source not in BUILT_IN:
        return False
    shipped = load_subject(subject.source)
    return (subject.proportions, subject.flesh) == (shipped.proportions, shipped.flesh)


@dataclass(frozen=True)
class _Target:
    """Where the run goes, and what becomes of one that is there."""

    path: Path
    resume: bool
    overwrite: bool

    @property
    def resumed(self) -> bool:
        """Whether there is a run to go on with."""
        return self.resume and self.path.exists()

    def frames_at_first(self) -> int | None:
        """How many frames the run to go on with has; None where there is none."""
        with suppress(InputError):  # a damaged one has been, or will be, complained of
            return len(open_run(self.path)) if self.resumed else None
        return None

    def check(self) -> None:
        """Say what is wrong with the output before an hour of work, not after."""
        _check_folder(self.path)
        if self.resume and self.overwrite:
            raise InputError(self.path, "cannot be resumed and overwritten", remedy="choose one")
        if self.path.exists() and not (self.resume or self.overwrite):
            raise InputError(self.path, "exists already", remedy="--resume goes on with it, --overwrite replaces it")


@dataclass(frozen=True)
class _Job:
    """How to track, which with the subject and the inputs decides the result; and where to, who hears of it, and how
    many processes share the work. settings: the chosen ones with the cues that are looked at."""

    chosen: Chosen
    settings: Settings
    seed: int
    fit: FitChoice
    person: str | int | dict[str, str]
    target: _Target
    progress: Reporter
    workers: int

    @property
    def tracker(self) -> str:
        """Its name."""
        return self.chosen.tracker

    def fits(self, subject: Subject) -> bool:
        """Whether a subject is fitted before it is tracked."""
        return self.fit != "off" and is_built_in(subject)


def _track_into(job: _Job, header: RunHeader, subject: Subject, inputs: Inputs, cues: Cues | None) -> tuple[str, ...]:
    observations, target = inputs.observations, job.target
    state: TrackState | None = None
    first = 0
    if target.resumed:
        writer, arrays, first = RunWriter.resume(target.path, header)
        state = TrackState.from_arrays(checked_state(arrays, Body(subject), target.path)) if arrays else None
    else:
        writer = RunWriter.create(target.path, header, overwrite=target.overwrite)
    with kept_if_interrupted(lambda: writer.frame_count), writer:
        writer.put_observations(observations)
        tracker = make_tracker(job.tracker, Body(subject), job.settings)
        with job.progress("tracking") as report, helped(tracker.search, job.workers):
            run_into(writer, tracker, observations, job.seed, state=state, first=first, cues=cues, progress=report)
        results = list(open_run(target.path))  # as stored, so that a resumed run is told the same
        leapt = leap_note(leaps(tracker.body, results))
        if job.settings.smooth.enabled:
            with job.progress("smoothing") as report:
                smoothed = smooth_track(
                    tracker.search, observations, results, job.settings.smooth, cues=cues, progress=report
                )
            writer.put_smoothed(smoothed)
        found = (*([leapt] if leapt else []), *findings(open_run(target.path)))
        writer.put_notes(found)
        writer.finish()
    return found


def _header(job: _Job, subject: Subject, inputs: Inputs, cues: tuple[str, ...], notes: tuple[str, ...]) -> RunHeader:
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
        settings={**job.settings.to_dict(), "fit": job.fit, "person": job.person},
        seed=job.seed,
        version=__version__,
        notes=notes,
        cues=cues,
        masks=_absolute(names, inputs.masks) if cues else {},
        backgrounds=_absolute(names, inputs.backgrounds) if cues else {},
        clip_frames={
            name: tuple(frames.tolist())
            for name, frames in zip(names, inputs.frames, strict=True)
            if frames is not None
        },
    )


def _absolute(names: list[str], paths: tuple[Path | None, ...]) -> dict[str, str]:
    """Where the files of some cameras lie."""
    return {name: os.path.abspath(path) for name, path in zip(names, paths, strict=True) if path is not None}


def _check_inputs(subject: Subject, inputs: Inputs) -> None:
    if not any(startable(o) for o in inputs.observations):
        problem = f"no frame has {MIN_KEYPOINTS} or more of the subject's landmarks"
        raise InputError("keypoints", problem, remedy=f"landmarks: {', '.join(m.name for m in subject.landmarks)}")


def _seed(seed: int) -> int:
    return whole("seed", seed, 0)


def _fit_choice(fit: str) -> FitChoice:
    if fit not in FIT_CHOICES:
        raise InputError("fit", f"{fit!r} is unknown", remedy=f"one of {', '.join(FIT_CHOICES)}")
    return cast(FitChoice, fit)


def _check_fit_choice(fit: FitChoice, subject: Subject) -> None:
    if fit == "proportions" and subject.source not in BUILT_IN:
        problem, remedy = f"{subject.source} is taken as measured", "leave it out; kinemode fit fits a file"
        raise InputError("fit", problem, remedy=remedy)


def _check_folder(path: Path) -> None:
    if path.is_dir():
        raise InputError(path, "is a folder, a file is needed")
    if not path.absolute().parent.is_dir():
        raise InputError(path, "its folder does not exist", remedy=f"mkdir -p {shlex.quote(str(path.parent))}")
