"""The few functions a user of the package needs: subject, clips and keypoints in, a run out."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from threadpoolctl import threadpool_limits

from estimator.fitting import Fit, fit_proportions
from estimator.formats.run_file import Run, RunHeader, RunWriter
from estimator.imaging.camera import Camera
from estimator.runner import run_into
from estimator.smoothing import smooth_track
from estimator.trackers.registry import Settings, make_tracker, settings_for
from estimator.trackers.tracker import MIN_KEYPOINTS, TrackState, observable
from humanoid.body import Body
from humanoid.errors import InputError
from humanoid.subject import BUILT_IN, Subject, load_subject
from kinemode import __version__
from kinemode.inputs import Inputs, Named, PathLike, load_inputs
from kinemode.progress import Reporter, unreported

FIT_CHOICES = ("auto", "off")
SubjectLike = Subject | PathLike
Cameras = PathLike | Mapping[str, Camera] | None


class InputWarning(UserWarning):
    """Something about the input that the user should hear of; the work goes on."""


def open_run(path: PathLike) -> Run:
    """Open a run file, finished or still being written; raises InputError where it is none."""
    return Run.open(path)


def track(
    subject: SubjectLike,
    clips: Named,
    *,
    cameras: Cameras = None,
    keypoints: Named = None,
    tracker: str = "css",
    modes: int = 7,
    seed: int = 0,
    fit: str = "auto",
    out: PathLike | None = None,
    resume: bool = False,
    overwrite: bool = False,
    person: str | int = "auto",
    settings: Mapping[str, Any] | None = None,
    progress: Reporter | None = None,
) -> Run:
    """Track a subject through one clip, or several synchronised ones, into a run file.

    Parameters
    ----------
    subject: a loaded subject, a built-in name, or the path of a URDF.
    clips: paths or `NAME=PATH` texts of videos or folders of images, or a mapping by name; none where the keypoints
        are enough. The name picks the camera, and is the file's stem by default.
    cameras: camera file, or cameras by name; the one camera of a single clip is guessed without it.
    keypoints: 2D keypoint files, given as the clips are.
    tracker, modes, settings: name of the tracker, hypotheses kept, and nested changes to its settings
        (see `estimator.trackers.registry`).
    seed: equal seeds give equal runs.
    fit: "auto" fits the proportions of an unchanged built-in subject from the first frames; any other subject is taken
        as measured. "off" takes every subject as it is.
    out: the run file; a temporary one if not given.
    resume: go on with `out` if it is there. overwrite: replace it.
    person: whom of several people in the keypoint files: "auto" or an id.
    progress: opens a progress report for each stage, such as `kinemode.progress.reported`; none by default.

    Raises
    ------
    InputError: whatever is wrong with what was given.
    """
    job = _Job(tracker, settings_for(tracker, modes=modes, changes=settings), _seed(seed), _fit_choice(fit), person)
    with threadpool_limits(limits=1):  # the matrices are small: more threads only wait for each other
        return _track(job, subject, clips, cameras, keypoints, out, resume, overwrite, progress or unreported)


def _track(
    job: _Job,
    subject: SubjectLike,
    clips: Named,
    cameras: Cameras,
    keypoints: Named,
    out: PathLike | None,
    resume: bool,
    overwrite: bool,
    progress: Reporter,
) -> Run:
    path = Path(tempfile.mkdtemp(prefix="kinemode-")) / "track.run" if out is None else Path(out)
    _check_out(path, resume, overwrite)
    loaded = subject if isinstance(subject, Subject) else load_subject(subject)
    inputs = _inputs(loaded, clips, keypoints, cameras, job.person)
    if job.fit == "auto" and is_built_in(loaded):
        stored = open_run(path) if resume and path.exists() else None
        if stored is not None and stored.header.subject_source == loaded.source:
            loaded = stored.subject  # fitted when the run began
        else:
            tuned = job.settings if job.tracker == "css" else None
            loaded = fit_proportions(loaded, inputs.observations, job.seed, track_settings=tuned).subject
    _track_into(path, resume, overwrite, _header(job, loaded, inputs), job, loaded, inputs, progress)
    return open_run(path)


def fit(
    subject: SubjectLike,
    clips: Named,
    *,
    cameras: Cameras = None,
    keypoints: Named = None,
    seed: int = 0,
    person: str | int = "auto",
    out: PathLike | None = None,
) -> Fit:
    """Fit a subject's proportions to the first frames of a clip; `out` is written as a URDF that loads again.

    The other arguments are those of `track`. Raises InputError as `track` does, and where there is nothing to fit.
    """
    if out is not None:
        _check_folder(Path(out))
    loaded = subject if isinstance(subject, Subject) else load_subject(subject)
    if not loaded.proportions:
        raise InputError(loaded.source, "has no <proportion> elements: there is nothing to fit")
    inputs = _inputs(loaded, clips, keypoints, cameras, person)
    with threadpool_limits(limits=1):
        fitted = fit_proportions(loaded, inputs.observations, _seed(seed))
    if out is not None:
        fitted.subject.write(out)
    return fitted


def is_built_in(subject: Subject) -> bool:
    """Whether this is a built-in subject with the proportions it was shipped with, nobody's yet."""
    return subject.source in BUILT_IN and subject.proportions == load_subject(subject.source).proportions


@dataclass(frozen=True)
class _Job:
    """How to track; with the subject and the inputs this decides the result."""

    tracker: str
    settings: Settings
    seed: int
    fit: Literal["auto", "off"]
    person: str | int


def _track_into(
    path: Path,
    resume: bool,
    overwrite: bool,
    header: RunHeader,
    job: _Job,
    subject: Subject,
    inputs: Inputs,
    progress: Reporter,
) -> None:
    state: TrackState | None = None
    first = 0
    if resume and path.exists():
        writer, arrays, first = RunWriter.resume(path, header)
        state = TrackState.from_arrays(arrays) if arrays else None
    else:
        writer = RunWriter.create(path, header, overwrite=overwrite)
    with writer:
        writer.put_observations(inputs.observations)
        tracker = make_tracker(job.tracker, Body(subject), job.settings)
        observations = inputs.observations
        with progress("tracking") as report:
            run_into(writer, tracker, observations, job.seed, state=state, first=first, progress=report)
        if job.settings.smooth.enabled:  # from the stored results, so that a resumed run has the same
            results = list(open_run(path))
            with progress("smoothing") as report:
                smoothed = smooth_track(tracker.search, observations, results, job.settings.smooth, progress=report)
            writer.put_smoothed(smoothed)
        writer.finish()


def _header(job: _Job, subject: Subject, inputs: Inputs) -> RunHeader:
    cameras = inputs.observations[0].cameras
    return RunHeader(
        subject_urdf=subject.urdf,
        subject_source=subject.source,
        subject_base=subject.base,
        cameras=cameras,
        clips={c.name: os.path.abspath(clip) if clip else None for c, clip in zip(cameras, inputs.clips, strict=True)},
        image_sizes={c.name: c.image_size for c in cameras},
        times=inputs.times,
        tracker=job.tracker,
        settings={**job.settings.to_dict(), "fit": job.fit, "person": job.person},
        seed=job.seed,
        version=__version__,
        notes=(*subject.notes, *inputs.notes),
    )


def _inputs(subject: Subject, clips: Named, keypoints: Named, cameras: Cameras, person: str | int) -> Inputs:
    inputs = load_inputs(Body(subject), clips, keypoints, cameras, person=person)
    if not any(observable(o) for o in inputs.observations):
        problem = f"no frame has {MIN_KEYPOINTS} or more of the subject's landmarks"
        raise InputError("keypoints", problem, remedy=f"landmarks: {', '.join(m.name for m in subject.landmarks)}")
    for note in (*subject.notes, *inputs.notes):
        warnings.warn(note, InputWarning, stacklevel=3)
    return inputs


def _seed(seed: int) -> int:
    if seed < 0:
        raise InputError("seed", f"{seed} is negative", remedy="0 or more")
    return seed


def _fit_choice(fit: str) -> Literal["auto", "off"]:
    if fit not in FIT_CHOICES:
        raise InputError("fit", f"{fit!r} is unknown", remedy=f"one of {', '.join(FIT_CHOICES)}")
    return "auto" if fit == "auto" else "off"


def _check_out(path: Path, resume: bool, overwrite: bool) -> None:
    """Say what is wrong with the output before an hour of work, not after."""
    _check_folder(path)
    if resume and overwrite:
        raise InputError(path, "cannot be resumed and overwritten", remedy="choose one")
    if path.exists() and not (resume or overwrite):
        raise InputError(path, "exists already", remedy="--resume goes on with it, --overwrite replaces it")


def _check_folder(path: Path) -> None:
    if path.is_dir():
        raise InputError(path, "is a folder, a file is needed")
    if not path.absolute().parent.is_dir():
        raise InputError(path, "its folder does not exist", remedy=f"mkdir -p {path.parent}")
